// SPDX-License-Identifier: Apache-2.0
// The search for good BC6H blocks, compiled per SIMD target and dispatched at run time: many blocks abreast, one a
// lane.
#pragma once

#include "bc6h_format.h"

namespace envconv::bc6h {

/// Blocks searched in one call at most; a multiple of every target's lanes.
inline constexpr int most_blocks = 64;

/// Blocks as the lanes want them.
struct Texels {
  alignas(64) float radiance[16][3][most_blocks];  ///< [texel][R, G, B][block]; any values, NaN included
};

inline constexpr int most_spans = 10;

/// How far to search.  All counts are at least 1 unless 0 is named.
struct Settings {
  int partitions;    ///< of the 32, tried in earnest: those with the least variance across their regions' axes
  int survivors;     ///< of these, searched further
  int spans;         ///< parts of a region's line that its texels are put on to start with, at most most_spans
  int modes;         ///< tried for each of those starts
  int refinements;   ///< rounds of least squares for each of those; may be 0
  int polish;        ///< rounds of steps of the best block's end points; may be 0
  int reach;         ///< the largest of those steps, a power of two
  bool other_lines;  ///< starts from further lines through the texels
};

/// blocks[n] = encodings of n blocks, n <= most_blocks.  All of `texels` has been set.
void search(const Texels& texels, int n, const Settings& settings, Block* blocks);

}  // namespace envconv::bc6h
