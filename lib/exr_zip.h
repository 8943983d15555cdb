// SPDX-License-Identifier: Apache-2.0
// OpenEXR's ZIP and ZIPS by libdeflate, which is two to three times as fast as the zlib that OpenEXR uses.
// Internal: not installed.
#pragma once

#include <libdeflate.h>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace envconv {

/// Packs and unpacks chunks, with buffers that are kept.  One thread's.
class ZipCodec {
 public:
  /// A chunk as the file has it: deflated at a level from 1 to 12, or itself where that would be no smaller.  Good
  /// until the next call.
  std::span<const std::uint8_t> pack(std::span<const std::uint8_t> chunk, int level);

  /// False unless `packed` unpacks to exactly all of `chunk`, whose bytes mean nothing then.
  bool unpack(std::span<const std::uint8_t> packed, std::span<std::uint8_t> chunk);

 private:
  struct Free {
    void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
    void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
  };
  std::unique_ptr<libdeflate_compressor, Free> compressor_;
  std::unique_ptr<libdeflate_decompressor, Free> decompressor_;
  int level_ = 0;  // the compressor's
  std::vector<std::uint8_t> split_, packed_;
};

}  // namespace envconv
