// SPDX-License-Identifier: Apache-2.0
// Damaged DDS, KTX and KTX2 files are an error in words, and never a death.
#include "container_cases.h"

namespace envconv {
namespace {

using enum PixelType;

// A cube of two levels in each container and packing.
class Damage : public Container {
 protected:
  // Both ways of reading refuse it in the same words.
  void expect_refused(const std::string& bytes, const std::string& what, const std::string& file) {
    put(file, bytes);
    for (const bool trust : {true, false}) {
      ReadOptions options;
      options.trust_input = trust;
      options.max_pixels = 1 << 20;
      const auto result = read_pictures(path(file), options);
      ASSERT_FALSE(result) << file << ": read, where \"" << what << "\" was expected";
      EXPECT_TRUE(result.error().code == ErrorCode::input || result.error().code == ErrorCode::limit);
      EXPECT_NE(result.error().message.find(what), std::string::npos) << result.error().message;
    }
  }
  std::string good(const std::string& file, const std::string& compression = "") {
    WriteOptions options;
    options.type = half;
    options.cube = true;
    options.compression = compression;
    options.metadata = {{"envconv:layout", "cube"}};
    write(file, make_levels(4, 4, 3, 6, 2), options);
    return bytes_of(file);
  }
  void expect_refused_with(const std::string& file, std::size_t at, std::uint32_t word, const std::string& what) {
    std::string bytes = bytes_of(file);
    set_word(bytes, at, word);
    SCOPED_TRACE(file + " " + std::to_string(at) + " = " + std::to_string(word));
    expect_refused(bytes, what, "bad" + std::filesystem::path(file).extension().string());
  }
};

TEST_F(Damage, EveryTruncation) {
  const std::pair<const char*, const char*> files[] = {
      {"a.dds", ""}, {"a.ktx", ""}, {"a.ktx2", ""}, {"a.ktx2", "zstd"}, {"a.ktx2", "zlib"}};
  for (const auto& [file, compression] : files) {
    const std::string bytes = good(file, compression);
    for (std::size_t size = 13; size < bytes.size(); size += size < 300 ? 1 : 97) {
      put("short", bytes.substr(0, size));
      for (const int level : {0, 1}) ASSERT_FALSE(read("short", level)) << file << " of " << size << " bytes";
    }
  }
}

TEST_F(Damage, OfDds) {
  good("a.dds");
  for (const std::uint32_t v : {0u, 123u, 0xFFFFFFFFu}) expect_refused_with("a.dds", 4, v, "bad DDS header");
  expect_refused_with("a.dds", 76, 24, "bad DDS header");
  for (const std::uint32_t v : {0u, 8u}) expect_refused_with("a.dds", 12, v, v ? "not square" : "empty image");
  for (const std::uint32_t v : {1u << 20, 0x7FFFFFFFu, 0xFFFFFFFFu}) expect_refused_with("a.dds", 16, v, "claims");
  for (const std::uint32_t v : {4u, 0xFFFFFFFFu}) expect_refused_with("a.dds", 28, v, "levels");
  expect_refused_with("a.dds", 28, 3, "truncated");
  expect_refused_with("a.dds", 128, 71, "864 bytes after the last texel");  // BC1 is smaller
  // Fewer levels than there are, and half the size: the faces would be taken from wrong places.
  for (const std::uint32_t v : {0u, 1u}) expect_refused_with("a.dds", 28, v, "192 bytes after the last texel");
  std::string small = bytes_of("a.dds");
  for (const std::size_t at : {12, 16}) set_word(small, at, 2);
  expect_refused(small, "720 bytes after the last texel", "bad.dds");
  for (const std::uint32_t v : {0u, 1u, 94u, 0xFFFFFFFFu}) expect_refused_with("a.dds", 128, v, "not supported");
  for (const std::uint32_t v : {2u, 4u}) expect_refused_with("a.dds", 132, v, "no two-dimensional texture");
  for (const std::uint32_t v : {0u, 2u, 6u, 0xFFFFFFFFu}) expect_refused_with("a.dds", 140, v, "cube maps");
  std::string array = bytes_of("a.dds");
  set_word(array, 136, 0);
  for (const std::uint32_t v : {65u, 0xFFFFFFFFu}) {
    set_word(array, 140, v);
    expect_refused(array, "layers", "bad.dds");
  }
  set_word(array, 140, 7);
  expect_refused(array, "truncated", "bad.dds");
  set_word(array, 140, 0);
  expect_refused(array, "layers", "bad.dds");
  std::string incomplete = dds_header(4, 1, 4, 113, 0, {}) + std::string(6 * 16 * 8, '\0');
  set_word(incomplete, 112, 0xFA00);
  expect_refused(incomplete, "lacks some", "bad.dds");
}

TEST_F(Damage, NotWhatFollowsADdsFilesTexels) {
  const std::string bytes = good("a.dds");
  for (const char* more : {"CExtAttC", "x"}) {
    put("more.dds", bytes + more);
    const auto file = read("more.dds");
    ASSERT_TRUE(file) << file.error().message;
    ASSERT_EQ(file->warnings.size(), 1u);
    EXPECT_NE(file->warnings[0].find("after the last texel, which are not read"), std::string::npos);
  }
  // A lost flag: one face, and five more.
  std::string flat = dds_header(4, 1, 4, 113, 0, {}) + std::string(6 * 16 * 8, '\0');
  put("flat.dds", flat);
  EXPECT_TRUE(read("flat.dds"));
  set_word(flat, 112, 0);
  expect_refused(flat, "640 bytes after the last texel", "bad.dds");
  // A lost extension, and rows that the header does not tell of.
  std::string old = dds_header(8, 1, 4, 113, 0, {}, false) + std::string(64 * 8 + 20, '\0');
  expect_refused(old, "20 bytes after the last texel", "bad.dds");
  std::string low = dds_header(8, 1, 4, 113, 0, {}, false) + std::string(64 * 8, '\0');
  put("low.dds", low);
  EXPECT_TRUE(read("low.dds"));
  set_word(low, 12, 5);
  expect_refused(low, "192 bytes after the last texel", "bad.dds");
}

TEST_F(Damage, NorWhatFollowsALastLevel) {
  for (const char* file : {"a.ktx", "a.ktx2"}) {
    const std::string bytes = good(file);
    expect_refused(bytes + bytes, "goes on behind its last", file);
    expect_refused(bytes.substr(0, bytes.size() - 20) + bytes.substr(bytes.size() - 60), "goes on behind its last",
                   file);
  }
}

TEST_F(Damage, OfKtx2) {
  good("a.ktx2");
  const std::string bytes = bytes_of("a.ktx2");
  for (const std::uint32_t v : {0u, 1u, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 12, v, "not supported");
  expect_refused_with("a.ktx2", 12, 109, "damaged");
  expect_refused_with("a.ktx2", 16, 4, "type size");
  expect_refused_with("a.ktx2", 20, 0, "empty image");
  for (const std::uint32_t v : {1u << 24, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 20, v, "claims");
  expect_refused_with("a.ktx2", 24, 0, "no two-dimensional");
  expect_refused_with("a.ktx2", 24, 8, "not square");
  expect_refused_with("a.ktx2", 28, 1, "no two-dimensional");
  for (const std::uint32_t v : {2u, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 32, v, "cube maps");
  for (const std::uint32_t v : {0u, 5u, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 36, v, "faces");
  for (const std::uint32_t v : {4u, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 40, v, "levels");
  expect_refused_with("a.ktx2", 40, 3, "damaged");
  for (const std::uint32_t v : {0u, 1u}) expect_refused_with("a.ktx2", 40, v, "level index");
  expect_refused_with("a.ktx2", 44, 1, "Basis");
  for (const std::uint32_t v : {2u, 3u}) expect_refused_with("a.ktx2", 44, v, "does not unpack");
  expect_refused_with("a.ktx2", 44, 4, "supercompression");
  for (const std::uint32_t v : {0u, 79u, 0xFFFFFFF0u}) expect_refused_with("a.ktx2", 48, v, "descriptor");
  for (const std::uint32_t v : {0u, 12u, 0xFFFFFFFFu}) expect_refused_with("a.ktx2", 52, v, "descriptor");
  expect_refused_with("a.ktx2", 56, 0xFFFFFFF0u, "keys and values");
  expect_refused_with("a.ktx2", 60, 0x7FFFFFFF, "keys and values");
  expect_refused_with("a.ktx2", 60, 5, "keys and values");
  expect_refused_with("a.ktx2", 72, 4, "global data");
  // The descriptor: its size, its own block's, model, a sample's place and meaning, an unknown curve.
  const std::size_t descriptor = word_at(bytes, 48), pairs = word_at(bytes, 56);
  for (const std::size_t i : {0, 1, 2, 3, 4, 5, 7, 11}) {
    expect_refused_with("a.ktx2", descriptor + 4 * i, word_at(bytes, descriptor + 4 * i) ^ 0x10001, "damaged");
  }
  expect_refused_with("a.ktx2", descriptor + 12, 0x000A0101, "transfer function 10");
  // Pairs: a size beyond the end, none, without a zero.
  for (const std::uint32_t v : {0u, 1u, 0x7FFFFFFFu}) expect_refused_with("a.ktx2", pairs, v, "well formed");
  std::string turned = bytes;
  turned.replace(turned.find("KTXorientation") + 15, 2, "ru");
  expect_refused(turned, "orientation", "bad.ktx2");
  // Levels: their sizes, places and each other.
  const std::uint64_t level0 = 4 * 4 * 8 * 6, level1 = 2 * 2 * 8 * 6;
  const auto with = [&](std::size_t at, std::uint64_t v) {
    std::string changed = bytes;
    set_long(changed, at, v);
    return changed;
  };
  const auto offset1 = little_endian<std::uint64_t>(reinterpret_cast<const std::uint8_t*>(bytes.data()) + 104);
  for (const std::uint64_t v : {std::uint64_t{0}, level0 - 1, level0 + 1, UINT64_MAX, std::uint64_t{1} << 63}) {
    expect_refused(with(88, v), "size that its texels need", "bad.ktx2");
    expect_refused(with(96, v), "size that its texels need", "bad.ktx2");
  }
  for (const std::uint64_t v : {std::uint64_t{bytes.size()}, UINT64_MAX, UINT64_MAX - level0 + 1}) {
    expect_refused(with(80, v), "truncated", "bad.ktx2");
  }
  for (const std::uint64_t v :
       {std::uint64_t{0}, std::uint64_t{80}, std::uint64_t{descriptor}, offset1, offset1 + level1 - 1}) {
    expect_refused(with(80, v), "overlap", "bad.ktx2");
  }
}

TEST_F(Damage, OfCompressedLevels) {
  for (const char* scheme : {"zstd", "zlib"}) {
    const std::string bytes = good("a.ktx2", scheme);
    // A stream that unpacks to more or to less than its texels need.
    for (const int size : {2, 8}) {
      WriteOptions options;
      options.type = half;
      options.cube = true;
      options.compression = scheme;
      write("other.ktx2", make_levels(size, size, 3, 6, 1), options);
      const std::string other = bytes_of("other.ktx2");
      const auto* entry = reinterpret_cast<const std::uint8_t*>(other.data()) + 80;
      const auto offset = little_endian<std::uint64_t>(entry), length = little_endian<std::uint64_t>(entry + 8);
      std::string bad = bytes + other.substr(offset, length);
      set_long(bad, 80, bytes.size());
      set_long(bad, 88, length);
      expect_refused(bad, "does not unpack to its size", "bad.ktx2");
    }
    std::string empty = bytes;
    set_long(empty, 88, 0);
    expect_refused(empty, "is empty", "bad.ktx2");
    // Any byte of the stream: an error, or texels.
    const auto begin = little_endian<std::uint64_t>(reinterpret_cast<const std::uint8_t*>(bytes.data()) + 80);
    for (std::size_t at = begin; at < bytes.size(); ++at) {
      std::string bad = bytes;
      bad[at] = static_cast<char>(bad[at] ^ 0x55);
      put("bad.ktx2", bad);
      (void)read("bad.ktx2");
    }
  }
}

// A plain colour is no lie, however small its file; a small file that claims gigabytes is.
TEST_F(Damage, PlainColorAndBomb) {
  std::vector<Picture> faces;
  for (int face = 0; face < 6; ++face) {
    Picture picture{"", Image(512, 512, 3), Channels::standard(3), half};
    picture.image.fill(0.5f);
    faces.push_back(std::move(picture));
  }
  WriteOptions options;
  options.cube = true;
  options.compression = "zstd:19";
  options.type_given = true;
  const auto report = write_pictures(path("plain.ktx2"), faces, options);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_LT(bytes_of("plain.ktx2").size(), 2000u);
  const auto got = read_pictures(path("plain.ktx2"), {});
  ASSERT_TRUE(got) << got.error().message;
  EXPECT_EQ(got->pictures[5].image.at(511, 511)[2], 0.5f);
  std::string bytes = good("a.ktx2", "zstd");
  for (const std::size_t at : {20, 24}) set_word(bytes, at, 8192);
  for (std::size_t level = 0; level < 2; ++level) {
    const std::uint64_t n = 8192 >> level;
    set_long(bytes, 96 + 24 * level, n * n * 8 * 6);
  }
  put("bomb.ktx2", bytes);
  const auto bomb = read_pictures(path("bomb.ktx2"), {});
  ASSERT_FALSE(bomb);
  EXPECT_NE(bomb.error().message.find("MB of pixels in a file of"), std::string::npos) << bomb.error().message;
}

TEST_F(Damage, OfKtx) {
  good("a.ktx");
  const std::string bytes = bytes_of("a.ktx");
  expect_refused_with("a.ktx", 12, 0x01020304, "big-endian");
  expect_refused_with("a.ktx", 12, 0, "bad KTX header");
  expect_refused_with("a.ktx", 20, 4, "type size");
  for (const std::uint32_t v : {0u, 0xFFFFFFFFu}) expect_refused_with("a.ktx", 28, v, "not supported");
  expect_refused_with("a.ktx", 36, 0, "empty image");
  expect_refused_with("a.ktx", 36, 0xFFFFFFFF, "claims");
  expect_refused_with("a.ktx", 44, 1, "no two-dimensional");
  expect_refused_with("a.ktx", 48, 2, "cube maps");
  for (const std::uint32_t v : {0u, 2u, 0xFFFFFFFFu}) expect_refused_with("a.ktx", 52, v, "faces");
  for (const std::uint32_t v : {4u, 0xFFFFFFFFu}) expect_refused_with("a.ktx", 56, v, "levels");
  expect_refused_with("a.ktx", 60, 0xFFFFFFFF, "keys and values");
  expect_refused_with("a.ktx", 64 + word_at(bytes, 60), 4 * 4 * 8 * 6, "size that its texels need");
}

}  // namespace
}  // namespace envconv
