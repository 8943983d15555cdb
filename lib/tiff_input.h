// SPDX-License-Identifier: Apache-2.0
// libtiff reading an open file.  Internal: not installed.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <memory>
#include <string>

#include "result.h"
#include "tiff_messages.h"

namespace envconv {

/// What libtiff said of a file.
struct TiffHeard {
  std::string error;     ///< the last
  bool guessed = false;  ///< it takes the sizes of strips from the picture's where those in the file cannot be
  bool corrupt = false;  ///< libjpeg makes up what it lacks
};

/// A TIFF file.  Its position is its own: other readers of the descriptor have theirs.  Stays where it is.
class TiffInput {
 public:
  /// The descriptor outlives it; `size` is the file's, in bytes.  tiff() is null where libtiff refuses it.
  TiffInput(int fd, std::uint64_t size);
  TiffInput(const TiffInput&) = delete;
  TiffInput& operator=(const TiffInput&) = delete;

  TIFF* tiff() const { return tiff_.get(); }
  int fd() const { return bytes_.fd; }
  std::uint64_t size() const { return bytes_.size; }
  TiffHeard& heard() { return heard_; }
  const TiffHeard& heard() const { return heard_; }
  /// What libtiff said last, as an error: input.
  Error damage() const;

 private:
  struct Bytes {
    int fd;
    std::uint64_t size, position;
  };
  static tmsize_t read(thandle_t handle, void* to, tmsize_t count);
  static toff_t seek(thandle_t handle, toff_t offset, int whence);

  Bytes bytes_;
  TiffHeard heard_;
  std::unique_ptr<TIFF, void (*)(TIFF*)> tiff_;
};

/// A strip or a tile: its bytes in the file.
struct TiffExtent {
  std::uint64_t offset, size;
};
inline TiffExtent extent_of_block(TIFF* tiff, std::uint32_t number) {
  return {TIFFGetStrileOffset(tiff, number), TIFFGetStrileByteCount(tiff, number)};
}
/// "strip 3", "tile 0"
inline std::string name_of_block(TIFF* tiff, std::uint32_t number) {
  return (TIFFIsTiled(tiff) ? "tile " : "strip ") + std::to_string(number);
}

}  // namespace envconv
