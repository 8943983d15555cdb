// SPDX-License-Identifier: Apache-2.0
#include "packing.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include "assertion.h"

namespace envconv {

namespace {

constexpr Packing packings[] = {
    {"row", "all faces side by side"},
    {"column", "all faces one below the other"},
    {"grid", "row by row: 3x2 for six faces, 4x3 for twelve ..."},
    {"cross", "six faces unfolded, 4x3: +Y above, -Y below +Z; middle row -X +Z +X -Z"},
    {"vcross", "six faces unfolded, 3x4: as cross, with -Z at the bottom, upside down"},
    {"youtube", "six faces, 3x2: left front right, and turned on their sides down back up"},
    {"files", "each face in a file of its own"},
    {"parts", "each face in a part of its own of one EXR file, or a face or layer of one DDS, KTX or KTX2 file"},
};

// A place in an unfolded cube.  The picture in it is given by where it looks, so that one table serves every layout of
// six squares, whatever its faces are called and however they are turned.
struct Slot {
  int column, row;
  Vec3 centre;
  Vec3 top_left;  // the corner of the picture as packed
};

// Neighbours in the picture are neighbours on the sphere: the unfolding of OpenGL's cube.
constexpr Slot cross_slots[] = {
    {2, 1, {1, 0, 0}, {1, 1, 1}},    {0, 1, {-1, 0, 0}, {-1, 1, -1}}, {1, 0, {0, 1, 0}, {-1, 1, -1}},
    {1, 2, {0, -1, 0}, {-1, -1, 1}}, {1, 1, {0, 0, 1}, {-1, 1, 1}},   {3, 1, {0, 0, -1}, {1, 1, -1}},
};
// -Z hangs below -Y, as in HDRShop's cross.
constexpr Slot vcross_slots[] = {
    {2, 1, {1, 0, 0}, {1, 1, 1}},    {0, 1, {-1, 0, 0}, {-1, 1, -1}}, {1, 0, {0, 1, 0}, {-1, 1, -1}},
    {1, 2, {0, -1, 0}, {-1, -1, 1}}, {1, 1, {0, 0, 1}, {-1, 1, 1}},   {1, 3, {0, 0, -1}, {-1, -1, -1}},
};
// Corners as ffmpeg's v360 writes "eac" (libavfilter/vf_v360.c), and YouTube reads it: the lower row is one strip too,
// lying on its side.
constexpr Slot youtube_slots[] = {
    {2, 0, {1, 0, 0}, {1, 1, 1}},   {0, 0, {-1, 0, 0}, {-1, 1, -1}}, {2, 1, {0, 1, 0}, {1, 1, -1}},
    {0, 1, {0, -1, 0}, {1, -1, 1}}, {1, 0, {0, 0, 1}, {-1, 1, 1}},   {1, 1, {0, 0, -1}, {1, -1, -1}},
};

std::span<const Slot> slots_of(const Packing& packing) {
  if (packing.name == "cross") return cross_slots;
  if (packing.name == "vcross") return vcross_slots;
  if (packing.name == "youtube") return youtube_slots;
  return {};
}

// Beyond this a face has more texels than any memory; below it no size of a face overflows.
constexpr int tallest_face = 1 << 26;

bool is_apart(const Packing& packing) { return packing.name == "files" || packing.name == "parts"; }

bool is_cube(const Layout& layout) {
  constexpr std::string_view names[] = {"px", "nx", "py", "ny", "pz", "nz"};
  return std::ranges::equal(layout.info().faces, names, [](const Face& face, std::string_view name) {
    return face.name == name && face.aspect == 1 && face.scale == 1;
  });
}

// The face that looks where the slot does, and the quarters it must be turned by.
std::pair<int, int> face_in_slot(const Layout& layout, const Slot& slot) {
  int face = 0;
  for (int f = 1; f < layout.face_count(); ++f)
    if (dot(layout.direction(f, 0.5, 0.5), slot.centre) > dot(layout.direction(face, 0.5, 0.5), slot.centre)) face = f;
  // Turned clockwise by a quarter, the bottom left corner comes to the top left; by a half, the bottom right.
  constexpr double corners[4][2] = {{0, 0}, {0, 1}, {1, 1}, {1, 0}};
  int turns = 0;
  double best = -2;
  for (int q = 0; q < 4; ++q) {
    const double along = dot(layout.direction(face, corners[q][0], corners[q][1]), slot.top_left);
    if (along > best) best = along, turns = q;
  }
  return {face, turns};
}

// True for a cell with texels, all of them in an image of that size.
[[maybe_unused]] bool is_inside(const Cell& cell, Size size) {
  const Size turned = cell.quarter_turns % 2 ? Size{cell.size.height, cell.size.width} : cell.size;
  return turned.width >= 1 && turned.height >= 1 && cell.x >= 0 && cell.x <= size.width - turned.width && cell.y >= 0 &&
         cell.y <= size.height - turned.height;
}

// Faces in each row.
std::vector<int> rows_of(const Layout& layout, const Packing& packing) {
  const int n = layout.face_count();
  if (packing.name == "row") return {n};
  if (packing.name == "column") return std::vector<int>(static_cast<std::size_t>(n), 1);
  const std::span<const int> own = layout.info().rows;
  const bool is_line = own.size() <= 1 || std::ranges::all_of(own, [](int k) { return k == 1; });
  if (!is_line) return {own.begin(), own.end()};
  // The layout's own arrangement is a line: the most nearly square grid that has no empty cell instead.
  int rows = 1;
  for (int r = 2; r * r <= n; ++r)
    if (n % r == 0) rows = r;
  return std::vector<int>(static_cast<std::size_t>(rows), n / rows);
}

std::string text(Size size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

// What to say of a size that no face height gives: the nearest narrower and wider ones that would do.
std::string misfit(const Layout& layout, const Packing& packing, Size size) {
  const auto at = [&](int height) {
    const Result<PackedShape> shape = packed_shape(layout, packing, height);
    return shape ? shape->size : Size{std::numeric_limits<int>::max(), std::numeric_limits<int>::max()};
  };
  int low = 1, high = 2;  // at(low) is no wider than the image, or low is 1; at(high) is wider
  while (high < tallest_face && at(high).width <= size.width) low = high, high *= 2;
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    (at(middle).width <= size.width ? low : high) = middle;
  }
  return text(size) + " is not a " + std::string(packing.name) + " of " + std::string(layout.name()) + ": " +
         text(at(low)) + " or " + text(at(high)) + " would fit";
}

bool same_sizes(const Layout& layout, const std::vector<Image>& faces) {
  for (int f = 0; f < layout.face_count(); ++f) {
    const Image& face = faces[static_cast<std::size_t>(f)];
    if (face.empty() || face.channels() != faces[0].channels() ||
        Size{face.width(), face.height()} != face_size(layout, f, faces[0].height()))
      return false;
  }
  return true;
}

// Calls copy(face row pointer, packed row pointer, pixels, packed stride in values) so that the pixels of rows
// [first, end) of an unturned face land where the cell wants them; the packed stride is that between the face row's
// successive pixels.
template <class Copy>
void for_each_face_row(const Cell& cell, int first, int end, Image& face, Image& packed, Copy copy) {
  const int w = cell.size.width, h = cell.size.height;
  const std::ptrdiff_t right = packed.channels();
  const std::ptrdiff_t down = static_cast<std::ptrdiff_t>(packed.width()) * packed.channels();
  tbb::parallel_for(first, end, [&](int j) {
    switch (cell.quarter_turns & 3) {
      case 0: copy(face.row(j), packed.at(cell.x, cell.y + j), w, right); break;
      case 1: copy(face.row(j), packed.at(cell.x + h - 1 - j, cell.y), w, down); break;
      case 2: copy(face.row(j), packed.at(cell.x + w - 1, cell.y + h - 1 - j), w, -right); break;
      default: copy(face.row(j), packed.at(cell.x + j, cell.y + w - 1), w, -down); break;
    }
  });
}

// Copies between all faces and the packed image, a band of its rows after the other, so that what was copied can be
// given back band by band: forget(y, faces' rows) is called with the packed row and each face's row above which
// everything is done.  A face that is turned is copied as a whole when its first row comes up.
template <class Copy, class Forget>
void for_each_band(const PackedShape& shape, std::vector<Image>& faces, Image& packed, Copy copy, Forget forget) {
  constexpr int band = 64;
  std::vector<int> done(faces.size(), 0);
  for (int y = 0; y < shape.size.height; y += band) {
    const int below = std::min(y + band, shape.size.height);
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const Cell& cell = shape.cells[f];
      if (cell.y >= below || done[f] == cell.size.height) continue;
      const int end = cell.quarter_turns & 3 ? cell.size.height : std::min(cell.size.height, below - cell.y);
      for_each_face_row(cell, done[f], end, faces[f], packed, copy);
      done[f] = end;
    }
    forget(below, done);
  }
}

}  // namespace

std::span<const Packing> all_packings() { return packings; }

const Packing* find_packing(std::string_view name) {
  for (const Packing& packing : packings)
    if (packing.name == name) return &packing;
  return nullptr;
}

const Packing& default_packing(const Layout& layout) {
  const std::span<const int> rows = layout.info().rows;
  if (rows.size() <= 1) return *find_packing("row");
  return *find_packing(std::ranges::all_of(rows, [](int k) { return k == 1; }) ? "column" : "grid");
}

bool is_cube_map(const Layout& layout) {
  if (!is_cube(layout)) return false;
  // The cross shows the cube map's faces as they are stored.
  for (int face = 0; face < layout.face_count(); ++face)
    if (face_in_slot(layout, cross_slots[face]) != std::pair(face, 0)) return false;
  return true;
}

bool faces_are_alike(const Layout& layout) {
  const Face& first = layout.info().faces.front();
  return std::ranges::all_of(
      layout.info().faces, [&](const Face& face) { return face.aspect == first.aspect && face.scale == first.scale; });
}

bool packs(const Packing& packing, const Layout& layout) { return slots_of(packing).empty() || is_cube(layout); }

namespace {
Error too_large(const Layout& layout, const Packing& packing, int height) {
  return {ErrorCode::limit, "a " + std::string(packing.name) + " of " + std::string(layout.name()) + " with faces " +
                                std::to_string(height) + " texels high is too large for one image (use packing files)"};
}
}  // namespace

Result<PackedShape> packed_shape(const Layout& layout, const Packing& packing, int height) {
  if (height > tallest_face) return too_large(layout, packing, height);
  std::vector<Size> faces;
  for (int f = 0; f < layout.face_count(); ++f) faces.push_back(height < 1 ? Size{} : face_size(layout, f, height));
  return packed_shape(layout, packing, faces);
}

Result<PackedShape> packed_shape(const Layout& layout, const Packing& packing, const std::vector<Size>& faces) {
  if (is_apart(packing))
    return Error{ErrorCode::unsupported,
                 "packing " + std::string(packing.name) + " is not one image (its faces are stored apart)"};
  if (!packs(packing, layout))
    return Error{ErrorCode::unsupported, "packing " + std::string(packing.name) +
                                             " is for the six faces of a cube, not " + std::string(layout.name()) +
                                             " (use row, column or grid)"};
  ENVCONV_ASSERT(faces.size() == layout.info().faces.size());
  const int height = faces[0].height;
  if (height < 1) return Error{ErrorCode::usage, "a face of height " + std::to_string(height) + " has no texels"};
  if (height > tallest_face) return too_large(layout, packing, height);

  PackedShape shape;
  shape.cells.resize(faces.size());
  std::int64_t width = 0, total_height = 0;
  if (const std::span<const Slot> slots = slots_of(packing); !slots.empty()) {
    for (const Slot& slot : slots) {
      const auto [face, turns] = face_in_slot(layout, slot);
      const std::int64_t x = std::int64_t{height} * slot.column, y = std::int64_t{height} * slot.row;
      width = std::max(width, x + height);
      total_height = std::max(total_height, y + height);
      shape.cells[static_cast<std::size_t>(face)] = {static_cast<int>(x), static_cast<int>(y), {height, height}, turns};
    }
  } else {
    std::size_t face = 0;
    for (const int count : rows_of(layout, packing)) {
      std::int64_t x = 0;
      int row_height = 0;
      for (int k = 0; k < count; ++k, ++face) {
        shape.cells[face] = {static_cast<int>(x), static_cast<int>(total_height), faces[face], 0};
        x += faces[face].width;
        row_height = std::max(row_height, faces[face].height);
      }
      width = std::max(width, x);
      total_height += row_height;
    }
  }
  constexpr std::int64_t most = std::numeric_limits<int>::max();
  if (width > most || total_height > most) return too_large(layout, packing, height);
  shape.size = {static_cast<int>(width), static_cast<int>(total_height)};
  ENVCONV_ASSERT(std::ranges::all_of(shape.cells, [&](const Cell& cell) { return is_inside(cell, shape.size); }));
  return shape;
}

std::optional<int> height_from_packed_size(const Layout& layout, const Packing& packing, Size size) {
  // The packed image's height grows with every texel of the face's height, and is no less than that.
  int low = 1, high = size.height;
  while (low <= high) {
    const int middle = low + (high - low) / 2;
    const Result<PackedShape> shape = packed_shape(layout, packing, middle);
    if (!shape && shape.error().code != ErrorCode::limit) return std::nullopt;
    if (shape && shape->size == size) return middle;
    if (shape && shape->size.height < size.height)
      low = middle + 1;
    else
      high = middle - 1;
  }
  return std::nullopt;
}

Result<Image> pack(const Layout& layout, const Packing& packing, std::vector<Image> faces) {
  if (faces.size() != static_cast<std::size_t>(layout.face_count()) || !same_sizes(layout, faces))
    return Error{ErrorCode::usage,
                 "the images are not the faces of one " + std::string(layout.name()) + " environment"};
  ENVCONV_TRY(const PackedShape shape, packed_shape(layout, packing, faces[0].height()));
  return pack(shape, std::move(faces));
}

Image pack(const PackedShape& shape, std::vector<Image> faces) {
  ENVCONV_ASSERT(faces.size() == shape.cells.size());
  if (faces.size() == 1) return std::move(faces[0]);
  const int channels = faces[0].channels();
  Image packed = faces[0].sibling(shape.size.width, shape.size.height, channels);
  std::int64_t covered = 0;
  for (const Cell& cell : shape.cells) covered += std::int64_t{cell.size.width} * cell.size.height;
  if (covered != std::int64_t{shape.size.width} * shape.size.height) packed.fill(0);
  const auto pixel_bytes = static_cast<std::size_t>(channels) * sizeof(float);
  const auto copy = [&](float* from, float* to, int n, std::ptrdiff_t stride) {
    if (stride == channels) {
      std::memcpy(to, from, static_cast<std::size_t>(n) * pixel_bytes);
      return;
    }
    for (int i = 0; i < n; ++i, from += channels) std::memcpy(to + i * stride, from, pixel_bytes);
  };
  for_each_band(shape, faces, packed, copy, [&](int, const std::vector<int>& done) {
    for (std::size_t f = 0; f < faces.size(); ++f) {
      if (faces[f].empty()) continue;
      if (done[f] == shape.cells[f].size.height) {
        faces[f] = Image();
      } else {
        faces[f].forget_rows_above(done[f]);
      }
    }
  });
  return packed;
}

Result<std::vector<Image>> unpack(const Layout& layout, const Packing& packing, Image image) {
  const Size size{image.width(), image.height()};
  if (image.empty()) return Error{ErrorCode::usage, "there are no pixels to unpack"};
  const std::optional<int> height = height_from_packed_size(layout, packing, size);
  if (!height) {
    ENVCONV_CHECK(packed_shape(layout, packing, 1));  // a packing that is not one image, or not for this layout
    return Error{ErrorCode::input, misfit(layout, packing, size)};
  }
  ENVCONV_TRY(const PackedShape shape, packed_shape(layout, packing, *height));
  return unpack(shape, std::move(image));
}

std::vector<Image> unpack(const PackedShape& shape, Image image) {
  ENVCONV_ASSERT(image.width() == shape.size.width && image.height() == shape.size.height);
  std::vector<Image> faces;
  if (shape.cells.size() == 1) {
    faces.push_back(std::move(image));
    return faces;
  }
  const int channels = image.channels();
  const auto pixel_bytes = static_cast<std::size_t>(channels) * sizeof(float);
  for (const Cell& cell : shape.cells) faces.push_back(image.sibling(cell.size.width, cell.size.height, channels));
  const auto copy = [&](float* to, const float* from, int n, std::ptrdiff_t stride) {
    if (stride == channels) {
      std::memcpy(to, from, static_cast<std::size_t>(n) * pixel_bytes);
      return;
    }
    for (int i = 0; i < n; ++i, to += channels) std::memcpy(to, from + i * stride, pixel_bytes);
  };
  for_each_band(shape, faces, image, copy, [&](int y, const std::vector<int>&) { image.forget_rows_above(y); });
  return faces;
}

}  // namespace envconv
