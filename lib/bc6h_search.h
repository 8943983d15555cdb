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
  /// What a channel's sum of radiance over a block adds to the error, by its distance from what it should be; or 0.
  float price[3] = {0, 0, 0};
};

inline constexpr int most_spans = 12;

/// How far to search.
struct Settings {
  int partitions = 1;        ///< of the 32, tried in earnest: those with the least variance across their regions' axes
  int first_spans = 1;       ///< parts of the regions' lines that texels are put on in these, at most most_spans
  int survivors = 1;         ///< of these partitions, searched further
  int spans = 1;             ///< as first_spans, for the survivors and for one region
  int modes = 1;             ///< tried for each of those starts
  int refinements = 1;       ///< rounds of least squares for each of those; may be 0
  int exchanges = 0;         ///< rounds in which one region starts anew while the other one stays
  bool other_lines = false;  ///< starts from further lines through the texels
  int polish = 0;            ///< rounds of steps of the best block's end points
  int reach = 1;             ///< the largest of those steps
  bool polish_all = false;   ///< polish every survivor, not the best alone
};

/// blocks[n] = encodings of n blocks, n <= most_blocks, errors[n] their errors in the search's metric.  All of `texels`
/// has been set.
void search(const Texels& texels, int n, const Settings& settings, Block* blocks, float* errors);

}  // namespace envconv::bc6h
