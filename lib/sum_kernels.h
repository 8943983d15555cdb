// SPDX-License-Identifier: Apache-2.0
// Weighted sums over windows of texels, compiled per SIMD target and dispatched at run time.
#pragma once

#include <cstddef>

#include "window_kernels.h"

namespace envconv {

/// out[i][4] = weighted sum over window i of `channels` (3 or 4) floats a texel; the fourth of three channels is
/// weight[i], the one that was given to make_windows().  Loads reach up to 16 floats past a window's row.  ahead:
/// floats from each window's first to what Kernel::drooping will read some rows of samples later, to be fetched
/// meanwhile.
void sum_windows(Kernel kernel, int channels, int n, const Windows& windows, const float* weight, float* out,
                 std::ptrdiff_t ahead = 0);

/// A window of sinc_taps x sinc_taps texels around a place: its first texel, floats from row to row, and how far right
/// of and below the window's fourth column and row the place lies: [0, 1].
struct SincWindow {
  const float* first;
  std::ptrdiff_t pitch;
  float fx, fy;
};
inline constexpr int sinc_taps = 8;

/// out[i][4] = what stands at window i's place by a sinc under a Kaiser window (beta 7.5), from `channels` (3 or 4)
/// floats a texel; of three channels the fourth is 0.  Loads reach up to 16 floats past a window's row.
void interpolate_sinc(int channels, int n, const SincWindow* windows, float* out);

}  // namespace envconv
