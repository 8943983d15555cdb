// SPDX-License-Identifier: Apache-2.0
// Sums over points, of which the figures of a comparison are made.  Internal: not installed.
#pragma once

#include <cstddef>
#include <vector>

#include "geometry.h"

namespace envconv {

/// A lower bound of a channel's largest error, and where it was met.
struct LargestError {
  double error = 0;
  Vec3 direction{0, 0, 0};
  /// The earlier one stays where both are equal, so that the order of merging decides.
  void raise(double other, Vec3 where) {
    if (other > error) error = other, direction = where;
  }
};

/// Weighted sums of one channel.
struct ChannelSums {
  double a = 0, b = 0, absolute = 0, squared = 0, log_squared = 0;
  LargestError largest;
};

/// Weighted sums of all channels over some points.
struct ErrorSums {
  double weight = 0;    ///< of the points that were compared
  double excluded = 0;  ///< of those with a NaN or infinite value in either map
  std::vector<ChannelSums> channels;

  explicit ErrorSums(std::size_t n = 0) : channels(n) {}
  /// One point: `a` and `b` hold a value per channel.  False when the point is excluded.
  bool add(const float* a, const float* b, double w, bool with_logarithms = true);
  /// Raises every channel's largest error by those of a point, unless it is one to exclude.
  void add_largest(const float* a, const float* b, Vec3 where);
  /// Adds another's sums, and raises the largest errors.
  void merge(const ErrorSums& other);
  /// Adds another's sums times `factor`; largest errors stay.
  void merge_weighted(const ErrorSums& other, double factor);
};

/// Sums up in order: the same result from any number of threads.
ErrorSums merged(const std::vector<ErrorSums>& parts, std::size_t channels);

/// log_encoded() in single precision, for whole maps.
float log_encoded_float(float x);

}  // namespace envconv
