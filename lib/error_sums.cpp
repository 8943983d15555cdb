// SPDX-License-Identifier: Apache-2.0
#include "error_sums.h"

#include <algorithm>
#include <cmath>

namespace envconv {

float log_encoded_float(float x) { return std::log2(std::max(x, 0.0f) + 1.0f / 1024); }

bool ErrorSums::add(const float* a, const float* b, double w, bool with_logarithms) {
  for (std::size_t c = 0; c < channels.size(); ++c)
    if (!std::isfinite(a[c]) || !std::isfinite(b[c])) {
      excluded += w;
      return false;
    }
  weight += w;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    ChannelSums& sums = channels[c];
    const double x = static_cast<double>(a[c]), y = static_cast<double>(b[c]), error = std::abs(x - y);
    sums.a += w * x;
    sums.b += w * y;
    sums.absolute += w * error;
    sums.squared += w * error * error;
    if (!with_logarithms || error == 0) continue;
    const double ratio = static_cast<double>(log_encoded_float(a[c]) - log_encoded_float(b[c]));
    sums.log_squared += w * ratio * ratio;
  }
  return true;
}

void ErrorSums::add_largest(const float* a, const float* b, Vec3 where) {
  for (std::size_t c = 0; c < channels.size(); ++c)
    if (!std::isfinite(a[c]) || !std::isfinite(b[c])) return;
  for (std::size_t c = 0; c < channels.size(); ++c)
    channels[c].largest.raise(std::abs(static_cast<double>(a[c]) - static_cast<double>(b[c])), where);
}

void ErrorSums::merge_weighted(const ErrorSums& other, double factor) {
  weight += factor * other.weight;
  excluded += factor * other.excluded;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    channels[c].a += factor * other.channels[c].a;
    channels[c].b += factor * other.channels[c].b;
    channels[c].absolute += factor * other.channels[c].absolute;
    channels[c].squared += factor * other.channels[c].squared;
    channels[c].log_squared += factor * other.channels[c].log_squared;
  }
}

void ErrorSums::merge(const ErrorSums& other) {
  merge_weighted(other, 1);
  for (std::size_t c = 0; c < channels.size(); ++c)
    channels[c].largest.raise(other.channels[c].largest.error, other.channels[c].largest.direction);
}

ErrorSums merged(const std::vector<ErrorSums>& parts, std::size_t channels) {
  ErrorSums all(channels);
  for (const ErrorSums& part : parts) all.merge(part);
  return all;
}

}  // namespace envconv
