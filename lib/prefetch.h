// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace envconv {

/// Asks for the cache line that lies so many floats from `from`, which may be beyond what is allocated.
inline void prefetch(const float* from, std::ptrdiff_t floats) {
  const auto at = reinterpret_cast<std::uintptr_t>(from) + static_cast<std::uintptr_t>(floats) * sizeof(float);
  __builtin_prefetch(reinterpret_cast<const void*>(at));
}

}  // namespace envconv
