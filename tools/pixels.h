// SPDX-License-Identifier: Apache-2.0
// What is done to, and counted in, the pixels of one file besides resampling.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "image.h"

namespace envconv::tool {

/// Counts over one channel of one or more images.
struct ChannelStatistics {
  float min = 0, max = 0;  ///< over the finite values; both 0 when there is none
  std::int64_t finite = 0, nan = 0, infinite = 0, negative = 0;
};
/// Adds an image's values; `totals` has one entry per channel or is empty.
void add_statistics(const Image& image, std::vector<ChannelStatistics>& totals);

/// The largest finite value of all channels but alpha; 0 when none is positive.
float largest_color(const EnvImage& image);

/// NaN and infinite values in an image.
std::int64_t count_nonfinite(const Image& image);

/// NaN becomes 0, and infinity the largest finite value of half (or of the image, if that is larger).
void clamp_nonfinite(Image& image);
/// Not finite becomes 0.
void zero_nonfinite(Image& image);
/// Not finite becomes the mean of the finite ones among the eight neighbours, from the rim of a hole inwards; 0 where
/// nothing is finite.
void repair_nonfinite(Image& image);

/// Multiplies all channels but `alpha` by `factor`.
void scale_color(Image& image, int alpha, float factor);

}  // namespace envconv::tool
