// SPDX-License-Identifier: Apache-2.0
// Bytes of an open file one after another, as headers and chains of blocks are read.  Internal: not installed.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "file_bytes.h"
#include "result.h"

namespace envconv {

/// A place in a file.  Every error is of the input: it ends before, or cannot be read.
class ByteCursor {
 public:
  static constexpr std::size_t longest_text = 255;

  ByteCursor(int fd, std::uint64_t file_size, std::uint64_t position)
      : fd_(fd), size_(file_size), position_(position) {}

  std::uint64_t position() const { return position_; }
  std::uint64_t left() const { return size_ - position_; }

  Result<Ok> skip(std::uint64_t count) {
    if (count > left()) return damaged_file("unexpected end of file");
    position_ += count;
    return Ok{};
  }
  Result<std::uint8_t> byte() {
    if (position_ < start_ || position_ >= start_ + filled_) {
      if (position_ >= size_) return damaged_file("unexpected end of file");
      start_ = position_;
      filled_ = std::min<std::uint64_t>(buffer_.size(), left());
      ENVCONV_CHECK(read_at(fd_, start_, std::span(buffer_).first(static_cast<std::size_t>(filled_))));
    }
    return buffer_[position_++ - start_];
  }
  /// The next `bytes` bytes, at most 8, as a number, the lowest byte first or last.
  Result<std::uint64_t> little(int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) {
      ENVCONV_TRY(const std::uint64_t b, byte());
      value |= b << (8 * i);
    }
    return value;
  }
  Result<std::uint64_t> big(int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) {
      ENVCONV_TRY(const std::uint64_t b, byte());
      value = value << 8 | b;
    }
    return value;
  }
  /// Bytes before a zero, which is skipped too.
  Result<std::string> text() {
    std::string word;
    for (;;) {
      ENVCONV_TRY(const std::uint8_t c, byte());
      if (c == 0) return word;
      if (word.size() == longest_text) return damaged_file("a name in its header that does not end");
      word += static_cast<char>(c);
    }
  }

 private:
  int fd_;
  std::uint64_t size_, position_, start_ = 0, filled_ = 0;
  std::array<std::uint8_t, 4096> buffer_;
};

}  // namespace envconv
