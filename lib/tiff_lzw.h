// SPDX-License-Identifier: Apache-2.0
// LZW as TIFF has it (TIFF 6.0, section 13).  Internal: not installed.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace envconv {

/// Packs strips or tiles, each for itself.
class LzwEncoder {
 public:
  /// Replaces what is in `to`.  Throws std::bad_alloc.
  void pack(std::span<const std::uint8_t> from, std::vector<std::uint8_t>& to);

 private:
  void clear();
  void put(std::uint32_t code);
  void count_entry();

  static constexpr unsigned slots = 1 << 14;  // four times the entries
  std::array<std::uint32_t, slots> keys_{};   ///< a string's code but for its last byte, that byte, and the generation
  std::array<std::uint16_t, slots> codes_{};
  std::uint32_t generation_ = 0, next_ = 0, bits_ = 0;  ///< of the table; its next entry; and of a code
  std::uint64_t pending_ = 0;                           ///< bits that make no byte yet
  unsigned pending_bits_ = 0;
  std::uint8_t* at_ = nullptr;  ///< where the next byte goes
};

}  // namespace envconv
