// SPDX-License-Identifier: Apache-2.0
// From samples' directions to the windows of texels that they read: loops compiled per SIMD target and dispatched at
// run time.
//
// Reading goes in steps over batches of samples: face points to windows of taps (make_windows), windows to memory (the
// caller's: an image, a strip, a block), weighted sums over the windows (sum_windows in sum_kernels.h).
#pragma once

#include <cstddef>
#include <cstdint>

#include "filter.h"

namespace envconv {

inline constexpr int most_faces = 64;
inline constexpr int most_taps = 7;
inline constexpr int most_samples = 1104;  ///< of one batch
inline constexpr int batch_room = most_samples + 16;

/// Affine maps by face from (u, v) to texels, in tables that SIMD lanes can gather from.
struct FaceMaps {
  float scale_u[most_faces], bias_u[most_faces], scale_v[most_faces], bias_v[most_faces];
};

/// Where samples lie and what their taps weigh.  Arrays by sample.
struct Windows {
  alignas(64) std::int32_t x[batch_room], y[batch_room];  ///< texel of the tap that taps_before() counts up to
  alignas(64) float fx[batch_room], fy[batch_room];       ///< from that texel: [0, 1), or [-1/2, 1/2] when taps are odd
  /// Weights of taps 0 to 3 and 4 to 7 along a row; those of absent taps are 0.
  alignas(64) float wx[2][batch_room * 4];
  /// Weights of taps along a column, by tap; they carry the sample's weight.
  alignas(64) float wy[most_taps][batch_room];
  /// Each window's first tap, and floats from row to row: by point_windows().
  const float* first[batch_room];
  std::ptrdiff_t pitch[batch_room];
};

/// A rectangle of texels in memory, by the texels that the windows inside of it may be about.
struct WindowField {
  int left, top, right, bottom;  ///< of Windows::x and y: [left, right) x [top, bottom)
  const float* origin;           ///< of the window about (0, 0), were it there
  std::ptrdiff_t pitch;          ///< floats from row to row
};

/// A sample's bilinear place: the texel left of and above it, and fractions in [0, 1).
struct Place {
  int x, y;
  float fx, fy;
};
inline Place place_of(const Windows& windows, int s) {
  Place p{windows.x[s], windows.y[s], windows.fx[s], windows.fy[s]};
  if (p.fx < 0) --p.x, p.fx += 1.0f;  // around the nearest texel, for an odd number of taps
  if (p.fy < 0) --p.y, p.fy += 1.0f;
  return p;
}

/// Samples (face, u, v)[n] to windows; weight: of each sample.  Arrays have room for n rounded up to 16.
void make_windows(const FaceMaps& maps, Kernel kernel, int n, const float* face, const float* u, const float* v,
                  const float* weight, Windows& windows);

/// A row of samples by polynomials of fourth degree: texel x + sum over k of to_x[k] s^k, and the same for y; not
/// beyond left, right ... of (x, y).
struct RowMap {
  std::int32_t x, y;
  float left, right, top, bottom;
  float to_x[5], to_y[5];
};

/// The windows of samples [begin, begin + n) of a batch, at s = first, first + step ...; up to 16 after them are
/// touched.  weight: of each sample of the batch.
void make_windows_along(const RowMap& row, Kernel kernel, float first, float step, int begin, int n,
                        const float* weight, Windows& windows);

/// out[i] = sum over k of c[k] s^k at s = first + i * step, for i < n; n rounded up to 16 are touched.
void evaluate_quartic(const float c[5], float first, float step, int n, float* out);

/// Points the windows from sample `begin` on at a field of `channels` floats a texel, up to the first sample that lies
/// elsewhere: in another face or outside the field.  Returns that sample, or n.  At least one is pointed.
int point_windows(const WindowField& field, int channels, const float* face, int begin, int n, Windows& windows);

/// (x, y, z) <- matrix * (x, y, z), in place; n rounded up to 16.
void rotate_directions(const float matrix[9], std::size_t n, float* x, float* y, float* z);

/// The SIMD target that runs here: "AVX3", "AVX2", "SSE4", "NEON" ...
const char* simd_target();

}  // namespace envconv
