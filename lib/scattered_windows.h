// SPDX-License-Identifier: Apache-2.0
// Windows of texels in scratch storage, far from each other.  Internal: not installed.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "image.h"
#include "window_kernels.h"

namespace envconv {

/// Samples that lie in other pages each, as about the point behind a mirror ball, map pages faster than the thread of
/// Scratch can look how much that is: a batch of windows may take 400 MB.  One thread's.
class ScatteredWindows {
 public:
  /// To be called before the windows, which point into `image` or what shares its scratch storage, are read; channels:
  /// floats a texel.  Where there are many pages that this thread has not read lately, the windows' texels are copied,
  /// with looks in between, and they point at these copies, which are good until the next call.
  void prepare(const Image& image, int channels, Kernel kernel, int count, Windows& windows);

 private:
  bool is_new(std::uintptr_t stretch);

  std::array<std::uintptr_t, 1024> read_{};  // stretches that are mapped together, by their last bits
  std::uint64_t unmappings_ = 0;             // when they were
  std::vector<float> copies_;
};

}  // namespace envconv
