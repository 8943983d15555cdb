// SPDX-License-Identifier: Apache-2.0
#include "exif.h"

#include <algorithm>
#include <string_view>

namespace envconv {
namespace {

enum Tag : std::uint32_t {
  image_description = 0x010E,
  orientation = 0x0112,
  exif_directory = 0x8769,
  user_comment = 0x9286,
  color_space = 0xA001,
};
enum Type : std::uint32_t { ascii = 2, word = 3, long_word = 4 };

class ExifReader {
 public:
  explicit ExifReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  std::optional<ExifFields> read() {
    constexpr std::uint32_t magic = 42;
    if (bytes_.size() < 8) return {};
    little_ = bytes_[0] == 'I';
    if (bytes_[0] != bytes_[1] || (bytes_[0] != 'I' && bytes_[0] != 'M') || number(2, 2) != magic) return {};
    if (!directory(number(4, 4), true)) return {};
    if (exif_ != 0 && !directory(exif_, false)) return {};
    return fields_;
  }

 private:
  struct Field {
    std::uint32_t tag, type, count;
    std::size_t value;  // where it begins
  };

  // What is there at a position that was checked.
  std::uint32_t number(std::size_t at, unsigned size) const {
    std::uint32_t value = 0;
    for (unsigned i = 0; i < size; ++i) value = value << 8 | bytes_[at + (little_ ? size - 1 - i : i)];
    return value;
  }
  bool holds(std::uint64_t at, std::uint64_t size) const { return at <= bytes_.size() && size <= bytes_.size() - at; }

  bool directory(std::uint32_t at, bool first) {
    constexpr std::uint32_t entry = 12;
    if (at < 8 || !holds(at, 2)) return false;
    const std::uint32_t count = number(at, 2);
    if (!holds(at + 2, std::uint64_t{count} * entry)) return false;
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::size_t e = at + 2 + i * entry;
      if (!field({number(e, 2), number(e + 2, 2), number(e + 4, 4), e + 8}, first)) return false;
    }
    return true;
  }

  // Once each, and each where it belongs.
  bool field(const Field& f, bool first) {
    switch (f.tag) {
      case orientation:
        if (!first || fields_.orientation || f.type != word || f.count != 1) return false;
        fields_.orientation = static_cast<int>(number(f.value, 2));
        return true;
      case color_space:
        if (first || fields_.color_space || f.type != word || f.count != 1) return false;
        return fields_.color_space = true;
      case exif_directory:
        if (!first || exif_ != 0 || f.type != long_word || f.count != 1) return false;
        exif_ = number(f.value, 4);
        return exif_ != 0;
      case image_description: return first && !fields_.title && f.type == ascii && description(f);
      case user_comment: return !first && comment(f);
      default: return true;
    }
  }

  bool description(const Field& f) {
    const std::uint64_t at = f.count <= 4 ? f.value : number(f.value, 4);
    if (!holds(at, f.count)) return false;
    const auto* begin = reinterpret_cast<const char*>(bytes_.data()) + at;
    fields_.title.emplace(begin, std::find(begin, begin + f.count, '\0'));
    return true;
  }

  // It has an encoding of its own, and is of no interest unless it is ours.
  bool comment(const Field& f) const {
    const std::uint64_t at = f.count <= 4 ? f.value : number(f.value, 4);
    if (!holds(at, f.count)) return false;
    const std::string_view text(reinterpret_cast<const char*>(bytes_.data()) + at, f.count);
    return text.find("envconv:") == text.npos;
  }

  std::span<const std::uint8_t> bytes_;
  bool little_ = true;
  std::uint32_t exif_ = 0;  // where that directory is
  ExifFields fields_;
};

}  // namespace

std::optional<ExifFields> read_exif(std::span<const std::uint8_t> bytes) { return ExifReader(bytes).read(); }

}  // namespace envconv
