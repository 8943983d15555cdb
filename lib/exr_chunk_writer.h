// SPDX-License-Identifier: Apache-2.0
// OpenEXR files of the compressions that chunks_are_ours() knows: not compressed, ZIPS or ZIP.  Internal: not
// installed.
#pragma once

#include <ImfHeader.h>

#include <cstdint>
#include <string>
#include <vector>

#include "exr_output.h"
#include "image.h"
#include "output_file.h"

namespace envconv {

/// Writes a file: headers, offset tables, and the chunks in the tables' order.  Chunks are packed by all threads, a few
/// at a time; the bytes are the same whatever their number.
class ChunkWriter {
 public:
  /// The level at which chunks are deflated where none is asked for: the fastest whose files are not larger, by more
  /// than a thousandth, than those of OpenEXR's zlib at its level 4 (photographs, noise; half and float).
  static constexpr int usual_level = 2;

  /// One header a part, scan lines or tiles.  `level` is from 1 to 12.  Throws what OpenEXR throws of headers that are
  /// not valid.
  ChunkWriter(OutputFile& file, std::vector<Imf::Header> headers, int level);

  /// One level, all channels of `type`, as `names` says which is which.  Parts come one after another, and the levels
  /// of each, from 0.
  void write(std::size_t part, int level, const Image& image, const std::vector<std::string>& names,
             Imf::PixelType type, ExrCounts& counts);

  /// The offset tables, once all is written.
  void finish();

 private:
  OutputFile& file_;
  std::vector<Imf::Header> headers_;
  int level_;
  std::uint64_t tables_ = 0;            // where they begin
  std::vector<std::uint64_t> offsets_;  // of all chunks so far
};

}  // namespace envconv
