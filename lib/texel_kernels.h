// SPDX-License-Identifier: Apache-2.0
// Loops over texels as they lie in memory, compiled per SIMD target and dispatched at run time: prefilters, sums,
// ranges.
#pragma once

#include <cstddef>

#include "filter.h"

namespace envconv {

/// Rows of texels through the recursions of `filter`: 8 rows (in[k] of `width` texels) to out[k], of which only texels
/// [filter.margin, width - filter.margin) are written, from out[k] on, and up to 4 floats more.  work: room for width *
/// 32 floats.
void prefilter_rows(const Prefilter& filter, int channels, int width, const float* const in[8], float* const out[8],
                    float* work);

/// Columns likewise, in place: `rows` rows of n floats, `pitch` floats apart; n rounded up to 16 are touched.
void prefilter_columns(const Prefilter& filter, int n, int rows, std::ptrdiff_t pitch, float* texels);

/// Over a rectangle of texels: sums[c] += w v, sums[channels + c] += w |v|, sums[2 channels] += w, with values
/// v[height][width][channels], `pitch` floats from row to row, and weights w[height][width] >= 0; what has no weight
/// may be no number.  channels: 1 to 4.
void add_weighted(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
                  double* sums);

/// The same with a weight for each row: weights[height] > 0, and all values are numbers or spoil the sums.
void add_rows(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
              double* sums);

/// Lowest and highest values by channel (3 or 4) of width x height texels, `pitch` floats from row to row; what is no
/// number is left out.
void value_range(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, float low[4],
                 float high[4]);

}  // namespace envconv
