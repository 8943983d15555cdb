// SPDX-License-Identifier: Apache-2.0
#include "exr_piz.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstring>

namespace envconv {
namespace {

static_assert(std::endian::native == std::endian::little);  // as the file

// Code lengths of 6 bits: up to 58, then two kinds of runs of zeros.
constexpr int kMostBits = 58, kShortRun = 59, kLongRun = 63, kLeastShortRun = 2, kLeastLongRun = 6;
// A code is read from 64 bits that begin anywhere in a byte.  Longer ones than this would need more symbols than the
// largest chunk has: lengths of Huffman codes grow as Fibonacci numbers do.
constexpr int kLongestCode = 56;
constexpr int kTableBits = 12;
constexpr std::uint32_t kSymbols = 65537;  // all words, and the one for a run
constexpr std::size_t kHeader = 20;        // bytes: least and largest symbol, bytes of the table, bits, nothing

template <class T>
T number(std::span<const std::uint8_t> bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// Bits from the highest of a byte on.  Eight bytes more than there are bits must be readable.
class Bits {
 public:
  explicit Bits(const std::uint8_t* bytes) : bytes_(bytes) {}
  std::uint64_t position() const { return position_; }
  // The next bits, at the top of the number; at least 57 are good.
  std::uint64_t peek() const {
    std::uint64_t v;
    std::memcpy(&v, bytes_ + position_ / 8, sizeof v);
    return __builtin_bswap64(v) << (position_ % 8);
  }
  void skip(int count) { position_ += static_cast<unsigned>(count); }
  std::uint32_t take(int count) {
    const std::uint64_t v = peek() >> (64 - count);
    skip(count);
    return static_cast<std::uint32_t>(v);
  }

 private:
  const std::uint8_t* bytes_;
  std::uint64_t position_ = 0;
};

// One step of the wavelet (Haar's, on integers), back: two words from their mean and their difference.
struct Narrow {  // all values are below 2^14
  static void back(std::uint16_t low, std::uint16_t high, std::uint16_t& a, std::uint16_t& b) {
    const int difference = static_cast<std::int16_t>(high);
    const int first = static_cast<std::int16_t>(low) + (difference & 1) + (difference >> 1);
    a = static_cast<std::uint16_t>(first);
    b = static_cast<std::uint16_t>(first - difference);
  }
};
struct Wide {  // modulo 2^16
  static void back(std::uint16_t low, std::uint16_t high, std::uint16_t& a, std::uint16_t& b) {
    b = static_cast<std::uint16_t>(low - (high >> 1));
    a = static_cast<std::uint16_t>(high + b - 0x8000);
  }
};

// Of nx by ny words, `x_step` and `y_step` words apart, in place, from the coarsest level on.
template <class Step>
void wavelet_back(std::uint16_t* words, std::size_t nx, std::size_t x_step, std::size_t ny, std::size_t y_step) {
  for (std::size_t p = std::bit_floor(std::min(nx, ny)) / 2; p > 0; p /= 2) {
    const std::size_t right = x_step * p, below = y_step * p;
    std::size_t y = 0;
    for (; y + 2 * p <= ny; y += 2 * p) {
      std::uint16_t* at = words + y * y_step;
      std::size_t x = 0;
      for (; x + 2 * p <= nx; x += 2 * p, at += 2 * right) {
        std::uint16_t i00, i01, i10, i11;
        Step::back(at[0], at[below], i00, i10);
        Step::back(at[right], at[right + below], i01, i11);
        Step::back(i00, i01, at[0], at[right]);
        Step::back(i10, i11, at[below], at[right + below]);
      }
      if (nx & p) Step::back(at[0], at[below], at[0], at[below]);
    }
    if (ny & p) {
      std::uint16_t* at = words + y * y_step;
      for (std::size_t x = 0; x + 2 * p <= nx; x += 2 * p, at += 2 * right)
        Step::back(at[0], at[right], at[0], at[right]);
    }
  }
}

}  // namespace

// Canonical Huffman codes: of one length they are consecutive, and longer ones have smaller values.
struct PizCodec::Codes {
  std::array<std::uint64_t, kLongestCode + 1> first{};   // code of a length
  std::array<std::uint32_t, kLongestCode + 1> count{};   // of a length
  std::array<std::uint32_t, kLongestCode + 1> offset{};  // of its first symbol among all
  std::size_t table_size = 0;                            // bytes
};

bool PizCodec::read_codes(std::span<const std::uint8_t> packed, std::uint32_t first, std::uint32_t last, Codes& codes) {
  bits_.assign(packed.begin(), packed.end());
  bits_.resize(packed.size() + 8);
  const std::uint64_t end = 8 * packed.size();
  Bits bits(bits_.data());
  lengths_.assign(kSymbols, 0);
  for (std::uint32_t symbol = first; symbol <= last;) {
    if (bits.position() >= end) return false;
    const int length = static_cast<int>(bits.take(6));
    if (length > kMostBits) {
      const std::uint32_t run = length == kLongRun ? bits.take(8) + kLeastLongRun
                                                   : static_cast<std::uint32_t>(length - kShortRun + kLeastShortRun);
      if (run > last + 1 - symbol) return false;
      symbol += run;
      continue;
    }
    if (length > kLongestCode) return false;
    lengths_[symbol++] = static_cast<std::uint8_t>(length);
    if (length > 0) ++codes.count[static_cast<std::size_t>(length)];
  }
  if (bits.position() > end) return false;
  codes.table_size = static_cast<std::size_t>((bits.position() + 7) / 8);
  std::uint64_t code = 0;
  std::uint32_t before = 0;
  for (std::size_t l = kLongestCode; l > 0; --l) {
    codes.first[l] = code;
    codes.offset[l] = before;
    before += codes.count[l];
    code += codes.count[l];
    // Huffman codes leave no gap: each has a sibling.
    if (code % 2 != 0) return false;
    code /= 2;
  }
  if (code != 1) return false;
  symbols_.resize(before);
  std::array<std::uint32_t, kLongestCode + 1> next = codes.offset;
  table_.assign(std::size_t{1} << kTableBits, 0);
  for (std::uint32_t symbol = first; symbol <= last; ++symbol) {
    const std::size_t l = lengths_[symbol];
    if (l == 0) continue;
    const std::uint64_t value = codes.first[l] + (next[l] - codes.offset[l]);
    if (value >> l != 0) return false;
    symbols_[next[l]++] = symbol;
    if (l > kTableBits) continue;
    const std::size_t room = std::size_t{1} << (kTableBits - l);
    std::fill_n(table_.begin() + static_cast<std::ptrdiff_t>(value * room), room,
                symbol << 8 | static_cast<std::uint32_t>(l));
  }
  return true;
}

// Fills values_, with exactly so many bits of bits_.
bool PizCodec::decode(const Codes& codes, std::uint64_t bits, std::uint32_t run) {
  Bits stream(bits_.data());
  std::uint16_t* to = values_.data();
  std::uint16_t* const end = to + values_.size();
  while (stream.position() < bits) {
    const std::uint64_t ahead = stream.peek();
    const std::uint32_t entry = table_[ahead >> (64 - kTableBits)];
    std::uint32_t symbol = entry >> 8;
    if (entry != 0) {
      stream.skip(static_cast<int>(entry & 255));
    } else {
      std::size_t l = kTableBits + 1;
      while (l <= kLongestCode && (ahead >> (64 - l) < codes.first[l] || codes.count[l] == 0)) ++l;
      if (l > kLongestCode) return false;
      const std::uint64_t place = (ahead >> (64 - l)) - codes.first[l];
      if (place >= codes.count[l]) return false;
      symbol = symbols_[codes.offset[l] + place];
      stream.skip(static_cast<int>(l));
    }
    if (symbol == run) {
      const std::uint32_t count = stream.take(8);
      if (to == values_.data() || count > static_cast<std::size_t>(end - to)) return false;
      std::fill_n(to, count, to[-1]);
      to += count;
    } else {
      if (to == end) return false;
      *to++ = static_cast<std::uint16_t>(symbol);
    }
  }
  return to == end && stream.position() == bits;
}

bool PizCodec::unpack(std::span<const std::uint8_t> packed, std::span<const PizChannel> channels, std::size_t lines,
                      std::span<std::uint8_t> chunk) {
  // The words that there are, as a set of bits without the zero bytes at its ends.
  std::array<std::uint8_t, 8192> used{};
  if (packed.size() < 4) return false;
  const std::size_t least = number<std::uint16_t>(packed, 0), most = number<std::uint16_t>(packed, 2);
  packed = packed.subspan(4);
  if (most >= used.size()) return false;
  if (least <= most) {
    if (packed.size() < most - least + 1) return false;
    std::memcpy(used.data() + least, packed.data(), most - least + 1);
    packed = packed.subspan(most - least + 1);
  }
  words_.clear();
  for (std::uint32_t word = 0; word < 65536; ++word) {
    if (word == 0 || (used[word / 8] >> (word % 8) & 1) != 0) words_.push_back(static_cast<std::uint16_t>(word));
  }

  // Their numbers in that set, by channels and through the wavelet, Huffman-coded.
  if (packed.size() < 4 + kHeader || number<std::uint32_t>(packed, 0) != packed.size() - 4) return false;
  packed = packed.subspan(4);
  const auto first = number<std::uint32_t>(packed, 0), last = number<std::uint32_t>(packed, 4),
             table_size = number<std::uint32_t>(packed, 8), bits = number<std::uint32_t>(packed, 12);
  packed = packed.subspan(kHeader);
  if (first > last || last >= kSymbols || table_size > packed.size()) return false;
  if ((std::uint64_t{bits} + 7) / 8 != packed.size() - table_size) return false;
  Codes codes;
  if (!read_codes(packed.first(table_size), first, last, codes) || codes.table_size != table_size) return false;
  bits_.assign(packed.begin() + static_cast<std::ptrdiff_t>(table_size), packed.end());
  bits_.resize(bits_.size() + 16);
  values_.resize(chunk.size() / 2);
  if (!decode(codes, bits, last)) return false;

  std::uint16_t* plane = values_.data();
  for (const PizChannel& channel : channels) {
    for (std::size_t word = 0; word < channel.words; ++word) {
      const auto back = words_.size() <= 1u << 14 ? wavelet_back<Narrow> : wavelet_back<Wide>;
      back(plane + word, channel.width, channel.words, lines, channel.width * channel.words);
    }
    plane += channel.width * channel.words * lines;
  }
  std::uint16_t top = 0;
  for (const std::uint16_t value : values_) top = std::max(top, value);
  if (top >= words_.size()) return false;

  std::uint8_t* to = chunk.data();
  for (std::size_t y = 0; y < lines; ++y) {
    const std::uint16_t* line = values_.data();
    for (const PizChannel& channel : channels) {
      const std::size_t count = channel.width * channel.words;
      for (std::size_t i = 0; i < count; ++i, to += 2) std::memcpy(to, &words_[line[y * count + i]], 2);
      line += count * lines;
    }
  }
  return true;
}

}  // namespace envconv
