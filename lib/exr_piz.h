// SPDX-License-Identifier: Apache-2.0
// OpenEXR's PIZ, unpacked with every redundancy that it has checked: OpenEXR's own decoder takes many a damaged chunk
// for pixels.  Internal: not installed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace envconv {

/// A channel of a chunk, whose every texel is stored.
struct PizChannel {
  std::size_t width = 0;  ///< texels of a line
  std::size_t words = 1;  ///< 16-bit words of a texel: 1 for half, 2 for float and uint
};

/// Unpacks chunks, with buffers that are kept.  One thread's.
class PizCodec {
 public:
  /// False unless `packed` unpacks to exactly all of `chunk`, which is `lines` lines, each all of a channel and then
  /// all of the next; its bytes mean nothing then.  May throw std::bad_alloc.
  bool unpack(std::span<const std::uint8_t> packed, std::span<const PizChannel> channels, std::size_t lines,
              std::span<std::uint8_t> chunk);

 private:
  std::vector<std::uint8_t> lengths_;   // of codes in bits, by symbol
  std::vector<std::uint32_t> symbols_;  // with a code, the longest codes first
  std::vector<std::uint32_t> table_;    // by the next bits of the stream
  std::vector<std::uint8_t> bits_;      // the stream, and zeros behind it
  std::vector<std::uint16_t> values_, words_;

  struct Codes;
  bool read_codes(std::span<const std::uint8_t> packed, std::uint32_t first, std::uint32_t last, Codes& codes);
  bool decode(const Codes& codes, std::uint64_t bits, std::uint32_t run);
};

}  // namespace envconv
