// SPDX-License-Identifier: Apache-2.0
// Environments of a handful of texels: aprons wider than faces, every texel on a seam, one texel for half the sphere.
// Nobody needs good pictures of them, but they must come out finite, bounded, and the same every time.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "analyze.h"
#include "layout_cases.h"
#include "resample.h"
#include "sampler.h"

namespace envconv {
namespace {

constexpr int heights[] = {1, 2, 3, 5};
constexpr const char* filters[] = {"auto", "nearest", "bilinear", "lanczos", "box", "gaussian"};

constexpr float constant = 0.3f, lowest = 0.25f, highest = 2.0f;

// Channel 0 is constant, 1 is noise, 2 is noise of both signs, 3 is opaque.
EnvImage noise(const Layout& layout, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(lowest, highest);
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = Channels::standard(4);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    Image face(size.width, size.height, 4);
    for (std::size_t i = 0; i < face.pixel_count(); ++i) {
      float* p = face.data() + 4 * i;
      p[0] = constant, p[1] = uniform(random), p[2] = uniform(random) - 1, p[3] = 1;
    }
    image.faces.push_back(std::move(face));
  }
  return image;
}

EnvImage convert(const EnvImage& source, const Layout& layout, int height, const char* filter) {
  ResampleOptions options;
  options.layout = &layout;
  options.height = height;
  options.placement = layout.info().placement;
  options.rotation = {.yaw = 20, .pitch = -30, .roll = 5};
  options.filter = find_filter(filter);
  options.threads = 1;  // the work is less than that of sharing it
  Result<EnvImage> out = resample(source, options);
  EXPECT_TRUE(out.ok()) << (out.ok() ? "" : out.error().message);
  return out.ok() ? std::move(*out) : EnvImage();
}

class Tiny : public testing::TestWithParam<const Layout*> {};
std::vector<const Layout*> registered() {
  std::vector<const Layout*> all;
  for (const Layout& layout : all_layouts()) all.push_back(&layout);
  return all;
}
INSTANTIATE_TEST_SUITE_P(All, Tiny, testing::ValuesIn(registered()),
                         [](const auto& info) { return test::test_name(*info.param); });

// Kernels with negative lobes overshoot, and so do aprons, which are read with one.
constexpr float beyond = highest - lowest;

// Every source of every height with every target; the target's heights and the filters take turns.
TEST_P(Tiny, ConversionsAreFiniteBoundedAndKeepConstants) {
  unsigned turn = 0;
  for (const int height : heights) {
    const EnvImage source = noise(*GetParam(), height, 1);
    for (const Layout& target : all_layouts()) {
      const char* filter = filters[turn % std::size(filters)];
      const int out_height = heights[turn / std::size(filters) % std::size(heights)];
      turn += 5;  // has no divisor with either in common
      SCOPED_TRACE(testing::Message() << height << " to " << target.name() << " " << out_height << ", " << filter);
      const EnvImage out = convert(source, target, out_height, filter);
      for (const Image& face : out.faces)
        for (std::size_t i = 0; i < face.pixel_count(); ++i) {
          const float* p = face.data() + 4 * i;
          ASSERT_NEAR(p[0], constant, 1e-6f) << i;
          ASSERT_GE(p[1], lowest - beyond) << i;
          ASSERT_LE(p[1], highest + beyond) << i;
          ASSERT_GE(p[2], lowest - 1 - beyond) << i;
          ASSERT_LE(p[2], highest - 1 + beyond) << i;
          ASSERT_NEAR(p[3], 1, 4e-6f) << i;
        }
    }
  }
}

// A sun far brighter than all the rest together.  One texel of so few may be no highlight, and then its energy depends
// on the kernel.
TEST_P(Tiny, HighlightsAreFiniteAndPositive) {
  unsigned turn = 0;
  for (const int height : heights) {
    EnvImage source = noise(*GetParam(), height, 2);
    for (Image& face : source.faces)
      for (std::size_t i = 0; i < face.pixel_count(); ++i) face.data()[4 * i + 2] = 0.5f;
    Image& sunny = source.faces.back();
    const int x = sunny.width() / 2, y = sunny.height() / 2;  // owned in every layout
    for (int c = 0; c < 3; ++c) sunny.at(x, y)[c] = 1e4f;
    const std::vector<double> before = mean_radiance(source);
    for (const Layout& target : all_layouts()) {
      if (++turn % 3 != 0) continue;
      const int out_height = heights[turn / 3 % std::size(heights)];
      SCOPED_TRACE(testing::Message() << height << " to " << target.name() << " " << out_height);
      const EnvImage out = convert(source, target, out_height, "auto");
      for (const Image& face : out.faces)
        for (std::size_t i = 0; i < face.value_count(); ++i) {
          ASSERT_TRUE(std::isfinite(face.data()[i])) << i;
          ASSERT_GE(face.data()[i], 0) << i;
        }
      const std::vector<double> after = mean_radiance(out);
      for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(after[c], 5 * before[c]) << c;
    }
  }
}

// Directions on axes, edges and corners, and footprints from none to the whole sphere and beyond.
TEST_P(Tiny, SamplesAreFiniteAndBounded) {
  for (const int height : heights) {
    const EnvImage source = noise(*GetParam(), height, 3);
    for (const char* filter : filters) {
      const Result<Sampler> sampler = Sampler::make(source, *find_filter(filter));
      ASSERT_TRUE(sampler.ok());
      for (const Vec3 d : {Vec3{1, 0, 0}, {0, 1, 0}, {-0.0, -1, 0}, {0, 0, 1}, {0, 0, -1}, {1, -1, 1}, {-0.5, 0, -0.5}})
        for (const double side : {0.0, 1e-3, 0.7, 1e9}) {
          const Vec3 du = normalize(cross(d, {0.3, -0.8, 0.4})), dv = normalize(cross(d, du));
          float p[4];
          sampler->radiance(d, side * du, std::min(side, 0.1) * dv, p);
          ASSERT_NEAR(p[0], constant, 1e-6f) << filter << " " << height << ": " << side;
          ASSERT_NEAR(p[1], 0.5f * (lowest + highest), 1.5f * beyond) << filter << " " << height << ": " << side;
        }
    }
  }
}

}  // namespace
}  // namespace envconv
