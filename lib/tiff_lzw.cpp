// SPDX-License-Identifier: Apache-2.0
#include "tiff_lzw.h"

namespace envconv {
namespace {

constexpr std::uint32_t clear_code = 256, end_code = 257, first_entry = 258, last_entry = 4094, least_bits = 9;
constexpr std::uint32_t generations = 1 << 12;  // beside 20 bits of a key

}  // namespace

// Entries of older generations count as free.
void LzwEncoder::clear() {
  next_ = first_entry;
  bits_ = least_bits;
  generation_ = (generation_ + 1) % generations;
  if (generation_ > 0) return;
  keys_.fill(0);
  generation_ = 1;
}

void LzwEncoder::put(std::uint32_t code) {
  pending_ = pending_ << bits_ | code;
  for (pending_bits_ += bits_; pending_bits_ >= 8; pending_bits_ -= 8)
    *at_++ = static_cast<std::uint8_t>(pending_ >> (pending_bits_ - 8));
}

// Codes grow before the table does, and it starts anew before it is full.
void LzwEncoder::count_entry() {
  if (++next_ == last_entry) {
    put(clear_code);
    clear();
  } else if (next_ == std::uint32_t{1} << bits_) {
    ++bits_;
  }
}

void LzwEncoder::pack(std::span<const std::uint8_t> from, std::vector<std::uint8_t>& to) {
  // A code of at most 12 bits for each byte, and one that clears for some thousands of them.
  to.resize(from.size() + from.size() / 2 + from.size() / 1024 + 16);
  at_ = to.data();
  pending_bits_ = 0;
  clear();
  put(clear_code);
  if (!from.empty()) {
    std::uint32_t string = from.front();
    for (const std::uint8_t byte : from.subspan(1)) {
      const std::uint32_t pair = string << 8 | byte, key = generation_ << 20 | pair;
      std::uint32_t slot = (pair * 2654435761u) >> 18;
      while (keys_[slot] != key && keys_[slot] >> 20 == generation_) slot = (slot + 1) % slots;
      if (keys_[slot] == key) {
        string = codes_[slot];
        continue;
      }
      put(string);
      string = byte;
      keys_[slot] = key;
      codes_[slot] = static_cast<std::uint16_t>(next_);
      count_entry();
    }
    put(string);
    count_entry();
  }
  put(end_code);
  if (pending_bits_ > 0) *at_++ = static_cast<std::uint8_t>(pending_ << (8 - pending_bits_));
  to.resize(static_cast<std::size_t>(at_ - to.data()));
}

}  // namespace envconv
