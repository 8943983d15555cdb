// SPDX-License-Identifier: Apache-2.0
#include "exr_output.h"

#include <cmath>
#include <limits>

#include "row_kernels.h"

namespace envconv {
namespace {

std::uint32_t to_uint32(float v, std::int64_t& high, std::int64_t& negative, std::int64_t& nonfinite) {
  constexpr std::uint32_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (std::isnan(v)) {
    ++nonfinite;
    return 0;
  }
  if (v < 0) {
    ++(std::isinf(v) ? nonfinite : negative);
    return 0;
  }
  if (v >= 4294967296.f) {
    ++(std::isinf(v) ? nonfinite : high);
    return kMax;
  }
  return static_cast<std::uint32_t>(std::min(std::rint(static_cast<double>(v)), static_cast<double>(kMax)));
}

}  // namespace

void ExrCounts::add_to(WriteReport& report) const {
  report.clamped_high += high;
  report.clamped_negative += negative;
  report.nonfinite += nonfinite;
}

void convert_values(const float* from, std::size_t count, Imf::PixelType type, void* to, ExrCounts& counts) {
  HalfCounts odd;
  std::int64_t negative = 0;
  if (type == Imf::HALF) {
    floats_to_halves(from, count, static_cast<std::uint16_t*>(to), odd);
  } else if (type == Imf::UINT) {
    auto* integers = static_cast<std::uint32_t*>(to);
    for (std::size_t k = 0; k < count; ++k) integers[k] = to_uint32(from[k], odd.high, negative, odd.nonfinite);
  } else {
    for (std::size_t k = 0; k < count; ++k) odd.nonfinite += !std::isfinite(from[k]);
  }
  // Mostly nothing: threads would only take the numbers from each other.
  if (odd.high != 0) counts.high += odd.high;
  if (negative != 0) counts.negative += negative;
  if (odd.nonfinite != 0) counts.nonfinite += odd.nonfinite;
}

}  // namespace envconv
