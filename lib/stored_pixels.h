// SPDX-License-Identifier: Apache-2.0
// Pixels as a file will hold them.  Internal: not installed.
#pragma once

#include <cstdint>
#include <memory>

#include "decoder.h"
#include "io_shared.h"

namespace envconv {

/// [height][width][channels] elements of uint8, uint16, half or float32, top row first.
struct StoredPixels {
  int width, height, channels;
  int alpha;  ///< a channel, or -1
  PixelType type;
  const void* data;                          ///< `owned`, or the picture's own floats
  std::unique_ptr<void, FreeBytes> owned{};  ///< may be null

  /// Bytes of a texel, and of a row.
  std::size_t texel_size() const { return static_cast<std::size_t>(channels) * size_of(type); }
  std::size_t row_size() const { return static_cast<std::size_t>(width) * texel_size(); }
  const std::uint8_t* row(int y) const {
    return static_cast<const std::uint8_t*>(data) + static_cast<std::size_t>(y) * row_size();
  }
};

/// A picture's, as report.type; counts in the report what does not fit.  The picture outlives them.  Throws
/// std::bad_alloc.
StoredPixels stored_pixels(const Picture& picture, const WriteOptions& options, WriteReport& report);

}  // namespace envconv
