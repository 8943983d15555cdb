// SPDX-License-Identifier: Apache-2.0
// From samples to texels: the last steps of resampling, compiled per SIMD target and dispatched at run time.
#pragma once

namespace envconv {

/// out[i] = sum over k < count of weight[k] * rows[k][i], for i < n; n rounded up to 16 are touched.
void combine_rows(int n, int count, const float* weight, const float* const* rows, float* out);

/// Texels of four floats from samples of four floats: out[i][c] = sum over k < taps of weight[i % phases][k][c] *
/// in[i / phases * step + first[i % phases] + k][c], for i < n and c < 4; weight's four are all the same.
void combine_samples(int n, int phases, int step, int taps, const int* first, const float* weight, const float* in,
                     float* out);

/// What texels are divided by: of[i * step], or nothing where `of` is null.
struct Totals {
  const float* of = nullptr;
  int step = 1;
};

/// to[i][channels] = in[i][4] over its total, not below lowest[c].  Other channels of `to`, which is `stored` floats a
/// texel, are not touched.
void store_texels(int n, const float* in, const Totals& totals, const float lowest[4], int channels, int stored,
                  float* to);

}  // namespace envconv
