// SPDX-License-Identifier: Apache-2.0
// What tests of files share: a folder, pictures to write, and how far apart two of them are.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "io.h"
#include "temporary_folder.h"

namespace envconv {

class Io : public testing::Test, protected TemporaryFolder {
 protected:
  static void SetUpTestSuite() {
    // The module lies in the build's folder, which need not be next to the tests.
    ::setenv("ENVCONV_MODULE_PATH", ENVCONV_BUILD, 0);
    start_isolated_reader();
  }
  static int files_in(const std::filesystem::path& folder) {
    return static_cast<int>(
        std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator()));
  }
};

// Smooth values in [low, high] and some noise; alpha, if any, between 0.2 and 1, colour associated with it.
inline Picture make(int width, int height, int channels, float low = 0, float high = 1, unsigned seed = 1) {
  Picture picture;
  picture.channels = Channels::standard(channels);
  picture.image = Image(width, height, channels);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> noise(0, 0.1f);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float* to = picture.image.at(x, y);
      for (int c = 0; c < channels; ++c) {
        const float wave = 0.45f + 0.2f * std::sin(0.11f * x + c) + 0.2f * std::cos(0.07f * y + c) + noise(random);
        to[c] = low + (high - low) * wave;
      }
      if (const int a = picture.channels.alpha; a >= 0) {
        to[a] = 0.2f + 0.8f * static_cast<float>(x) / width;
        for (int c = 0; c < channels; ++c) {
          if (c != a) to[c] *= to[a];
        }
      }
    }
  }
  return picture;
}

inline std::vector<Picture> one(Picture picture) {
  std::vector<Picture> pictures;
  pictures.push_back(std::move(picture));
  return pictures;
}

inline double srgb(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }

// The largest difference, in the given measure.
template <class F>
double worst(const Image& a, const Image& b, F&& measure) {
  EXPECT_EQ(a.width(), b.width());
  EXPECT_EQ(a.height(), b.height());
  EXPECT_EQ(a.channels(), b.channels());
  if (a.value_count() != b.value_count()) return INFINITY;
  double result = 0;
  for (std::size_t i = 0; i < a.value_count(); ++i) {
    const double d = measure(a.data()[i], b.data()[i]);
    result = std::isnan(d) ? INFINITY : std::max(result, d);
  }
  return result;
}

inline double relative(float a, float b) { return std::abs(a - b) / std::max(std::abs(a), 1e-6f); }

}  // namespace envconv
