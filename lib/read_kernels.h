// SPDX-License-Identifier: Apache-2.0
// The inner loops of resampling, compiled per SIMD target and dispatched at run time.
#pragma once

#include <cstddef>
#include <cstdint>

#include "filter.h"

namespace envconv {

/// Where a source's texels are, in tables by face that SIMD lanes can gather from.
struct SourceView {
  const float* texels = nullptr;  ///< RGBA
  std::int64_t texel_count = 0;
  float scale_u[64], bias_u[64], scale_v[64], bias_v[64];
  std::int32_t first[64], pitch[64];
};
inline constexpr int most_faces = 64;

/// Samples of one call: a row of texels, each sampled `per_texel` times; sample s belongs to texel s % texels.
inline constexpr int row_texels = 64;
inline constexpr int most_samples = 1024;  ///< texels x per_texel in one call at most

/// Workspace of read_samples, and what it found out about the samples.
struct ReadScratch {
  alignas(64) std::int32_t offset[most_samples + 16];                   ///< texel index of the first tap
  alignas(64) std::int32_t x[most_samples + 16], y[most_samples + 16];  ///< padded texel left of and above the sample
  alignas(64) float fx[most_samples + 16], fy[most_samples + 16];       ///< fractions
  alignas(64) float wx[(most_samples + 16) * 8], wy[(most_samples + 16) * 8];
};

/// accumulator[texel][16] += weight[s] * reconstruction at the sample (face, u, v)[s]; lanes of an accumulator are to
/// be added up in fours (see reduce_accumulators).  Arrays have room for n rounded up to 16.  n = texels * per_texel.
void read_samples(const SourceView& source, Kernel kernel, int n, int texels, const float* face, const float* u,
                  const float* v, const float* weight, ReadScratch& scratch, float* accumulator);

/// out[texel][4] = the accumulators' lanes summed in fours.
void reduce_accumulators(int texels, const float* accumulator, float* out);

/// (x, y, z) <- matrix * (x, y, z), in place; n rounded up to 16.
void rotate_directions(const float matrix[9], std::size_t n, float* x, float* y, float* z);

/// The SIMD target that runs here: "AVX3", "AVX2", "SSE4", "NEON" ...
const char* simd_target();

}  // namespace envconv
