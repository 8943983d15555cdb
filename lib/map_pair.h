// SPDX-License-Identifier: Apache-2.0
// Two environments made ready for comparison: the channels that both have, and how finely they are to be read.
// Internal: not installed.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "image.h"
#include "result.h"

namespace envconv {

struct MapPair {
  const EnvImage* a = nullptr;  ///< with the common channels only, in the same order; the caller's, or owned below
  const EnvImage* b = nullptr;
  std::vector<std::string> channels, only_in_a, only_in_b;
  std::vector<bool> is_color;  ///< [channels]: all but alpha
  bool same_grid = false;      ///< layout, sizes, placement and frame agree
  int grid = 0;                ///< PointSquare::grid: at least as many points as the finer map has texels

  /// Errors: unsupported (no pixels; no colour channel in common).
  static Result<MapPair> make(const EnvImage& a, const EnvImage& b);

  std::size_t channel_count() const { return channels.size(); }
  /// The root of the mean square over the colour channels of the difference between two points; NaN when a colour is
  /// not finite.
  double color_error(const float* at_a, const float* at_b) const;

 private:
  std::vector<EnvImage> owned_;
};

/// Calls work() within an arena of so many threads (0: all cores); bad_alloc and length_error become errors.
Result<Ok> run_in_arena(int threads, const std::function<void()>& work);

}  // namespace envconv
