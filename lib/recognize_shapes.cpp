// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <utility>

#include "assertion.h"
#include "recognize_shared.h"

namespace envconv {
namespace {

// The packings of a layout that make one image, the default first.  Those that put faces in the same places as an
// earlier one are left out.
std::vector<const Packing*> distinct_packings(const Layout& layout) {
  constexpr int height = 16;
  std::vector<const Packing*> packings{&default_packing(layout)};
  for (const Packing& packing : all_packings())
    if (!is_apart(packing) && packs(packing, layout)) packings.push_back(&packing);
  std::vector<PackedShape> shapes;
  std::erase_if(packings, [&](const Packing* packing) {
    const Result<PackedShape> shape = packed_shape(layout, *packing, height);
    if (!shape) return true;
    const auto same_cell = [](const Cell& a, const Cell& b) {
      return a.x == b.x && a.y == b.y && a.quarter_turns == b.quarter_turns;
    };
    for (const PackedShape& other : shapes)
      if (std::ranges::equal(other.cells, shape->cells, same_cell)) return true;
    shapes.push_back(*shape);
    return false;
  });
  return packings;
}

}  // namespace

std::string text(Size size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

std::string text(double number) {
  char buffer[32];
  const std::to_chars_result end = std::to_chars(buffer, buffer + sizeof buffer, number + 0.0);  // no -0
  return {buffer, end.ptr};
}

std::string joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : ", ") + word;
  return all;
}

bool is_apart(const Packing& packing) { return packing.name == "files" || packing.name == "parts"; }

std::optional<Fit> fit(const Layout& layout, const Packing& packing, Size size) {
  if (!is_apart(packing)) {
    const std::optional<int> height = height_from_packed_size(layout, packing, size);
    return height ? std::optional(Fit{&layout, &packing, *height}) : std::nullopt;
  }
  // A layout of one face is one file, or one part.
  if (layout.face_count() != 1 || size.height < 1 || face_size(layout, 0, size.height) != size) return std::nullopt;
  return Fit{&layout, &packing, size.height};
}

std::optional<Fit> fit_any(const Layout& layout, Size size) {
  for (const Packing* packing : distinct_packings(layout))
    if (const std::optional<Fit> found = fit(layout, *packing, size)) return found;
  return std::nullopt;
}

std::string ratio(const Layout& layout, const Packing& packing) {
  const Result<PackedShape> shape = packed_shape(layout, packing, 10000);
  if (!shape) return "?";
  const auto [w, h] = shape->size;
  const int divisor = std::gcd(w, h);
  if (w / divisor <= 64 && h / divisor <= 64) return std::to_string(w / divisor) + ":" + std::to_string(h / divisor);
  return "about " + text(std::round(1000.0 * w / h) / 1000) + ":1";
}

std::string expected_shapes(const Layout& layout) {
  std::vector<std::pair<std::string, std::vector<std::string>>> shapes;
  for (const Packing* packing : distinct_packings(layout)) {
    const std::string r = ratio(layout, *packing);
    auto known = std::ranges::find_if(shapes, [&](const auto& shape) { return shape.first == r; });
    if (known == shapes.end()) known = shapes.insert(shapes.end(), {r, {}});
    known->second.push_back(text(packing->name));
  }
  if (layout.face_count() == 1) return shapes[0].first;
  std::vector<std::string> words;
  for (const auto& [r, names] : shapes) words.push_back(r + " (" + joined(names) + ")");
  return joined(words);
}

bool unused_cells_are_constant(const Image& image, const PackedShape& shape) {
  const float* first = nullptr;
  const int side = shape.cells[0].size.height;  // of the squares that crosses are made of
  ENVCONV_ASSERT(Size{image.width(), image.height()} == shape.size && shape.size.width % side == 0);
  const auto channels = static_cast<std::size_t>(image.channels());
  for (int y = 0; y < image.height(); ++y)
    for (int x0 = 0; x0 < image.width(); x0 += side) {
      const bool is_used = std::ranges::any_of(
          shape.cells, [&](const Cell& cell) { return cell.x == x0 && y >= cell.y && y < cell.y + side; });
      if (is_used) continue;
      if (!first) first = image.at(x0, y);
      for (int x = x0; x < x0 + side; ++x)
        for (std::size_t c = 0; c < channels; ++c) {
          const float a = first[c], b = image.at(x, y)[c];
          if (a != b && !(std::isnan(a) && std::isnan(b))) return false;
        }
    }
  return true;
}

Possible possible_fits(Size size, const Packing* told) {
  Possible possible;
  for (const Layout& layout : all_layouts())
    for (const Packing* packing : distinct_packings(layout)) {
      if (told && told != packing) continue;
      const std::optional<Fit> found = fit(layout, *packing, size);
      if (!found) continue;
      possible.fits.push_back(*found);
      const bool is_default = packing == &default_packing(layout);
      possible.names.push_back(text(layout.name()) + (is_default ? "" : " (" + text(packing->name) + ")"));
    }
  return possible;
}

}  // namespace envconv
