// SPDX-License-Identifier: Apache-2.0
// Errors between maps, on pairs whose error is known in closed form.
#include "metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <tuple>

#include "analyze.h"
#include "layout_cases.h"
#include "painted_map.h"
#include "resample.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi, infinity = std::numeric_limits<double>::infinity();
using test::paint;
using Function = test::Radiance;

EnvImage constant(const char* layout, int height, float value, int channels = 1) {
  return paint(*find_layout(layout), height, channels, [=](Vec3, float* p) { std::fill_n(p, channels, value); });
}

Comparison compared(const EnvImage& a, const EnvImage& b, const CompareOptions& options = {}) {
  Result<Comparison> result = compare_maps(a, b, options);
  EXPECT_TRUE(result.ok()) << (result.ok() ? "" : result.error().message);
  return result.ok() ? *result : Comparison{};
}

double decibels(double peak, double mse) { return 10 * std::log10(peak * peak / mse); }

class EveryLayout : public testing::TestWithParam<const Layout*> {};
std::vector<const Layout*> registered() {
  std::vector<const Layout*> all;
  for (const Layout& layout : all_layouts()) all.push_back(&layout);
  return all;
}
INSTANTIATE_TEST_SUITE_P(All, EveryLayout, testing::ValuesIn(registered()),
                         [](const auto& info) { return test::test_name(*info.param); });

TEST_P(EveryLayout, ComparedWithItselfHasNoErrorAtAll) {
  const EnvImage map = paint(*GetParam(), height_for_texels(*GetParam(), 4000), 3, [](Vec3 d, float* p) {
    p[0] = float(2 + std::sin(40 * d.x + 9 * d.y)), p[1] = float(d.y * d.y), p[2] = d.z > 0.3 ? 900.0f : 0.0f;
  });
  const Comparison c = compared(map, map);
  EXPECT_TRUE(c.same_grid);
  for (const ErrorFigures& f : {c.figures[0], c.figures[1], c.figures[2], c.total}) {
    EXPECT_EQ(f.rmse, 0);
    EXPECT_EQ(f.mae, 0);
    EXPECT_EQ(f.max_error, 0);
    EXPECT_EQ(length(f.max_error_direction), 0);
    EXPECT_EQ(f.mean_a, f.mean_b);
    for (const double psnr : {f.psnr, f.psnr_hdr, f.ws_psnr, f.s_psnr}) EXPECT_EQ(psnr, infinity);
    EXPECT_EQ(f.ssim_sphere, 1);
  }
  EXPECT_EQ(c.excluded, 0);
}

// Layout against lat-long: everything follows from the two constants.
TEST_P(EveryLayout, AConstantOffsetIsMeasuredExactly) {
  const float low = 0.5f, high = 0.75f;
  const EnvImage a = paint(*GetParam(), height_for_texels(*GetParam(), 3000), 1, [=](Vec3, float* p) { *p = low; });
  const Comparison c = compared(a, constant("latlong", 48, high), {.peak = 2});
  const ErrorFigures& f = c.total;
  EXPECT_NEAR(f.mean_a, 0.5, 1e-6);
  EXPECT_NEAR(f.mean_b, 0.75, 1e-6);
  EXPECT_NEAR(f.rmse, 0.25, 1e-6);
  EXPECT_NEAR(f.mae, 0.25, 1e-6);
  EXPECT_NEAR(f.max_error, 0.25, 1e-5);
  EXPECT_NEAR(f.psnr, 20 * std::log10(2 / 0.25), 1e-4);
  EXPECT_NEAR(f.ws_psnr, f.psnr, 1e-4);
  EXPECT_NEAR(f.s_psnr, f.psnr, 1e-4);
  const auto encoded = [](double x) { return std::log2(1024 * x + 1); };  // with black at 0
  EXPECT_NEAR(f.psnr_hdr, 20 * std::log10(encoded(2) / (encoded(0.75) - encoded(0.5))), 1e-4);
  // Without variance the similarity is that of the means.
  const double c1 = std::pow(0.01 * encoded(2), 2), x = encoded(0.5), y = encoded(0.75);
  EXPECT_NEAR(f.ssim_sphere, (2 * x * y + c1) / (x * x + y * y + c1), 1e-4);
}

// a + b.d against the same, turned: the error is (b - R b).d, whose mean square over the sphere is |b - R b|^2 / 3,
// mean magnitude |b - R b| / 2, and largest value |b - R b|, along b - R b.
TEST_P(EveryLayout, ATurnedLinearMapHasTheErrorOfTheDifferenceOfItsSlopes) {
  const Vec3 slope{0.3, 0.5, -0.2};
  const Mat3 turn = rotation_matrix({.yaw = 30, .pitch = 10, .roll = 5});
  const Vec3 difference = slope - turn * slope;
  const double size = length(difference);
  const auto linear = [](Vec3 b) { return [=](Vec3 d, float* p) { *p = float(1 + dot(b, d)); }; };
  const Layout& layout = *GetParam();
  const EnvImage a = paint(layout, height_for_texels(layout, 30000), 1, linear(slope));
  const Layout& other = *find_layout(layout.name() == "polar-capped" ? "octahedral" : "polar-capped");
  const EnvImage b = paint(other, height_for_texels(other, 30000), 1, linear(turn * slope));
  const Comparison c = compared(a, b);
  const ErrorFigures& f = c.total;
  // Bilinear reading is off by the square of a texel's angle (0.02), more at sphere maps' rims.
  const bool disc = layout.info().domain == Domain::disc && !layout.info().conformal;
  const double bound = disc ? 5e-3 : 1e-3;
  EXPECT_NEAR(f.rmse, size / std::sqrt(3.0), bound * size);
  EXPECT_NEAR(f.mae, size / 2, bound * size);
  EXPECT_NEAR(f.max_error, size, 0.02 * size);
  EXPECT_GT(std::abs(dot(f.max_error_direction, difference)) / size, 0.99);
  EXPECT_NEAR(f.mean_a, 1, 1e-3);
  EXPECT_NEAR(f.s_psnr, decibels(c.peak, size * size / 3), 0.05);
}

// The error of a smooth map against its own conversion from `texels` texels to another layout of as many.
double conversion_error(const Layout& layout, int texels) {
  const auto f = [](Vec3 d, float* p) { *p = float(2 + std::sin(3 * d.x + d.y) * std::cos(2 * d.z - d.x)); };
  const EnvImage map = paint(layout, height_for_texels(layout, texels), 1, f);
  ResampleOptions options;
  options.layout = find_layout(layout.name() == "equi-angular-cube" ? "latlong" : "equi-angular-cube");
  options.height = height_for_texels(*options.layout, texels);
  const Result<EnvImage> other = resample(map, options);
  EXPECT_TRUE(other.ok());
  return compared(map, *other).total.rmse;
}

// Reading bilinearly, and averaging over texels, both err by the square of a texel's side h, and by h itself in a band
// one texel wide where the layout has a crease: the root of the mean square then falls as h^1.5.  Rims of sphere maps,
// where texels degenerate, keep the first order only.
TEST_P(EveryLayout, ItselfInAnotherLayoutConverges) {
  const Layout& layout = *GetParam();
  const bool degenerates = layout.info().domain == Domain::disc && !layout.info().conformal;
  const double coarse = conversion_error(layout, 2000), fine = conversion_error(layout, 16 * 2000);
  EXPECT_LT(fine, degenerates ? 0.012 : 6e-3);
  EXPECT_GT(std::log(coarse / fine) / std::log(4), degenerates ? 0.9 : 1.3);
}

TEST(Convergence, IsOfSecondOrderWithoutCreases) {
  for (const char* name : {"latlong", "equi-angular-cube", "tennis-ball"}) {
    const Layout& layout = *find_layout(name);
    EXPECT_NEAR(std::log(conversion_error(layout, 6000) / conversion_error(layout, 16 * 6000)) / std::log(4), 2, 0.15)
        << name;
  }
}

// One texel of a common grid: its share of the sphere is known.
TEST(OneTexel, OnACommonGridWeighsItsSolidAngle) {
  const int height = 32, row = 5;
  const EnvImage a = constant("latlong", height, 1);
  EnvImage b = constant("latlong", height, 1);
  *b.faces[0].at(7, row) = 4;
  // 2 pi / 64 of azimuth, between two polar angles.
  const double share = (std::cos(row * pi / height) - std::cos((row + 1) * pi / height)) / (2 * 2 * height);
  const Comparison c = compared(a, b, {.peak = 1});
  EXPECT_NEAR(c.total.rmse, 3 * std::sqrt(share), 1e-6);
  EXPECT_NEAR(c.total.mae, 3 * share, 1e-8);
  EXPECT_EQ(c.total.max_error, 3);
  EXPECT_NEAR(c.total.mean_b, 1 + 3 * share, 1e-8);
  EXPECT_NEAR(c.total.psnr, decibels(1, 9 * share), 1e-4);
  EXPECT_EQ(c.total.ws_psnr, c.total.psnr);
  const double polar = pi * (row + 0.5) / height, longitude = 2 * pi * (7.5 / (2 * height) - 0.5);
  const Vec3 centre{std::sin(polar) * std::sin(longitude), std::cos(polar), std::sin(polar) * std::cos(longitude)};
  EXPECT_LT(angle_between(c.total.max_error_direction, centre), 1e-6);
}

// Read bilinearly a single texel is a tent: the mean of the tent is 1, of its square 4/9, in units of the texel.
TEST(OneTexel, BetweenGridsIsATent) {
  const int height = 64;
  const EnvImage a = constant("latlong", 48, 1);
  EnvImage b = constant("healpix", height, 1);
  *b.faces[5].at(20, 30) = 1001;
  const double share = 1 / (12.0 * height * height);
  const ErrorFigures f = compared(a, b).total;
  EXPECT_NEAR(f.mae / (1000 * share), 1, 5e-3);
  EXPECT_NEAR(f.rmse / (1000 * std::sqrt(share * 4 / 9)), 1, 2e-3);
  EXPECT_NEAR(f.max_error, 1000, 0.1);
  const Layout& healpix = *find_layout("healpix");
  EXPECT_LT(angle_between(f.max_error_direction, healpix.direction(5, 20.5 / height, 30.5 / height)), 1e-4);
  // A sun of one texel of a large map, so that ordinary points are few: the integral is sure all the same.
  EnvImage large = constant("healpix", 512, 1);
  *large.faces[2].at(100, 400) = 100001;
  const ErrorFigures sun = compared(a, large).total;
  EXPECT_NEAR(sun.rmse / (100000 * std::sqrt(4.0 / 9 / (12.0 * 512 * 512))), 1, 3e-3);
}

// Sun, Lu & Yu 2017, equations 3 to 5: w = cos((j + 0.5 - N/2) pi / N).
TEST(WsPsnr, AgreesWithThePaperOnASmallLatLong) {
  const int n = 4;
  EnvImage a = constant("latlong", n, 0), b = constant("latlong", n, 0);
  double sum = 0, weights = 0;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < 2 * n; ++i) {
      const double w = std::cos((j + 0.5 - n / 2.0) * pi / n), error = 0.01 * (1 + i) * (1 + j);
      *b.faces[0].at(i, j) = float(error);
      sum += w * double(float(error)) * double(float(error));
      weights += w;
    }
  EXPECT_NEAR(compared(a, b, {.peak = 1}).total.ws_psnr, decibels(1, sum / weights), 1e-5);
  // 8 bits: the errors above are 1 to 32 hundredths; by hand, E[e^2] = 1e-4 * 25.5 * 6.2071068 (rows weigh
  // cos 67.5 : cos 22.5, so E[(1+j)^2] = (1 * .38268 + 4 * .92388 + 9 * .92388 + 16 * .38268) / 2.61313).
  EXPECT_NEAR(sum / weights, 1e-4 * 25.5 * (17 * 0.3826834 + 13 * 0.9238795) / 2.6131259, 1e-8);
}

// On a's grid, with b read there: b's texels at other places count only through their values at a's centres.
TEST(WsPsnr, IsTakenOnTheGridOfA) {
  const auto linear = [](Vec3 d, float* p) { *p = float(d.y); };
  const EnvImage a = constant("latlong", 4, 0), b = paint(*find_layout("octahedral"), 512, 1, linear);
  double sum = 0, weights = 0;
  for (int j = 0; j < 4; ++j) {
    const double w = std::cos((j + 0.5 - 2) * pi / 4), y = std::cos((j + 0.5) * pi / 4);
    sum += w * y * y, weights += w;
  }
  EXPECT_NEAR(compared(a, b, {.peak = 1}).total.ws_psnr, decibels(1, sum / weights), 1e-3);
}

TEST(SPsnr, PointsAreTheIcosahedronsAfterEightBisections) {
  const std::vector<Vec3>& points = s_psnr_points();
  ASSERT_EQ(points.size(), 655362u);  // Yu, Lakshman & Girod's number
  Vec3 sum{0, 0, 0};
  double xx = 0, yy = 0, xy = 0;
  for (const Vec3& d : points) {
    ASSERT_NEAR(length(d), 1, 1e-12);
    sum = sum + d;
    xx += d.x * d.x, yy += d.y * d.y, xy += d.x * d.y;
  }
  const double n = double(points.size());
  EXPECT_LT(length(sum) / n, 1e-12);  // the icosahedron is symmetric
  std::vector<Vec3> sorted = points;
  std::ranges::sort(sorted, {}, [](const Vec3& d) { return std::tuple(d.x, d.y, d.z); });
  for (std::size_t i = 1; i < sorted.size(); ++i) ASSERT_GT(length(sorted[i] - sorted[i - 1]), 1e-9);
  EXPECT_NEAR(xx / n, 1.0 / 3, 1e-12);
  EXPECT_NEAR(yy / n, 1.0 / 3, 1e-12);
  EXPECT_NEAR(xy / n, 0, 1e-12);
}

// A cube of one texel a face: every point is in the face of its largest component.
TEST(SPsnr, TakesTheNearestTexel) {
  const EnvImage a = constant("cube", 1, 0);
  EnvImage b = constant("cube", 1, 0);
  for (int f = 0; f < 6; ++f) *b.faces[std::size_t(f)].at(0, 0) = float(f + 1);
  double sum = 0;
  std::size_t ties = 0;
  for (const Vec3& d : s_psnr_points()) {
    const double x = std::abs(d.x), y = std::abs(d.y), z = std::abs(d.z);
    const double most = std::max({x, y, z});
    ties += (most - x < 1e-9) + (most - y < 1e-9) + (most - z < 1e-9) > 1;
    const int face = most == x ? (d.x < 0) : most == y ? 2 + (d.y < 0) : 4 + (d.z < 0);
    sum += (face + 1) * (face + 1);
  }
  const double mse = sum / double(s_psnr_points().size());
  EXPECT_NEAR(mse, 91.0 / 6, 0.01);
  EXPECT_NEAR(compared(a, b, {.peak = 6}).total.s_psnr, decibels(6, mse), 1e-3 + 40 * double(ties) / 655362);
}

TEST(Ssim, FallsWithContrastAsItsFormulaSays) {
  // White noise against itself with half the contrast, in log-encoded values around the same mean: the structure is the
  // same, and what is left is that of the contrasts.  Bilinear reading keeps 4/9 of white noise's variance.
  const double peak = 1.0 / 1024, c2 = 0.03 * 0.03;  // log2(1024 peak + 1) = 1
  const auto decoded = [](double e) { return float((std::exp2(e) - 1) / 1024); };
  test::RandomDirections random(3);
  EnvImage a = constant("healpix", 64, 0), b = constant("healpix", 64, 0), other = constant("healpix", 64, 0);
  for (std::size_t f = 0; f < 12; ++f)
    for (std::size_t i = 0; i < a.faces[f].pixel_count(); ++i) {
      const double e = random.uniform() - 0.5;
      a.faces[f].data()[i] = decoded(10 + e);
      b.faces[f].data()[i] = decoded(10 + e / 2);
      other.faces[f].data()[i] = decoded(10 + random.uniform() - 0.5);
    }
  const double variance = 4.0 / 9 / 12;
  const double ssim = compared(a, b, {.peak = peak}).total.ssim_sphere;
  EXPECT_NEAR(ssim, (variance + c2) / (1.25 * variance + c2), 0.01);
  EXPECT_NEAR(compared(b, a, {.peak = peak}).total.ssim_sphere, ssim, 1e-12);  // symmetric
  // Noise against other noise has no structure in common.
  EXPECT_LT(compared(a, other, {.peak = peak}).total.ssim_sphere, 0.1);
}

TEST(Totals, PoolTheColoursAndLeaveAlphaOut) {
  EnvImage a = constant("latlong", 16, 0, 4), b = constant("latlong", 16, 0, 4);
  for (std::size_t i = 0; i < b.faces[0].pixel_count(); ++i) {
    float* p = b.faces[0].data() + 4 * i;
    p[0] = 0.3f, p[1] = 0.4f, p[3] = 100;
  }
  const Comparison c = compared(a, b, {.peak = 1});
  EXPECT_NEAR(c.figures[0].rmse, 0.3, 1e-6);
  EXPECT_NEAR(c.figures[3].rmse, 100, 1e-3);
  EXPECT_NEAR(c.total.rmse, std::sqrt((0.09 + 0.16) / 3), 1e-6);
  EXPECT_NEAR(c.total.mae, 0.7 / 3, 1e-6);
  EXPECT_NEAR(c.total.max_error, 0.4, 1e-6);
  EXPECT_NEAR(c.total.mean_b, 0.7 / 3, 1e-6);
}

TEST(Channels, AreMatchedByName) {
  EnvImage a = constant("latlong", 16, 0, 3), b = constant("cube", 8, 0, 4);
  a.channels.names = {"B", "depth", "R"};
  for (std::size_t i = 0; i < a.faces[0].pixel_count(); ++i) a.faces[0].data()[3 * i + 2] = 0.5f;  // R
  const Comparison c = compared(a, b);
  EXPECT_EQ(c.channels, (std::vector<std::string>{"B", "R"}));
  EXPECT_EQ(c.only_in_a, (std::vector<std::string>{"depth"}));
  EXPECT_EQ(c.only_in_b, (std::vector<std::string>{"G", "A"}));
  EXPECT_EQ(c.figures[0].rmse, 0);
  EXPECT_NEAR(c.figures[1].rmse, 0.5, 1e-6);
  EXPECT_FALSE(compare_maps(constant("cube", 4, 0, 1), constant("cube", 4, 0, 3), {}).ok());
  EXPECT_FALSE(compare_maps({}, constant("cube", 4, 0, 3), {}).ok());
}

TEST(Peak, OfFloatsIsTheLargestColourOfA) {
  EnvImage a = constant("latlong", 16, 0.25f, 4);
  a.faces[0].at(3, 3)[1] = 40;
  a.faces[0].at(4, 3)[3] = 90;  // alpha
  a.faces[0].at(5, 3)[0] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(compared(a, constant("latlong", 16, 1, 4)).peak, 40);
  EXPECT_EQ(compared(constant("latlong", 16, 0, 4), constant("latlong", 16, 1, 4)).peak, 1);
}

TEST(Nonfinite, IsCountedAndLeftOut) {
  const float nan = std::nanf("");
  EnvImage a = constant("healpix", 32, 1, 3), b = constant("healpix", 32, 2, 3);
  a.faces[0].at(3, 4)[0] = nan;
  b.faces[7].at(1, 1)[2] = std::numeric_limits<float>::infinity();
  b.faces[7].at(2, 1)[1] = nan;
  const Comparison c = compared(a, b);
  EXPECT_EQ(c.nonfinite_a, 1);
  EXPECT_EQ(c.nonfinite_b, 2);
  EXPECT_NEAR(c.excluded, 3 / (12.0 * 32 * 32), 1e-9);
  EXPECT_NEAR(c.total.rmse, 1, 1e-6);
  EXPECT_NEAR(c.total.mean_b, 2, 1e-6);
  EXPECT_TRUE(std::isfinite(c.total.ssim_sphere) && std::isfinite(c.total.s_psnr));
  // Between grids a texel spoils the four cells that are read from it.
  const Comparison d = compared(a, constant("latlong", 64, 2, 3));
  EXPECT_NEAR(d.excluded, 4 / (12.0 * 32 * 32), 1e-5);
  EXPECT_NEAR(d.total.rmse, 1, 1e-5);
  // Nothing but NaN: no figure at all.
  const Comparison none = compared(constant("cube", 4, nan), constant("cube", 4, 1));
  EXPECT_EQ(none.excluded, 1);
  for (const double figure : {none.total.rmse, none.total.psnr, none.total.max_error, none.total.ssim_sphere,
                              none.total.s_psnr, none.total.mean_a})
    EXPECT_TRUE(std::isnan(figure));
  // What a layout does not own may hold anything: the corners of a disc.
  EnvImage disc = constant("angular-map", 32, 1);
  *disc.faces[0].at(0, 0) = nan;
  EXPECT_EQ(compared(disc, constant("cube", 8, 1)).nonfinite_a, 0);
}

TEST(Frames, AreUndone) {
  const auto f = [](Vec3 d, float* p) { p[0] = float(d.x), p[1] = float(d.y), p[2] = float(d.z); };
  const EnvImage a = paint(*find_layout("octahedral"), 128, 3, f);
  const EnvImage b = paint(*find_layout("octahedral"), 128, 3, f, find_frame("blender")->consumer_from_world);
  const Comparison c = compared(a, b);
  EXPECT_FALSE(c.same_grid);
  EXPECT_LT(c.total.rmse, 2e-3);
}

TEST(Threads, DoNotChangeTheResult) {
  test::RandomDirections random(9);
  EnvImage a = constant("cube", 24, 0, 3), b = constant("octahedral", 60, 0, 3);
  for (EnvImage* map : {&a, &b})
    for (Image& face : map->faces)
      for (std::size_t i = 0; i < face.value_count(); ++i) face.data()[i] = float(std::pow(random.uniform(), 8) * 100);
  const Comparison one = compared(a, b, {.threads = 1}), two = compared(a, b, {.threads = 2});
  for (std::size_t i = 0; i < 4; ++i) {
    const ErrorFigures &f = i < 3 ? one.figures[i] : one.total, &g = i < 3 ? two.figures[i] : two.total;
    for (const auto figure : {&ErrorFigures::mean_a, &ErrorFigures::mean_b, &ErrorFigures::rmse, &ErrorFigures::mae,
                              &ErrorFigures::max_error, &ErrorFigures::psnr, &ErrorFigures::psnr_hdr,
                              &ErrorFigures::ws_psnr, &ErrorFigures::s_psnr, &ErrorFigures::ssim_sphere})
      EXPECT_EQ(f.*figure, g.*figure);
    EXPECT_EQ(f.max_error_direction.x, g.max_error_direction.x);
  }
}

// The error is |y|: by latitude it is its sine, and the share of the sphere with |y| in [p, q] is q - p.
TEST(Profile, FollowsAKnownError) {
  const EnvImage a = constant("latlong", 512, 0);
  const EnvImage b = paint(*find_layout("latlong"), 512, 1, [](Vec3 d, float* p) { *p = float(d.y); });
  const Result<ErrorProfile> profile = error_profile(a, b, 0);
  ASSERT_TRUE(profile.ok());
  ASSERT_EQ(profile->rmse_by_latitude.size(), std::size_t(ErrorProfile::bands));
  for (int i = 0; i < ErrorProfile::bands; ++i) {
    const double latitude = (90 - 2 * (i + 0.5)) * pi / 180;
    EXPECT_NEAR(profile->rmse_by_latitude[std::size_t(i)], std::abs(std::sin(latitude)), 0.012) << i;
  }
  ASSERT_EQ(profile->edges.size(), profile->share.size() + 1);
  double sum = profile->equal_share;
  for (std::size_t i = 0; i < profile->share.size(); ++i) {
    const double low = profile->edges[i], high = std::min(1.0, profile->edges[i + 1]);
    if (low > 0.01 && low < 0.99) {
      EXPECT_NEAR(profile->share[i], high - low, 0.002) << low;
    }
    sum += profile->share[i];
  }
  EXPECT_NEAR(sum, 1, 1e-9);
  const Result<ErrorProfile> none = error_profile(a, a, 0);
  EXPECT_EQ(none->equal_share, 1);
  EXPECT_TRUE(none->share.empty());
}

TEST(ErrorMap, ShowsTheErrorWhereItIs) {
  const EnvImage a = constant("cube", 64, 0, 3);
  const EnvImage b = paint(*find_layout("latlong"), 128, 3, [](Vec3 d, float* p) {
    p[0] = float(d.y), p[1] = float(2 * d.y), p[2] = float(-2 * d.y);  // root of the mean square: |y| sqrt 3
  });
  const Layout& layout = *find_layout("angular-map");
  const Result<EnvImage> map = error_map(a, b, layout, 48, 0);
  ASSERT_TRUE(map.ok());
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 48; ++x) {
      const double u = (x + 0.5) / 48, v = (y + 0.5) / 48, r = std::hypot(2 * u - 1, 2 * v - 1);
      const float error = *map->faces[0].at(x, y);
      if (r > 1) {
        EXPECT_EQ(error, -1);
      } else if (r < 0.9) {
        EXPECT_NEAR(double(error), std::sqrt(3.0) * std::abs(layout.direction(0, u, v).y), 0.05);
      }
    }
}

}  // namespace
}  // namespace envconv
