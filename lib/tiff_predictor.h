// SPDX-License-Identifier: Apache-2.0
// What TIFF makes of lines before they are compressed, undone.  Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envconv {

/// How the samples of a line lie.
struct TiffSamples {
  std::size_t size = 1;      ///< bytes: 1, 2 or 4
  std::size_t channels = 1;  ///< from a sample to the next one of its channel
  int predictor = 1;         ///< 1: as they are; 2: differences (TIFF 6.0, section 14); 3: of planes of bytes, for
                             ///< floating point (Adobe, TIFF technical note 3)
  bool swapped = false;      ///< the other byte order than this machine's; predictor 3 has its own
};

/// The samples of a line, in its place, in this machine's byte order.  `line` is whole samples; `buffer` is kept from
/// line to line.
void undo_tiff_predictor(const TiffSamples& samples, std::span<std::uint8_t> line, std::vector<std::uint8_t>& buffer);

}  // namespace envconv
