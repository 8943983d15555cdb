// SPDX-License-Identifier: Apache-2.0
// OpenEXR's ZIP and ZIPS by libdeflate, where OpenEXR itself uses zlib, and RLE, which orders bytes as they do.
// Internal: not installed.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "deflate.h"

namespace envconv {

/// Packs and unpacks chunks, with buffers that are kept.  One thread's.
class ZipCodec {
 public:
  /// A chunk as the file has it: deflated at a level from 1 to 12, or itself where that would be no smaller.  Good
  /// until the next call.
  std::span<const std::uint8_t> pack(std::span<const std::uint8_t> chunk, int level);

  /// False unless `packed` unpacks to exactly all of `chunk`, whose bytes mean nothing then.
  bool unpack(std::span<const std::uint8_t> packed, std::span<std::uint8_t> chunk);

  /// The same of RLE.
  bool unpack_runs(std::span<const std::uint8_t> packed, std::span<std::uint8_t> chunk);

 private:
  struct Free {
    void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
  };
  Deflater deflater_;
  std::unique_ptr<libdeflate_decompressor, Free> decompressor_;
  std::vector<std::uint8_t> split_, packed_;
};

}  // namespace envconv
