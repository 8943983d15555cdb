// SPDX-License-Identifier: Apache-2.0
#include "scattered_windows.h"

#include <algorithm>

#include "scratch.h"

namespace envconv {

// And not any more the next time.
bool ScatteredWindows::is_new(std::uintptr_t stretch) {
  std::uintptr_t& place = read_[stretch % read_.size()];
  if (place == stretch) return false;
  place = stretch;
  return true;
}

void ScatteredWindows::prepare(const Image& image, int channels, Kernel kernel, int count, Windows& windows) {
  constexpr int most_new = 16;
  const int rows = taps(kernel), floats = rows * channels;
  const auto row_of = [&](int s, int row) { return windows.first[s] + row * windows.pitch[s]; };
  const auto stretch_of = [&](int s, int row) {
    return reinterpret_cast<std::uintptr_t>(row_of(s, row)) / Image::mapped_about_a_texel;
  };
  Scratch& scratch = *image.scratch();
  if (const std::uint64_t now = scratch.unmappings(); now != unmappings_) {
    read_.fill(0);
    unmappings_ = now;
  }
  int found = 0;
  for (int s = 0; s < count; ++s)
    for (int row = 0; row < rows; ++row) found += is_new(stretch_of(s, row));
  if (found == 0) return;
  if (found <= most_new) return scratch.touched(static_cast<std::size_t>(found) * Image::mapped_about_a_texel);
  copies_.resize(static_cast<std::size_t>(batch_room * rows * floats));
  float* to = copies_.data();
  for (int s = 0; s < count; ++s) {
    const float* const copy = to;
    for (int row = 0; row < rows; ++row, to += floats) {
      image.texels_touched();
      std::copy_n(row_of(s, row), floats, to);
    }
    windows.first[s] = copy;
    windows.pitch[s] = floats;
  }
}

}  // namespace envconv
