// SPDX-License-Identifier: Apache-2.0
#include "texture_file.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <optional>

#include "file_bytes.h"

namespace envconv {
namespace {

Error unsupported(std::string what) { return {ErrorCode::unsupported, std::move(what)}; }

// "zstd" or "zstd:LEVEL", a level in [1, most].
bool parse_scheme(std::string_view word, std::string_view name, int usual, int most, int& level) {
  if (word == name) {
    level = usual;
    return true;
  }
  if (word.substr(0, name.size()) != name || word.substr(name.size(), 1) != ":") return false;
  word.remove_prefix(name.size() + 1);
  const auto parsed = std::from_chars(word.data(), word.data() + word.size(), level);
  return parsed.ec == std::errc() && parsed.ptr == word.data() + word.size() && level >= 1 && level <= most;
}

std::optional<Bc6hEffort> effort_named(std::string_view word) {
  if (word == "fast") return Bc6hEffort::fast;
  if (word == "normal") return Bc6hEffort::normal;
  if (word == "best") return Bc6hEffort::best;
  return std::nullopt;
}

}  // namespace

bool is_texture_file(std::string_view format) { return format == "dds" || format == "ktx" || format == "ktx2"; }

Result<TextureCompression> parse_texture_compression(std::string_view format, PixelType type, const std::string& text) {
  TextureCompression compression;
  bool scheme_given = false, effort_given = false, good = text.empty() || text.back() != ',';
  for (std::size_t at = 0; good && at < text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string_view word = std::string_view(text).substr(at, end - at);
    at = end + 1;
    if (const auto effort = effort_named(word); effort && type == PixelType::bc6h && !effort_given) {
      compression.effort = *effort;
      effort_given = true;
      continue;
    }
    good = !scheme_given;
    scheme_given = true;
    if (word == "none" || !good) continue;
    if (format == "ktx2" && parse_scheme(word, "zstd", 3, 22, compression.level)) {
      compression.scheme = Supercompression::zstd;
    } else if (format == "ktx2" && parse_scheme(word, "zlib", 6, 12, compression.level)) {
      compression.scheme = Supercompression::zlib;
    } else {
      good = false;
    }
  }
  if (good) return compression;
  std::string known = "none";
  if (format == "ktx2") known += ", zstd:1-22, zlib:1-12";
  known += type == PixelType::bc6h ? "; and fast, normal or best" : "; with bc6h also fast, normal, best";
  return unsupported("the format has no compression \"" + printable(text) + "\" (it has " + known + ")");
}

Result<Ok> check_texture(std::string_view format, PixelType type, bool cube, int pictures, int channels) {
  if (cube && pictures != 6) return Error{ErrorCode::internal, "a cube map of " + std::to_string(pictures) + " faces"};
  if (pictures > kMaxPictures) return unsupported("more than " + std::to_string(kMaxPictures) + " layers");
  const bool alpha = texel_format(type, false).has_alpha();
  if (channels < 1 || channels > 4) {
    return unsupported(std::string(format) + " files hold 1 (as grey), 3 or 4 channels, not " +
                       std::to_string(channels));
  }
  if (!alpha && (channels == 2 || channels == 4)) {
    return unsupported(std::string(name_of(type)) + " has no alpha channel (--alpha drop leaves it out)");
  }
  return Ok{};
}

int full_chain(int width, int height) { return std::bit_width(static_cast<unsigned>(std::max({width, height, 1}))); }

Size size_of_level(Size base, int level) {
  return {std::max(1, base.width >> std::min(level, 31)), std::max(1, base.height >> std::min(level, 31))};
}

Result<TextureShape> shape_of(std::span<const std::vector<Picture>> levels, bool cube) {
  TextureShape shape;
  const Image& first = levels.front().front().image;
  shape.size = {first.width(), first.height()};
  shape.pictures = static_cast<int>(levels.front().size());
  shape.levels = static_cast<int>(levels.size());
  shape.cube = cube;
  if (shape.levels > full_chain(first.width(), first.height())) {
    return Error{ErrorCode::internal, "more levels than a chain down to one texel has"};
  }
  for (int level = 0; level < shape.levels; ++level) {
    const std::vector<Picture>& pictures = levels[static_cast<std::size_t>(level)];
    const Size size = size_of_level(shape.size, level);
    if (static_cast<int>(pictures.size()) != shape.pictures) {
      return Error{ErrorCode::internal, "levels of different numbers of pictures"};
    }
    for (const Picture& picture : pictures) {
      if (Size{picture.image.width(), picture.image.height()} == size) continue;
      if (level == 0)
        return unsupported("its faces differ in size, which layers cannot (--packing grid can hold them)");
      // Gutters do not shrink with their faces, nor do unfoldings of odd sizes.
      return unsupported(
          "its levels are not each half of the one before (write one file a level, with {mip} in its name)");
    }
  }
  if (cube && shape.size.width != shape.size.height) {
    return Error{ErrorCode::internal, "a cube map whose faces are not square"};
  }
  return shape;
}

Error damaged_texture(const std::string& what) { return {ErrorCode::input, "damaged: " + what}; }
Error truncated_texture() { return damaged_file("it ends before the last texel of its last level"); }

// --- reading -------------------------------------------------------------------------------------------------------

Result<Ok> TextureDecoder::describe(const TextureShape& shape, const TextureFacts& facts) {
  constexpr int kLargest = 1 << 24;  // texels on a side; no sum of sizes below this overflows
  const Size size = shape.size;
  if (size.width < 1 || size.height < 1) return damaged_texture("an empty image");
  if (size.width > kLargest || size.height > kLargest || size.width > options_.max_pixels / size.height) {
    return too_many_pixels(size.width, size.height, options_.max_pixels);
  }
  if (shape.pictures < 1 || shape.pictures > kMaxPictures) {
    return Error{ErrorCode::input, "holds " + std::to_string(shape.pictures) + " layers, more than the " +
                                       std::to_string(kMaxPictures) + " of any layout"};
  }
  if (shape.levels < 1 || shape.levels > full_chain(size.width, size.height)) {
    return damaged_texture("claims " + std::to_string(shape.levels) + " levels of " + std::to_string(size.width) + "x" +
                           std::to_string(size.height) + " texels, which has " +
                           std::to_string(full_chain(size.width, size.height)) + " at most");
  }
  if (shape.cube && size.width != size.height) return damaged_texture("a cube map whose faces are not square");
  shape_ = shape;
  facts_ = facts;
  level_ = options_.level < shape.levels ? std::max(options_.level, 0) : 0;
  spec_.levels = shape.levels;
  spec_.transfer = facts.format.srgb ? Transfer::srgb : Transfer::linear;
  spec_.unassociated = !facts.premultiplied;
  if (facts.format.code != BlockCode::none) {
    const bool packed = !spec_.compression.empty() && spec_.compression != "none";
    spec_.compression = name_of(facts.format.code) + (packed ? ", " + spec_.compression : "");
  }
  const Size here = size_of_level(size, level_);
  static constexpr const char* kFaces[] = {"px", "nx", "py", "ny", "pz", "nz"};
  for (int i = 0; i < shape.pictures; ++i) {
    PictureSpec picture;
    if (shape.cube) picture.name = kFaces[i % 6];
    picture.width = here.width;
    picture.height = here.height;
    picture.channels = channels_of(facts.format);
    if (facts.opaque && picture.channels.alpha >= 0) picture.channels = Channels::standard(3);
    picture.type = facts.format.type;
    picture.element = element_of(facts.format);
    spec_.pictures.push_back(std::move(picture));
  }
  return Ok{};
}

Result<Ok> TextureDecoder::decode(int picture, void* pixels) {
  ENVCONV_TRY(const std::vector<std::uint8_t> bytes, read_surface(picture));
  const PictureSpec& p = spec_.pictures[static_cast<std::size_t>(picture)];
  if (bytes.size() < surface_bytes(facts_.format, p.width, p.height)) return truncated_texture();
  decode_surface(bytes.data(), facts_.format, p.width, p.height, p.channels.count(), pixels);
  return Ok{};
}

Result<Ok> TextureDecoder::read_at(std::uint64_t offset, void* to, std::size_t size) const {
  return envconv::read_at(fd_, offset, {static_cast<std::uint8_t*>(to), size});
}

Result<std::vector<std::uint8_t>> TextureDecoder::read_at(std::uint64_t offset, std::uint64_t size) const {
  std::vector<std::uint8_t> bytes(size);
  ENVCONV_CHECK(read_at(offset, bytes.data(), bytes.size()));
  return bytes;
}

Result<std::uint64_t> TextureDecoder::file_size() const { return size_of_file(fd_); }

// --- keys and values -----------------------------------------------------------------------------------------------

std::string pack_key_values(const Metadata& metadata, const Metadata& more) {
  Metadata all = more;
  for (const auto& [key, value] : metadata) {
    // Texts end at their first zero byte.
    if (key.compare(0, 8, "envconv:") == 0) all[key] = value.substr(0, value.find('\0'));
  }
  ByteWriter out;
  // A std::map of std::string is in the order of the bytes, as the specification wants it.
  for (const auto& [key, value] : all) {
    out.u32(static_cast<std::uint32_t>(key.size() + value.size() + 2));
    out.text(key);
    out.zeros(1);
    out.text(value);
    out.zeros(1);
    out.align(4);
  }
  return out.bytes();
}

Result<Ok> unpack_key_values(std::span<const std::uint8_t> bytes, Metadata& metadata, Metadata& more) {
  constexpr std::size_t kMostEntries = 64, kLongest = 1024;
  const Error bad = damaged_texture("its keys and values are not well formed");
  while (!bytes.empty()) {
    if (bytes.size() < 4) return bad;
    const std::size_t size = little_endian<std::uint32_t>(bytes.data());
    bytes = bytes.subspan(4);
    if (size < 2 || size > bytes.size()) return bad;
    const std::string pair(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    // The last one's padding is sometimes left out.
    bytes = bytes.subspan(std::min((size + 3) / 4 * 4, bytes.size()));
    const std::size_t end = pair.find('\0');
    if (end == 0 || end == std::string::npos) return bad;
    const std::string key = pair.substr(0, end);
    std::string value = pair.substr(end + 1);
    const bool ours = key.compare(0, 8, "envconv:") == 0;
    if (ours || key == "KTXorientation") value = value.substr(0, value.find('\0'));
    Metadata& to = ours ? metadata : more;
    if (to.size() < kMostEntries && key.size() <= kLongest && value.size() <= kLongest) to[key] = value;
  }
  return Ok{};
}

std::string texture_writer() { return "envconv " ENVCONV_VERSION; }

void pad_file(OutputFile& file, std::uint64_t multiple) {
  static constexpr std::uint8_t kZeros[16] = {};
  for (std::uint64_t left = (multiple - file.tell() % multiple) % multiple; left > 0;) {
    const std::uint64_t part = std::min<std::uint64_t>(left, sizeof kZeros);
    file.write(kZeros, part);
    left -= part;
  }
}

}  // namespace envconv
