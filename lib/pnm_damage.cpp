// SPDX-License-Identifier: Apache-2.0
#include "pnm_damage.h"

#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
#include <system_error>

#include "file_bytes.h"

namespace envconv {
namespace {

// The words of a header, between which there is white space and, after #, comments.
class Words {
 public:
  Words(int fd, std::uint64_t size) : fd_(fd), size_(size) {}

  std::string next() {
    std::string word;
    int c = get();
    while (c == '#' || std::isspace(c)) {
      while (c == '#' && c >= 0) {
        while (c >= 0 && c != '\n') c = get();
      }
      c = get();
    }
    for (; c >= 0 && !std::isspace(c) && word.size() < 64; c = get()) word += static_cast<char>(c);
    return word;
  }
  // After the one white space that ends the last word.
  std::uint64_t position() const { return position_; }

 private:
  int get() {
    std::uint8_t c = 0;
    if (position_ >= size_ || !read_at(fd_, position_, {&c, 1})) return -1;
    ++position_;
    return c;
  }

  int fd_;
  std::uint64_t size_, position_ = 0;
};

template <class T>
bool parse(const std::string& word, T& value) {
  const char* end = word.data() + word.size();
  const auto [at, error] = std::from_chars(word.data(), end, value);
  return error == std::errc() && at == end;
}

}  // namespace

std::string damage_of_pnm(int fd) {
  const Result<std::uint64_t> size = size_of_file(fd);
  if (!size) return size.error().message;
  Words words(fd, *size);
  const std::string magic = words.next();
  if (magic.size() != 2 || std::string_view("123456Ff").find(magic[1]) == std::string_view::npos) return "a bad header";
  const char kind = magic[1];
  const bool real = kind == 'F' || kind == 'f', bits = kind == '1' || kind == '4';
  std::uint32_t width = 0, height = 0, largest = 1;
  double scale = 1;
  if (!parse(words.next(), width) || !parse(words.next(), height)) return "no resolution";
  if (real && (!parse(words.next(), scale) || !std::isfinite(scale) || scale == 0)) return "a scale that cannot be";
  if (!real && !bits && (!parse(words.next(), largest) || largest < 1 || largest > 65535))
    return "a largest value that cannot be";
  if (kind < '4') return "";  // text
  const std::uint64_t values = std::uint64_t{width} * (kind == '6' || kind == 'F' ? 3 : 1);
  const std::uint64_t row = bits ? (values + 7) / 8 : values * (real ? 4 : largest > 255 ? 2 : 1);
  const std::uint64_t rest = *size - words.position();
  if (row == 0 || rest / row <= height) return "";
  std::uint8_t next = 0;
  if (!read_at(fd, words.position() + row * height, {&next, 1})) return "cannot be read";
  return next == 'P' ? "" : "it goes on behind its last row";
}

}  // namespace envconv
