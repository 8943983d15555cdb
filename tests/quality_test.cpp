// SPDX-License-Identifier: Apache-2.0
// The default filter against the truth: signals whose means over every texel's footprint are known (bench/analytic.h).
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "bench/analytic.h"

namespace envconv {
namespace {

using bench::Rgb;

const Layout& layout(const char* name) { return *find_layout(name); }

EnvImage resampled(const EnvImage& source, const Layout& target, int height, int samples = 0) {
  ResampleOptions options;
  options.layout = &target;
  options.height = height;
  options.samples = samples;
  Result<EnvImage> out = resample(source, options);
  EXPECT_TRUE(static_cast<bool>(out));
  return std::move(*out);
}

Rgb quality_of(const EnvImage& out, const bench::Signal& signal, const bench::Chosen& chosen = {}) {
  const bench::Estimate estimates[] = {bench::estimate_of(out)};
  return bench::quality(*out.layout, out.height(), signal, estimates, 1e4, chosen).front();
}

struct Ratio {
  int source, target;  // heights of a lat-long and of a cube
  Rgb least;           // dB
};
void PrintTo(const Ratio& r, std::ostream* out) { *out << r.source << " to " << r.target; }

class Quality : public testing::TestWithParam<Ratio> {};

// Waves up to the cube's Nyquist limit, the same up to half of it, and zone plates to 0.6 of the source's limit.
// Bilinear and bicubic reads, once a texel, stay below 53 dB in R and G (bench/QUALITY.md).
TEST_P(Quality, FootprintsOfEverySizeAreIntegrated) {
  const auto& [source, target, least] = GetParam();
  const Layout &latlong = layout("latlong"), &cube = layout("cube");
  for (const unsigned seed : {1u, 2u}) {
    const bench::Signal signal(bench::nyquist(cube, target), 0.6 * bench::nyquist(latlong, source), seed);
    const Rgb psnr = quality_of(resampled(paint(latlong, source, signal), cube, target), signal);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_GE(psnr[c], least[c]) << "RGB"[c] << " of seed " << seed;
  }
}
INSTANTIATE_TEST_SUITE_P(Ratios, Quality,
                         testing::Values(Ratio{512, 256, {78, 96, 43}}, Ratio{512, 205, {90, 96, 43}},
                                         Ratio{512, 160, {90, 96, 43}}, Ratio{512, 128, {90, 96, 43}},
                                         Ratio{512, 102, {90, 96, 45}}, Ratio{512, 64, {90, 96, 54}},
                                         Ratio{1024, 64, {90, 96, 56}}, Ratio{1024, 32, {90, 96, 56}}));

// Seams of either layout, and poles, cost nothing.  R and G only: the zone plates are finest where a cube has seams.
TEST(QualityAtSeams, IsAsElsewhere) {
  constexpr double near = 12;  // texels
  constexpr int source = 512, target = 256;
  const Layout &latlong = layout("latlong"), &cube = layout("cube");
  const bench::Signal signal(bench::nyquist(cube, target), 0.6 * bench::nyquist(latlong, source));
  const EnvImage out = resampled(paint(latlong, source, signal), cube, target);
  const auto at_source = [&](Vec3 d) { return bench::near_seam(latlong, source, d, near); };
  const auto at_target = [&](Vec3 d) { return bench::near_seam(cube, target, d, near); };
  const Rgb elsewhere = quality_of(out, signal, [&](Vec3 d) { return !at_source(d) && !at_target(d); });
  for (const Rgb& there : {quality_of(out, signal, at_source), quality_of(out, signal, at_target)}) {
    EXPECT_GE(there[0], elsewhere[0] - 1);
    EXPECT_GE(there[1], elsewhere[1] - 6);
  }
}

// Nor do lines along which the output's own map bends: samples beyond them see waves that are none.
TEST(QualityAtCreases, IsAsElsewhere) {
  constexpr int source = 512;
  const Layout& latlong = layout("latlong");
  // Directions within so many texels of one of the layout's creases.
  const auto by_crease = [](const Layout& target, int height, Vec3 d) {
    const Location at = target.locate(d);
    const double a = std::abs(at.u - 0.5) * height, b = std::abs(at.v - 0.5) * height, half = 0.5 * height;
    constexpr double near = 6;
    if (target.name() == "isocube") return (at.face == 2 || at.face == 3) && std::abs(a - b) < near;
    return std::min({a, b, std::abs(a + b - half)}) < near;
  };
  for (const auto& [name, height] : {std::pair("octahedral", 624), std::pair("isocube", 256)}) {
    const Layout& target = layout(name);
    const bench::Signal signal(bench::nyquist(target, height), 0.6 * bench::nyquist(latlong, source));
    for (const int samples : {0, 2}) {
      const EnvImage out = resampled(paint(latlong, source, signal), target, height, samples);
      const Rgb there = quality_of(out, signal, [&](Vec3 d) { return by_crease(target, height, d); });
      const Rgb elsewhere = quality_of(out, signal, [&](Vec3 d) { return !by_crease(target, height, d); });
      EXPECT_GE(there[0], elsewhere[0] - 1) << name << ", samples " << samples;
      EXPECT_GE(there[1], elsewhere[1] - 6) << name << ", samples " << samples;
    }
  }
}

// A sinc under a Kaiser window through a lat-long's texels, which are painted beyond its edges where the formula goes
// on.
class WindowedSinc {
 public:
  template <class Value>
  WindowedSinc(const Layout& latlong, int height, const Value& value)
      : latlong_(latlong), height_(height), pitch_(2 * height + 2 * taps) {
    for (int y = -taps; y < height + taps; ++y)
      for (int x = -taps; x < 2 * height + taps; ++x)
        texels_.push_back(value(latlong.direction(0, (x + 0.5) / (2 * height), (y + 0.5) / height)));
  }
  Rgb operator()(Vec3 d) const {
    const Location at = latlong_.locate(d);
    const double x = at.u * 2 * height_ - 0.5, y = at.v * height_ - 0.5;
    const int left = static_cast<int>(std::floor(x)) - taps / 2 + 1,
              top = static_cast<int>(std::floor(y)) - taps / 2 + 1;
    double across[taps], down[taps];
    weights(x - left, across), weights(y - top, down);
    Rgb sum{};
    for (int j = 0; j < taps; ++j)
      for (int i = 0; i < taps; ++i) {
        const Rgb& texel = texels_[static_cast<std::size_t>((top + j + taps) * pitch_ + left + i + taps)];
        for (std::size_t c = 0; c < 3; ++c) sum[c] += down[j] * across[i] * texel[c];
      }
    return sum;
  }

 private:
  static constexpr int taps = 16;
  // The modified Bessel function by its power series, for |x| < 9: the standard library's writes to lgamma's global.
  static double bessel_i0(double x) {
    double sum = 1, term = 1;
    for (int k = 1; k < 40; ++k) term *= 0.25 * x * x / (k * k), sum += term;
    return sum;
  }
  // Of taps at 0, 1 ... for a sample at x.
  static void weights(double x, double (&w)[taps]) {
    double sum = 0;
    for (int k = 0; k < taps; ++k) {
      const double t = k - x, r = t / (taps / 2);
      const double sinc = std::abs(t) < 1e-12 ? 1.0 : std::sin(M_PI * t) / (M_PI * t);
      sum += w[k] = std::abs(r) < 1 ? sinc * bessel_i0(8.5 * std::sqrt(1 - r * r)) : 0;
    }
    for (double& v : w) v /= sum;
  }
  const Layout& latlong_;
  int height_, pitch_;
  std::vector<Rgb> texels_;
};

// Of the sinc over the footprints of a picture's texels.
bench::Estimate integral_of(const WindowedSinc& sinc, const EnvImage& out) {
  return [&sinc, &out, nodes = bench::footprint_nodes(6)](int f, int x, int y) {
    return bench::footprint_mean(*out.layout, f, x, y, face_size(*out.layout, f, out.height()), out.placement, nodes,
                                 sinc);
  };
}

// Of waves up to 0.8 of the source's limit, and up to 0.4 of it.
TEST(QualityOfGrowing, IsThatOfAWindowedSinc) {
  constexpr int source = 128, target = 256;
  const Layout &latlong = layout("latlong"), &cube = layout("cube");
  const double limit = 0.8 * bench::nyquist(latlong, source);
  const bench::Signal signal(limit, limit);
  const WindowedSinc sinc(latlong, source, signal);
  const EnvImage out = resampled(paint(latlong, source, signal), cube, target);
  const bench::Estimate estimates[] = {bench::estimate_of(out), integral_of(sinc, out)};
  const std::vector<Rgb> psnr = bench::quality(cube, target, signal, estimates, 3e3);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_GE(psnr[0][c], psnr[1][c] - 1) << "RGB"[c];
}

// Half of the source's size; waves up to the output's limit, and up to half of it.
TEST(QualityOfManySamples, IsThatOfAWindowedSinc) {
  constexpr int source = 256, target = 128;
  const Layout &latlong = layout("latlong"), &cube = layout("cube");
  const bench::Signal signal(bench::nyquist(cube, target), 0.6 * bench::nyquist(latlong, source));
  const WindowedSinc sinc(latlong, source, signal);
  const EnvImage out = resampled(paint(latlong, source, signal), cube, target, 2);
  const bench::Estimate estimates[] = {bench::estimate_of(out), integral_of(sinc, out)};
  const std::vector<Rgb> psnr = bench::quality(cube, target, signal, estimates, 3e3);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_GE(psnr[0][c], psnr[1][c] - 3) << "RGB"[c];
}

}  // namespace
}  // namespace envconv
