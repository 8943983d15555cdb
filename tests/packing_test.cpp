// SPDX-License-Identifier: Apache-2.0
// Packings: where faces sit (facts, from the consumers' own definitions) and that nothing is lost on the way (laws).
#include "packing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "layout_cases.h"

namespace envconv {
namespace {

const Layout& layout(std::string_view name) { return *find_layout(name); }
const Packing& packing(std::string_view name) { return *find_packing(name); }

// A different value in every texel of every face.
std::vector<Image> numbered_faces(const Layout& layout, int height, int channels) {
  std::vector<Image> faces;
  float value = 1;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    Image face(size.width, size.height, channels);
    for (std::size_t i = 0; i < face.value_count(); ++i) face.data()[i] = value++;
    faces.push_back(std::move(face));
  }
  return faces;
}

// Face point that is seen at pixel position (x, y) of the packed image (continuous, pixel centres at halves).
Vec3 packed_direction(const Layout& layout, const PackedShape& shape, int face, double x, double y) {
  const Cell& cell = shape.cells[static_cast<std::size_t>(face)];
  const bool aside = cell.quarter_turns % 2 != 0;
  const double s = (x - cell.x) / (aside ? cell.size.height : cell.size.width);
  const double t = (y - cell.y) / (aside ? cell.size.width : cell.size.height);
  switch (cell.quarter_turns) {
    case 0: return layout.direction(face, s, t);
    case 1: return layout.direction(face, t, 1 - s);
    case 2: return layout.direction(face, 1 - s, 1 - t);
    default: return layout.direction(face, 1 - t, s);
  }
}

// The face whose cell holds pixel (x, y), or -1.
int face_at(const PackedShape& shape, double x, double y) {
  for (std::size_t f = 0; f < shape.cells.size(); ++f) {
    const Cell& c = shape.cells[f];
    const bool aside = c.quarter_turns % 2 != 0;
    if (x >= c.x && y >= c.y && x < c.x + (aside ? c.size.height : c.size.width) &&
        y < c.y + (aside ? c.size.width : c.size.height))
      return static_cast<int>(f);
  }
  return -1;
}

class EveryLayout : public testing::TestWithParam<Layout> {};
INSTANTIATE_TEST_SUITE_P(All, EveryLayout, testing::ValuesIn(all_layouts().begin(), all_layouts().end()),
                         [](const auto& info) { return test::test_name(info.param); });

TEST_P(EveryLayout, UnpackUndoesPack) {
  const Layout& l = GetParam();
  for (const Packing& p : all_packings()) {
    if (!packs(p, l) || p.name == "files" || p.name == "parts") continue;
    for (const int height : {1, 2, 7, 16}) {
      SCOPED_TRACE(std::string(p.name) + " " + std::to_string(height));
      const std::vector<Image> faces = numbered_faces(l, height, 3);
      Result<Image> packed = pack(l, p, numbered_faces(l, height, 3));
      ASSERT_TRUE(packed.ok()) << packed.error().message;
      const PackedShape shape = *packed_shape(l, p, height);
      EXPECT_EQ(packed->width(), shape.size.width);
      EXPECT_EQ(packed->height(), shape.size.height);
      Result<std::vector<Image>> back = unpack(l, p, std::move(*packed));
      ASSERT_TRUE(back.ok()) << back.error().message;
      ASSERT_EQ(back->size(), faces.size());
      for (std::size_t f = 0; f < faces.size(); ++f) {
        const Image &a = faces[f], &b = (*back)[f];
        ASSERT_EQ(a.width(), b.width());
        ASSERT_EQ(a.height(), b.height());
        ASSERT_TRUE(std::equal(a.data(), a.data() + a.value_count(), b.data()));
      }
    }
  }
}

TEST_P(EveryLayout, CellsLieInsideAndApart) {
  const Layout& l = GetParam();
  for (const Packing& p : all_packings()) {
    if (!packs(p, l) || p.name == "files" || p.name == "parts") continue;
    const PackedShape shape = *packed_shape(l, p, 8);
    std::vector<int> covered(static_cast<std::size_t>(shape.size.width) * static_cast<std::size_t>(shape.size.height));
    for (const Cell& c : shape.cells) {
      const int w = c.quarter_turns % 2 ? c.size.height : c.size.width;
      const int h = c.quarter_turns % 2 ? c.size.width : c.size.height;
      ASSERT_GE(c.x, 0);
      ASSERT_GE(c.y, 0);
      ASSERT_LE(c.x + w, shape.size.width);
      ASSERT_LE(c.y + h, shape.size.height);
      for (int y = c.y; y < c.y + h; ++y)
        for (int x = c.x; x < c.x + w; ++x)
          ASSERT_EQ(covered[static_cast<std::size_t>(y * shape.size.width + x)]++, 0) << p.name << " " << x << " " << y;
    }
  }
}

TEST_P(EveryLayout, HeightFollowsFromThePackedSize) {
  const Layout& l = GetParam();
  for (const Packing& p : all_packings()) {
    if (!packs(p, l) || p.name == "files" || p.name == "parts") continue;
    for (const int height : {1, 2, 3, 64, 1000, 4099}) {
      const Size size = packed_shape(l, p, height)->size;
      EXPECT_EQ(height_from_packed_size(l, p, size), height) << p.name;
      EXPECT_EQ(height_from_packed_size(l, p, {size.width + 1, size.height}), std::nullopt) << p.name;
    }
    EXPECT_EQ(height_from_packed_size(l, p, {0, 0}), std::nullopt);
  }
}

TEST_P(EveryLayout, TheDefaultPackingHoldsIt) {
  const Layout& l = GetParam();
  const Packing& p = default_packing(l);
  EXPECT_TRUE(packs(p, l));
  const PackedShape shape = *packed_shape(l, p, 60);
  // Faces row by row, as many in each as the contract says.
  int face = 0, y = 0;
  for (const int count : l.info().rows) {
    int x = 0, row_height = 0;
    for (int k = 0; k < count; ++k, ++face) {
      const Cell& c = shape.cells[static_cast<std::size_t>(face)];
      EXPECT_EQ(c.x, x);
      EXPECT_EQ(c.y, y);
      EXPECT_EQ(c.quarter_turns, 0);
      x += c.size.width;
      row_height = std::max(row_height, c.size.height);
    }
    y += row_height;
  }
  EXPECT_EQ(face, l.face_count());
  EXPECT_EQ(shape.size.height, y);
}

TEST(Packing, ASingleFaceIsMovedNotCopied) {
  std::vector<Image> faces = numbered_faces(layout("latlong"), 4, 3);
  const float* pixels = faces[0].data();
  Result<Image> packed = pack(layout("latlong"), packing("row"), std::move(faces));
  EXPECT_EQ(packed->data(), pixels);
  Result<std::vector<Image>> back = unpack(layout("latlong"), packing("row"), std::move(*packed));
  EXPECT_EQ((*back)[0].data(), pixels);
}

TEST(Packing, DefaultsAreTheContracts) {
  EXPECT_EQ(default_packing(layout("cube")).name, "row");
  EXPECT_EQ(default_packing(layout("latlong")).name, "row");
  EXPECT_EQ(default_packing(layout("openexr-cube")).name, "column");
  EXPECT_EQ(default_packing(layout("tennis-ball")).name, "column");
  EXPECT_EQ(default_packing(layout("diamond-30")).name, "grid");
  EXPECT_EQ(packed_shape(layout("diamond-30"), packing("grid"), 10)->size, (Size{60, 50}));
  const PackedShape capped = *packed_shape(layout("polar-capped"), packing("grid"), 10);
  EXPECT_EQ(capped.size, (Size{40, 20}));  // two caps below a band of 4:1
  EXPECT_EQ(capped.cells[2].x, 10);
  EXPECT_EQ(capped.cells[2].y, 10);
}

TEST(Packing, SizesOfTheCube) {
  const Layout& cube = layout("cube");
  EXPECT_EQ(packed_shape(cube, packing("row"), 8)->size, (Size{48, 8}));
  EXPECT_EQ(packed_shape(cube, packing("column"), 8)->size, (Size{8, 48}));
  EXPECT_EQ(packed_shape(cube, packing("grid"), 8)->size, (Size{24, 16}));
  EXPECT_EQ(packed_shape(cube, packing("cross"), 8)->size, (Size{32, 24}));
  EXPECT_EQ(packed_shape(cube, packing("vcross"), 8)->size, (Size{24, 32}));
  EXPECT_EQ(packed_shape(cube, packing("youtube"), 8)->size, (Size{24, 16}));
}

// ffmpeg's c3x2: +X -X +Y / -Y +Z -Z, none turned.
TEST(Packing, GridOfTheCubeIsThreeByTwo) {
  const PackedShape shape = *packed_shape(layout("cube"), packing("grid"), 8);
  for (int f = 0; f < 6; ++f) {
    EXPECT_EQ(shape.cells[static_cast<std::size_t>(f)].x, f % 3 * 8);
    EXPECT_EQ(shape.cells[static_cast<std::size_t>(f)].y, f / 3 * 8);
    EXPECT_EQ(shape.cells[static_cast<std::size_t>(f)].quarter_turns, 0);
  }
}

// +Y above and -Y below +Z; the middle row -X +Z +X -Z; nothing turned but -Z at the bottom of the vertical cross
// (HDRShop; Filament's crossToCubemap).
TEST(Packing, CrossesOfTheCube) {
  const int column[] = {2, 0, 1, 1, 1, 3}, row[] = {1, 1, 0, 2, 1, 1};
  const PackedShape cross = *packed_shape(layout("cube"), packing("cross"), 8);
  const PackedShape vcross = *packed_shape(layout("cube"), packing("vcross"), 8);
  for (int f = 0; f < 6; ++f) {
    const Cell &c = cross.cells[static_cast<std::size_t>(f)], &v = vcross.cells[static_cast<std::size_t>(f)];
    EXPECT_EQ(c.x, column[f] * 8) << f;
    EXPECT_EQ(c.y, row[f] * 8) << f;
    EXPECT_EQ(c.quarter_turns, 0) << f;
    EXPECT_EQ(v.x, (f == 5 ? 1 : column[f]) * 8) << f;
    EXPECT_EQ(v.y, (f == 5 ? 3 : row[f]) * 8) << f;
    EXPECT_EQ(v.quarter_turns, f == 5 ? 2 : 0) << f;
  }
}

// Corners of a direction-coded picture that ffmpeg's v360 wrote as "eac".
TEST(Packing, YoutubesCorners) {
  const Layout& eac = layout("equi-angular-cube");
  const PackedShape shape = *packed_shape(eac, packing("youtube"), 8);
  struct {
    int column, row;
    Vec3 top_left, top_right;
  } const facts[] = {
      {0, 0, {-1, 1, -1}, {-1, 1, 1}}, {1, 0, {-1, 1, 1}, {1, 1, 1}},   {2, 0, {1, 1, 1}, {1, 1, -1}},
      {0, 1, {1, -1, 1}, {1, -1, -1}}, {1, 1, {1, -1, -1}, {1, 1, -1}}, {2, 1, {1, 1, -1}, {1, 1, 1}},
  };
  for (const auto& fact : facts) {
    const int x = 8 * fact.column, y = 8 * fact.row;
    const int face = face_at(shape, x + 4, y + 4);
    ASSERT_GE(face, 0);
    EXPECT_LT(angle_between(packed_direction(eac, shape, face, x, y), fact.top_left), 1e-9) << x << " " << y;
    EXPECT_LT(angle_between(packed_direction(eac, shape, face, x + 8, y), fact.top_right), 1e-9) << x << " " << y;
  }
}

// Where two cells touch in an unfolding, the picture goes on from one to the other; in YouTube's within each row.
TEST(Packing, UnfoldingsAreContinuous) {
  for (const Layout& l : all_layouts()) {
    if (!packs(packing("cross"), l)) continue;
    for (const std::string_view name : {"cross", "vcross", "youtube"}) {
      const PackedShape shape = *packed_shape(l, packing(name), 16);
      int joints = 0;
      const auto check = [&](double x0, double y0, double x1, double y1, double dx, double dy) {
        const int a = face_at(shape, (x0 + x1) / 2 - dx, (y0 + y1) / 2 - dy);
        const int b = face_at(shape, (x0 + x1) / 2 + dx, (y0 + y1) / 2 + dy);
        if (a < 0 || b < 0) return;
        ++joints;
        for (double t = 0; t <= 1; t += 0.125) {
          const double x = x0 + t * (x1 - x0), y = y0 + t * (y1 - y0);
          EXPECT_LT(angle_between(packed_direction(l, shape, a, x, y), packed_direction(l, shape, b, x, y)), 1e-7)
              << l.name() << " " << name << " at " << x << " " << y;
        }
      };
      for (int y = 0; y < shape.size.height; y += 16)
        for (int x = 0; x < shape.size.width; x += 16) {
          if (x > 0) check(x, y, x, y + 16, 1, 0);
          if (y > 0 && name != "youtube") check(x, y, x + 16, y, 0, 1);
        }
      EXPECT_EQ(joints, name == "youtube" ? 4 : 5) << l.name() << " " << name;
    }
  }
}

TEST(Packing, PixelsOutsideTheCellsAreZero) {
  const Result<Image> packed = pack(layout("cube"), packing("cross"), numbered_faces(layout("cube"), 5, 2));
  const PackedShape shape = *packed_shape(layout("cube"), packing("cross"), 5);
  for (int y = 0; y < packed->height(); ++y)
    for (int x = 0; x < packed->width(); ++x)
      EXPECT_EQ(packed->at(x, y)[1] == 0, face_at(shape, x + 0.5, y + 0.5) < 0) << x << " " << y;
}

TEST(Packing, WhatDoesNotFitIsAnErrorThatHelps) {
  const Result<std::vector<Image>> faces = unpack(layout("cube"), packing("row"), Image(1000, 500, 1));
  ASSERT_FALSE(faces.ok());
  EXPECT_EQ(faces.error().code, ErrorCode::input);
  EXPECT_EQ(faces.error().message, "1000x500 is not a row of cube: 996x166 or 1002x167 would fit");
  EXPECT_EQ(unpack(layout("cube"), packing("row"), Image(1, 1, 1)).error().code, ErrorCode::input);

  EXPECT_FALSE(packs(packing("cross"), layout("latlong")));
  EXPECT_EQ(packed_shape(layout("latlong"), packing("cross"), 4).error().code, ErrorCode::unsupported);
  EXPECT_EQ(unpack(layout("latlong"), packing("cross"), Image(8, 4, 1)).error().code, ErrorCode::unsupported);
  EXPECT_EQ(packed_shape(layout("cube"), packing("files"), 4).error().code, ErrorCode::unsupported);
  EXPECT_EQ(packed_shape(layout("cube"), packing("parts"), 4).error().code, ErrorCode::unsupported);
  EXPECT_EQ(packed_shape(layout("cube"), packing("row"), 0).error().code, ErrorCode::usage);
  EXPECT_EQ(packed_shape(layout("cube"), packing("row"), 1 << 30).error().code, ErrorCode::limit);

  std::vector<Image> five = numbered_faces(layout("cube"), 4, 1);
  five.pop_back();
  EXPECT_EQ(pack(layout("cube"), packing("row"), std::move(five)).error().code, ErrorCode::usage);
  std::vector<Image> uneven = numbered_faces(layout("cube"), 4, 1);
  uneven[3] = Image(5, 5, 1);
  EXPECT_EQ(pack(layout("cube"), packing("row"), std::move(uneven)).error().code, ErrorCode::usage);
}

TEST(Packing, NamesAreFound) {
  for (const Packing& p : all_packings()) EXPECT_EQ(find_packing(p.name), &p);
  EXPECT_EQ(find_packing("rows"), nullptr);
}

}  // namespace
}  // namespace envconv
