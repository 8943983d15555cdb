// SPDX-License-Identifier: Apache-2.0
// Rows of values and of bytes on the best SIMD target of this machine: half floats, the order in which OpenEXR deflates
// bytes, and products of small matrices.  Arrays need no alignment and no padding.  Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdint>

namespace envconv {

/// Values that half cannot hold.
struct HalfCounts {
  std::int64_t high = 0;       ///< finite, and rounding to more than 65504
  std::int64_t nonfinite = 0;  ///< NaN and infinity
};

/// Rounds to the nearest half, ties to even.  What is beyond 65504, infinity too, becomes 65504 with its sign, and NaN
/// 0; both are added to the counts.
void floats_to_halves(const float* from, std::size_t count, std::uint16_t* to, HalfCounts& counts);

/// Exact; infinity and NaN stay such.
void halves_to_floats(const std::uint16_t* from, std::size_t count, float* to);

/// Bytes as ZIP and ZIPS deflate them (OpenEXR's technical introduction, "ZIP compression"): those at even places, then
/// those at odd places, and each but the first as its difference from the one before, plus 128.
void split_bytes(const std::uint8_t* from, std::size_t count, std::uint8_t* to);

/// The inverse of split_bytes().
void join_bytes(const std::uint8_t* from, std::size_t count, std::uint8_t* to);

/// A matrix by rows, `step` values from one to the next.
template <class T>
struct MatrixView {
  T* values;
  std::size_t step;
};

/// out[y][x] = sum over k < inner of a[k][y] b[k][x], for y < rows and x < columns; 1 <= inner <= most_inner.
inline constexpr int most_inner = 8;
void multiply_transposed(int rows, int inner, int columns, MatrixView<const double> a, MatrixView<const double> b,
                         MatrixView<double> out);

}  // namespace envconv
