// SPDX-License-Identifier: Apache-2.0
// Writing TIFF through libtiff, but for deflate, which runs on all threads here.  Internal: not installed.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "output_file.h"
#include "stored_pixels.h"

namespace envconv {

/// How a picture is stored.
struct TiffStorage {
  std::string compression;  ///< "none", "lzw", "zip" or "packbits"
  std::string description;  ///< one line, or ""
  int tile = 0;             ///< the side of the tiles of a texture's level, a multiple of 16; 0: strips of lines
};

/// A file of one picture, or of the levels of one, the way that renderers keep textures: the first is marked as a
/// texture's, those that follow as reduced ones (TIFF 6.0, NewSubfileType).
///
///     TiffWriter writer(file, bytes);
///     for (...) ENVCONV_CHECK(writer.add(...));
///     ENVCONV_CHECK(writer.finish());
///
/// Errors: output, with libtiff's words.  After a failure of the disk, which OutputFile remembers and tells, there may
/// be none.
class TiffWriter {
 public:
  /// The file is empty and outlives the writer.  `bytes`: of all pixels, from which follows what offsets the file
  /// needs: beyond `largest` it becomes a BigTIFF file.
  TiffWriter(OutputFile& file, std::uint64_t bytes, std::uint64_t largest = 0xFFFFFFFF);
  ~TiffWriter();
  TiffWriter(const TiffWriter&) = delete;
  TiffWriter& operator=(const TiffWriter&) = delete;

  /// The bytes do not depend on the number of threads.
  Result<Ok> add(const StoredPixels& pixels, const TiffStorage& storage);
  Result<Ok> finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Writes the levels of one picture as report.type: one in strips of lines, more in tiles.  `compression`: as above.
/// Throws std::bad_alloc.  Errors as above.
Result<Ok> write_tiff(OutputFile& file, std::span<const std::vector<Picture>> levels, const std::string& compression,
                      const WriteOptions& options, WriteReport& report);

}  // namespace envconv
