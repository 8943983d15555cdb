// SPDX-License-Identifier: Apache-2.0
// Patterns against integrals that are known otherwise: closed forms, high-order quadrature, other layouts.
#include "pattern.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "analyze.h"
#include "layout_cases.h"
#include "resample.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi;
const Layout& layout(std::string_view name) { return *find_layout(name); }

PatternOptions options_of(PatternKind kind, const Layout& l, int height) {
  PatternOptions o;
  o.kind = kind;
  o.layout = &l;
  o.height = height;
  o.placement = l.info().placement;
  return o;
}
EnvImage made(const PatternOptions& options) {
  Result<EnvImage> image = make_pattern(options);
  EXPECT_TRUE(image.ok()) << (image ? "" : image.error().message);
  return std::move(*image);
}

class EveryLayout : public testing::TestWithParam<Layout> {};
INSTANTIATE_TEST_SUITE_P(All, EveryLayout, testing::ValuesIn(all_layouts().begin(), all_layouts().end()),
                         [](const auto& info) { return test::test_name(info.param); });

TEST_P(EveryLayout, ConstantIsConstant) {
  PatternOptions o = options_of(PatternKind::constant, GetParam(), 9);
  o.value = {0.25, 4, 1e-3};
  const EnvImage image = made(o);
  for (const Image& face : image.faces)
    for (std::size_t k = 0; k < face.value_count(); ++k) ASSERT_EQ(face.data()[k], static_cast<float>(o.value[k % 3]));
}

// The integral of a direction over part of the sphere is that of the rim's normal: half the sum over the rim of
// d x (step to the next d) (Stokes).  No area has a part in it, nor the library's quadrature.
Vec3 integral_by_rim(const Layout& l, int face, double u0, double v0, double u1, double v1) {
  constexpr int n = 1000;
  Vec3 sum{0, 0, 0}, last = l.direction(face, u0, v0);
  const double corners[5][2] = {{u0, v0}, {u1, v0}, {u1, v1}, {u0, v1}, {u0, v0}};
  for (int side = 0; side < 4; ++side)
    for (int k = 1; k <= n; ++k) {
      const double t = static_cast<double>(k) / n;
      const Vec3 next = l.direction(face, corners[side][0] + t * (corners[side + 1][0] - corners[side][0]),
                                    corners[side][1] + t * (corners[side + 1][1] - corners[side][1]));
      sum = sum - 0.5 * cross(last, next);  // clockwise as seen from the centre
      last = next;
    }
  return sum;
}

TEST_P(EveryLayout, DirectionsAreIntegrals) {
  const Layout& l = GetParam();
  if (l.info().placement == Placement::inclusive) return;  // cut texels: the other placement's law says enough
  const int height = l.face_count() > 8 ? 6 : 12;
  const EnvImage image = made(options_of(PatternKind::directions, l, height));
  for (int f = 0; f < l.face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int j = 0; j < face.height(); ++j)
      for (int i = j % 3; i < face.width(); i += 3) {
        const double u0 = static_cast<double>(i) / face.width(), v0 = static_cast<double>(j) / face.height(),
                     u1 = (i + 1.0) / face.width(), v1 = (j + 1.0) / face.height();
        if (l.info().domain == Domain::disc &&
            !(l.owns(f, u0, v0) && l.owns(f, u1, v0) && l.owns(f, u0, v1) && l.owns(f, u1, v1)))
          continue;
        const Vec3 integral = integral_by_rim(l, f, u0, v0, u1, v1);
        const double omega = texel_solid_angle(l, f, i, j, {face.width(), face.height()}, Placement::centre);
        const Vec3 mean{face.at(i, j)[0], face.at(i, j)[1], face.at(i, j)[2]};
        // Parallel, whatever the solid angle; the frame that mirror-ball implies turns it.
        const Vec3 expected = normalize(transpose(layout_from_world(image)) * integral);
        // At faces' corners, where creases meet, and at poles formulas bend within a texel.
        EXPECT_LT(angle_between(mean, expected), 2e-3 / height) << f << " " << i << " " << j;
        if (l.info().domain != Domain::square) continue;  // a seam's texels have no solid angle of their own
        EXPECT_NEAR(length(mean), length(integral) / omega, 2e-2 / height) << f << " " << i << " " << j;
      }
  }
}

TEST_P(EveryLayout, MeansOverTheSphere) {
  const Layout& l = GetParam();
  const int height = height_for_texels(l, 1500);
  // Seams cut texels of overlapping and round layouts: their means are those of the texels, not of the parts.
  const double slack = l.info().domain == Domain::square ? 2e-5 : 2e-3;
  for (const double mean : mean_radiance(made(options_of(PatternKind::directions, l, height))))
    EXPECT_NEAR(mean, 0, slack);
  PatternOptions noise = options_of(PatternKind::noise, l, height);
  for (const double mean : mean_radiance(made(noise))) EXPECT_NEAR(mean, 0.5, slack);
}

// Around each axis the region nearest to it is a square face of a cube: the mean of cos(A (1 - cos angle)) over it, by
// Gauss's or any other rule, in the face's plane, where the solid angle of dx dy is (1 + x^2 + y^2)^(-3/2).
double zoneplate_mean(double A) {
  constexpr int n = 1000;
  double sum = 0, total = 0;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const double x = (i + 0.5) / n, y = (j + 0.5) / n, c = 1 / std::sqrt(1 + x * x + y * y);
      sum += c * c * c * (0.5 + 0.5 * std::cos(A * (1 - c)));
      total += c * c * c;
    }
  return sum / total;
}
TEST(Zoneplate, MeanIsKnown) {
  for (const char* name : {"cube", "isocube", "latlong", "healpix"}) {
    const Layout& l = layout(name);
    const int height = height_for_texels(l, 6000);
    const double side = std::sqrt(4 * pi / static_cast<double>(texel_count(l, height)));
    EXPECT_NEAR(mean_radiance(made(options_of(PatternKind::zoneplate, l, height)))[0], zoneplate_mean(2 * pi / side),
                1e-4)
        << name;
  }
}
TEST(Zoneplate, FadesPastTheNyquistLimit) {
  // Contrast along a row of the cube's +Z face: full near the axis, little where a texel spans more than a ring.
  const EnvImage image = made(options_of(PatternKind::zoneplate, layout("cube"), 129));
  const Image& face = image.faces[4];
  EXPECT_NEAR(*face.at(64, 64), 1, 1e-2);
  const auto contrast = [&](int from, int to) {
    float low = 1, high = 0;
    for (int x = from; x < to; ++x) low = std::min(low, *face.at(x, 64)), high = std::max(high, *face.at(x, 64));
    return high - low;
  };
  EXPECT_GT(contrast(65, 80), 0.9);
  EXPECT_LT(contrast(120, 128), 0.6);
  EXPECT_LT(contrast(120, 128), contrast(75, 85));
}

TEST(Noise, IsSeededAndBandLimited) {
  PatternOptions o = options_of(PatternKind::noise, layout("cube"), 16);
  const EnvImage a = made(o), b = made(o);
  o.seed = 2;
  const EnvImage c = made(o);
  EXPECT_EQ(std::memcmp(a.faces[3].data(), b.faces[3].data(), a.faces[3].value_count() * sizeof(float)), 0);
  EXPECT_NE(std::memcmp(a.faces[3].data(), c.faces[3].data(), a.faces[3].value_count() * sizeof(float)), 0);

  // On a meridian a polynomial of degree L has no frequency above L: 64 points tell all up to 31.  Texels of a fine
  // latlong are nearly points.
  o.layout = find_layout("latlong");
  o.height = 128;
  o.degree = 12;
  const EnvImage fine = made(o);
  const Image& face = fine.faces[0];
  double below = 0, above = 0;
  for (int frequency = 1; frequency < 31; ++frequency) {
    double real = 0, imaginary = 0;
    for (int k = 0; k < 64; ++k) {
      // Down the meridian of column 0 and up the opposite one.
      const int j = k < 32 ? 4 * k + 2 : 4 * (63 - k) + 1;
      const double value = *face.at(k < 32 ? 0 : 128, j), angle = 2 * pi * frequency * k / 64;
      real += value * std::cos(angle);
      imaginary += value * std::sin(angle);
    }
    (frequency <= 12 ? below : above) += real * real + imaginary * imaginary;
  }
  EXPECT_GT(below, 1);
  EXPECT_LT(above, 1e-3 * below);
}

// Energy of suns, large, small, tiny, wherever layouts have their difficulties.
TEST_P(EveryLayout, SunKeepsItsEnergy) {
  const Layout& l = GetParam();
  PatternOptions o = options_of(PatternKind::sun, l, 1);
  o.value = {1, 1000, 3};
  for (const int height : {1, 12}) {
    o.height = height;
    for (const double diameter : {0.01, 0.53, 60.0})
      for (const Vec3 direction : {Vec3{0, 1, 0}, Vec3{0, -1, 0}, Vec3{1e-4, 1, 1e-4}, Vec3{0, 0, -1}, Vec3{1, 1, 1},
                                   Vec3{-1, 0, 1e-3}, Vec3{0.3, 0.4, -0.8}, Vec3{0.7, std::sqrt(0.5), 0.1}}) {
        o.diameter = diameter;
        o.direction = direction;
        const EnvImage image = made(o);
        const double half = std::sin(diameter * pi / 720), share = half * half;  // of the sphere
        const std::vector<double> mean = mean_radiance(image);
        for (std::size_t c = 0; c < 3; ++c)
          EXPECT_NEAR(mean[c], o.value[c] * share, 1e-6 * o.value[c] * share)
              << height << " " << diameter << " " << direction.x << " " << direction.y << " " << direction.z;
        float most = 0;
        for (const Image& face : image.faces)
          for (std::size_t k = 0; k < face.value_count(); k += 3) most = std::max(most, face.data()[k]);
        EXPECT_LE(most, 1.03f);  // no texel is brighter than the sun
      }
  }
}

// Its shape: a texel within the sun is full, one beyond it black, and those across the rim hold their share.
TEST(Sun, HasItsShape) {
  PatternOptions o = options_of(PatternKind::sun, layout("cube"), 64);
  o.direction = {0.2, 0.1, 1};
  o.value = {1, 1, 1};
  o.diameter = 30;
  const EnvImage image = made(o);
  const Image& face = image.faces[4];
  for (int j = 0; j < 64; ++j)
    for (int i = 0; i < 64; ++i) {
      int inside = 0;
      for (int k = 0; k < 400; ++k)
        inside +=
            angle_between(layout("cube").direction(4, (i + (k % 20 + 0.5) / 20) / 64, (j + (k / 20 + 0.5) / 20) / 64),
                          o.direction) < 15 * pi / 180;
      EXPECT_NEAR(*face.at(i, j), inside / 400.0, 0.02) << i << " " << j;
    }
}

// Texels far from edges agree between a pattern drawn in a layout, and drawn in the cube and resampled.
TEST_P(EveryLayout, LabelsAreTheSameInEveryLayout) {
  // Names of faces differ; axes are the same, and the letters of all six are read here.
  const Layout& l = GetParam();
  const EnvImage direct = made(options_of(PatternKind::labels, l, height_for_texels(l, 60000)));
  ResampleOptions to_cube;
  to_cube.layout = find_layout("cube");
  to_cube.height = 64;
  const Result<EnvImage> seen = resample(direct, to_cube);
  ASSERT_TRUE(seen.ok());
  static const EnvImage cube = made(options_of(PatternKind::labels, *to_cube.layout, 64));
  // A sphere map's rim is one direction, behind, around which nothing can be read.
  const bool has_rim = std::isinf(figures(l).sampling_requirement);
  const Vec3 rim = transpose(layout_from_world(direct)) * Vec3{0, 0, -1};
  for (std::size_t f = 0; f < 6; ++f) {
    if (has_rim && to_cube.layout->locate(rim).face == static_cast<int>(f)) continue;
    // The middle of each face holds the axis' name; red, green and blue tell how far a texel is from its surroundings.
    double agree = 0, mirrored = 0, upside_down = 0;
    const auto ink = [](const Image& face, int x, int y) {
      const float* p = face.at(x, y);
      return *std::max_element(p, p + 3) > 0.45f ? 1.0 : 0.0;
    };
    double dark = 0, all = 0;
    for (int y = 20; y < 42; ++y)
      for (int x = 20; x < 44; ++x) {
        const double there = ink(seen->faces[f], x, y);
        agree += there == ink(cube.faces[f], x, y);
        mirrored += there == ink(cube.faces[f], 63 - x, y);
        upside_down += there == ink(cube.faces[f], x, 61 - y);
        dark += there;
        ++all;
      }
    EXPECT_GT(dark, 10) << f;
    EXPECT_GT(agree, 0.8 * all) << f;
    EXPECT_GT(agree, mirrored + 0.02 * all) << f;
    EXPECT_GT(agree, upside_down + 0.02 * all) << f;
  }
}

// Grid lines are where latitude and longitude are multiples of 10 degrees, and nowhere else.
TEST(Grid, LinesAreWhereTheyBelong) {
  const EnvImage image = made(options_of(PatternKind::grid, layout("latlong"), 360));
  const Image& face = image.faces[0];
  const auto at = [&](double longitude, double latitude) {
    return face.at(static_cast<int>(std::floor((longitude / 360 + 0.5) * 720)) % 720,  // 180 is -180
                   static_cast<int>(std::floor((0.5 - latitude / 180) * 360)));
  };
  for (int latitude = -60; latitude <= 60; latitude += 10)
    for (int longitude = -175; longitude < 180; longitude += 10) {
      EXPECT_GT(at(longitude, latitude + 0.01)[1], 0.3f) << longitude << " " << latitude;
      EXPECT_LT(at(longitude, latitude + 5)[1], 0.1f) << longitude << " " << latitude;
      EXPECT_GT(at(longitude + 5.01, latitude + 5)[1], 0.3f) << longitude << " " << latitude;
    }
  // Positive axes are discs, negative ones rings: x red, y green, z blue.
  EXPECT_GT(at(90, 0.1)[0], 0.8f);
  EXPECT_LT(at(90, 0.1)[1], 0.2f);
  EXPECT_GT(at(0.1, 0.6)[2], 0.9f);
  EXPECT_GT(at(0.1, 89)[1], 0.6f);
  EXPECT_GT(at(-90, 2.5)[0], 0.8f);
  EXPECT_GT(at(-90.6, 0.3)[1], 0.5f);  // within the ring the equator is seen
}

// A frame changes what the axes are called, a rotation turns the pattern: directions tell both.
TEST(Pattern, FramesAndRotations) {
  PatternOptions o = options_of(PatternKind::directions, layout("cube"), 4);
  o.consumer_from_world = find_frame("blender")->consumer_from_world;
  for (std::size_t c = 0; c < 2; ++c) {
    // What a consumer finds in a direction of its axes is that direction; turned by 90 degrees about up, what was ahead
    // is on the right.
    o.rotation = {c == 0 ? 0.0 : 90.0, 0, 0};
    const EnvImage image = made(o);
    const Mat3 layout_axes = layout_from_world(image);
    const Mat3 turn = rotation_matrix(o.rotation);
    for (const Vec3 world : {Vec3{0, 0, 1}, Vec3{1, 0, 0}, Vec3{0, 1, 0}}) {
      const Location at = layout("cube").locate(layout_axes * (turn * world));
      const Image& face = image.faces[static_cast<std::size_t>(at.face)];
      const float* value = face.at(static_cast<int>(at.u * 4), static_cast<int>(at.v * 4));
      const Vec3 expected = o.consumer_from_world * world;
      EXPECT_GT(value[0] * expected.x + value[1] * expected.y + value[2] * expected.z, 0.9);
    }
  }
}

TEST(Pattern, DoesNotDependOnThreads) {
  const PatternOptions o = options_of(PatternKind::labels, layout("isocube"), 48);
  const EnvImage many = made(o);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const EnvImage single = made(o);
  for (std::size_t f = 0; f < 6; ++f)
    EXPECT_EQ(std::memcmp(many.faces[f].data(), single.faces[f].data(), many.faces[f].value_count() * sizeof(float)),
              0);
}

TEST(Pattern, WrongOptions) {
  PatternOptions o = options_of(PatternKind::sun, layout("cube"), 4);
  o.diameter = 0;
  EXPECT_EQ(make_pattern(o).error().code, ErrorCode::usage);
  o.diameter = 361;
  EXPECT_EQ(make_pattern(o).error().code, ErrorCode::usage);
  o.diameter = 1;
  o.direction = {0, 0, 0};
  EXPECT_EQ(make_pattern(o).error().code, ErrorCode::usage);
  o = options_of(PatternKind::noise, layout("cube"), 4);
  o.degree = 0;
  EXPECT_EQ(make_pattern(o).error().code, ErrorCode::usage);
  o = options_of(PatternKind::constant, layout("cube"), 0);
  EXPECT_EQ(make_pattern(o).error().code, ErrorCode::usage);
}

TEST(Pattern, NamesAreFound) {
  for (const PatternInfo& pattern : all_patterns()) EXPECT_EQ(find_pattern(pattern.name)->kind, pattern.kind);
  EXPECT_EQ(find_pattern("nothing"), nullptr);
}

}  // namespace
}  // namespace envconv
