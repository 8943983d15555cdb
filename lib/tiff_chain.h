// SPDX-License-Identifier: Apache-2.0
// A TIFF file of several pictures, made of files of one picture each.  Internal: not installed.
#pragma once

#include <cstdint>
#include <vector>

#include "output_file.h"

namespace envconv {

/// Takes the directories of little-endian TIFF files that a writer puts behind each other into one file, and chains
/// them: pixels stay where they are, and their offsets become the file's.  Pictures after the first are marked as
/// reduced ones (TIFF 6.0, NewSubfileType).  A file whose offsets do not fit 32 bits becomes a BigTIFF file, whatever
/// its parts were.
///
///     TiffChain chain(file);
///     for (...) { write(file, chain.begin()); ENVCONV_CHECK(chain.end()); }
///     ENVCONV_CHECK(chain.finish());
class TiffChain {
 public:
  /// The file is empty, and outlives the chain.
  explicit TiffChain(OutputFile& file);

  std::uint64_t begin();  ///< where in the file the next TIFF file starts
  /// That file is there.  Error: output, when it is no file of one directory; not when the disk failed, which
  /// OutputFile remembers and tells.
  Result<Ok> end();
  /// Writes header and directories; the file is whole then.  `largest`: beyond this offset it is a BigTIFF file.
  /// Error: output, a chain without pictures.
  Result<Ok> finish(std::uint64_t largest = 0xFFFFFFFF);

 private:
  struct Entry {
    std::uint16_t tag = 0, type = 0;
    std::uint64_t count = 0;
    std::vector<std::uint8_t> value;  // `count` of them, as the type has them
  };
  using Directory = std::vector<Entry>;

  Result<Ok> unless_disk_failed(Error error);
  Result<Directory> read_directory() const;
  Result<Entry> read_entry(const std::uint8_t* bytes, bool big) const;
  std::uint64_t directory_size(const Directory& directory, bool big) const;
  void write_directory(const Directory& directory, bool big, bool last);

  OutputFile& file_;
  std::uint64_t base_ = 0;
  std::vector<Directory> directories_;
};

}  // namespace envconv
