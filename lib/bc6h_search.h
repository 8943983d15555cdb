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
inline constexpr int most_combined[2] = {120, 40};

/// How far to search.
struct Settings {
  int partitions = 1;        ///< of the 32, tried in earnest: those with the least variance across their regions' axes
  int first_spans = 1;       ///< parts of the regions' lines that texels are put on in these, at most most_spans
  int survivors = 1;         ///< of these partitions, searched further
  int spans[2] = {1, 1};     ///< as first_spans, for one region and for the survivors
  int combined[2] = {1, 1};  ///< parts of the lines compared by estimates, as spans; at most most_combined
  int combined_modes = 1;    ///< in which the best parts by estimates are tried
  int refinements = 0;       ///< rounds of least squares for each of what is tried
  int exchanges = 0;         ///< rounds in which one region starts anew while the other one stays
  bool other_lines = false;  ///< starts from further lines through the texels
  int polish = 0;            ///< rounds of steps of the best block's end points
  int reach = 1;             ///< the largest of those steps
  bool polish_all = false;   ///< polish every survivor, not the best alone
};

/// An encoding that was found.
struct Found {
  Block block;
  float error;          ///< in the search's metric, with what the differences of sums add
  float sum[3];         ///< of radiance over the texels given, by channel
  float difference[3];  ///< sum over the texels decoded, less that
};

/// found[n] = encodings of n blocks, n <= most_blocks.  All of `texels` has been set.
void search(const Texels& texels, int n, const Settings& settings, Found* found);

}  // namespace envconv::bc6h
