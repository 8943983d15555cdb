// SPDX-License-Identifier: Apache-2.0
#include "tiff_streams.h"

#include <array>
#include <cstddef>

namespace envconv {
namespace {

// Bytes made so far, against those that there should be.
class Made {
 public:
  Made(std::uint64_t size, std::uint64_t full) : size_(size), full_(full) {}
  void add(std::uint64_t count) {
    made_ += count;
    if (made_ > size_) size_ = full_;
  }
  bool goes_on() const { return made_ < size_; }
  bool right() const { return made_ == size_; }

 private:
  std::uint64_t made_ = 0, size_, full_;
};

}  // namespace

bool lzw_unpacks_to(std::span<const std::uint8_t> stream, std::uint64_t size, std::uint64_t full) {
  constexpr std::size_t clear = 256, end = 257, first_free = 258, most = 4096;
  constexpr unsigned least_bits = 9, most_bits = 12;
  if (stream.size() >= 2 && stream[0] == 0 && (stream[1] & 1) != 0) return true;  // of before TIFF 5.0
  std::array<std::uint32_t, most> lengths;
  lengths.fill(1);
  Made made(size, full);
  std::size_t next = first_free, last = clear;  // last: the code before, or clear
  unsigned width = least_bits;
  std::uint32_t bits = 0;
  unsigned there = 0;
  for (std::size_t at = 0; made.goes_on();) {
    for (; there < width && at < stream.size(); there += 8) bits = bits << 8 | stream[at++];
    if (there < width) return false;
    there -= width;
    const std::size_t code = bits >> there & ((1u << width) - 1);
    if (code == end) return false;
    if (code == clear) {
      next = first_free, last = clear, width = least_bits;
      continue;
    }
    if (last == clear) {
      if (code >= clear) return false;
    } else {
      if (code > next) return false;
      if (next < most) lengths[next++] = lengths[last] + 1;
      // A code early.
      if (next + 1 >= std::size_t{1} << width && width < most_bits) ++width;
    }
    made.add(lengths[code]);
    last = code;
  }
  return made.right();
}

bool packbits_unpacks_to(std::span<const std::uint8_t> stream, std::uint64_t size, std::uint64_t full) {
  Made made(size, full);
  while (made.goes_on()) {
    if (stream.empty()) return false;
    const auto code = static_cast<std::int8_t>(stream[0]);
    stream = stream.subspan(1);
    if (code == -128) continue;  // nothing
    const std::size_t count = static_cast<std::size_t>(code < 0 ? 1 - code : code + 1), taken = code < 0 ? 1 : count;
    if (taken > stream.size()) return false;
    stream = stream.subspan(taken);
    made.add(count);
  }
  return made.right();
}

}  // namespace envconv
