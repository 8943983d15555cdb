// SPDX-License-Identifier: Apache-2.0
// DDS, KTX and KTX2: what is written is what is read, at every level, and bytes are those of the specifications.  What
// the texels mean is container_oracle_test.py's matter, and damage container_damage_test.cpp's.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <random>
#include <tuple>

#include "container_cases.h"
#include "imageio_loader.h"
#include "ktx2_descriptor.h"

namespace envconv {
namespace {

using enum PixelType;

constexpr PixelType kTypes[] = {half, float32, uint8, r11g11b10f, rgb9e5, bc6h};

// Half a step of the type where values lie below 2; of integers on the curve, of colour that was divided by alpha.
double tolerance(PixelType type, double v, int channel, double peak) {
  switch (type) {
    case half: return v * std::exp2(-11);
    case float32: return 0;
    case uint8: return 0.016;
    case r11g11b10f: return v * std::exp2(channel == 2 ? -6 : -7);
    case rgb9e5: return peak * std::exp2(-9);
    default: return 0.02;
  }
}

void expect_same(const Picture& written, const Picture& read, PixelType type) {
  ASSERT_EQ(read.image.width(), written.image.width());
  ASSERT_EQ(read.image.height(), written.image.height());
  EXPECT_EQ(read.type, type);
  const int channels = written.image.channels(), more = read.image.channels() - channels;
  ASSERT_EQ(more, channels <= 2 ? 2 : 0);
  for (int y = 0; y < written.image.height(); ++y) {
    for (int x = 0; x < written.image.width(); ++x) {
      const float *a = written.image.at(x, y), *b = read.image.at(x, y);
      double peak = 0;
      for (int c = 0; c < channels; ++c) peak = std::fmax(peak, static_cast<double>(a[c]));
      for (int c = 0; c < channels; ++c) {
        const double v = a[c];
        ASSERT_NEAR(b[c > 0 ? c + more : 0], v, tolerance(type, v, c, peak) + 1e-9)
            << x << "," << y << " channel " << c;
      }
    }
  }
}

struct Kind {
  const char* name;
  int width, height, pictures;
  bool cube;
};
// Sizes that are no powers of two, and no multiples of a block.
constexpr Kind kKinds[] = {{"cube", 12, 12, 6, true},       {"picture", 22, 10, 1, false},
                           {"two layers", 15, 5, 2, false}, {"many layers", 7, 7, 30, false},
                           {"a texel", 1, 1, 1, false},     {"six layers", 4, 4, 6, false}};

TEST_F(Container, EveryTypeOfEveryKindAtEveryLevel) {
  for (const char* extension : {"dds", "ktx2", "ktx"}) {
    for (const PixelType type : kTypes) {
      for (const Kind& kind : kKinds) {
        for (const int channels : {1, 2, 3, 4}) {
          const bool alpha = type == half || type == float32 || type == uint8;
          if ((!alpha && channels % 2 == 0) || (type != half && channels < 3)) continue;
          SCOPED_TRACE(std::string(extension) + " " + std::string(name_of(type)) + " " + kind.name + " " +
                       std::to_string(channels));
          const int count = full_chain(kind.width, kind.height);
          const Levels levels = make_levels(kind.width, kind.height, channels, kind.pictures, count);
          WriteOptions options;
          options.type = type;
          options.cube = kind.cube;
          options.metadata = {{"envconv:layout", "cube"}, {"envconv:frame", "three"}, {"envmap", "not for these"}};
          const std::string file = std::string("a.") + extension;
          EXPECT_EQ(write(file, levels, options).type, type);
          for (int level = 0; level < count; ++level) {
            const auto got = read(file, level);
            ASSERT_TRUE(got) << got.error().message;
            EXPECT_EQ(got->format, extension);
            EXPECT_EQ(got->levels, count);
            EXPECT_EQ(got->metadata, (Metadata{{"envconv:layout", "cube"}, {"envconv:frame", "three"}}));
            ASSERT_EQ(got->pictures.size(), static_cast<std::size_t>(kind.pictures));
            EXPECT_EQ(got->pictures[0].name, kind.cube ? "px" : "");
            for (std::size_t i = 0; i < got->pictures.size(); ++i) {
              expect_same(levels[static_cast<std::size_t>(level)][i], got->pictures[i], type);
              if (HasFatalFailure()) return;
            }
          }
          const auto beyond = read(file, count);
          ASSERT_FALSE(beyond);
          EXPECT_EQ(beyond.error().code, ErrorCode::input);
        }
      }
    }
  }
}

TEST_F(Container, LevelsThroughAProcessOfItsOwn) {
  WriteOptions options;
  options.type = half;
  options.cube = true;
  const Levels levels = make_levels(12, 12, 3, 6, 4);
  for (const char* file : {"a.dds", "a.ktx2", "a.ktx"}) {
    write(file, levels, options);
    for (int level = 0; level < 4; ++level) {
      ReadOptions how;
      how.level = level;
      const auto got = read_pictures(path(file), how);
      ASSERT_TRUE(got) << got.error().message;
      expect_same(levels[static_cast<std::size_t>(level)][5], got->pictures[5], half);
    }
  }
}

TEST_F(Container, CompressionOfKtx2) {
  const Levels levels = make_levels(64, 64, 3, 6, 7);
  WriteOptions options;
  options.type = half;
  options.cube = true;
  write("plain.ktx2", levels, options);
  for (const char* name : {"none", "zstd", "zstd:1", "zstd:19", "zlib", "zlib:1", "zlib:12"}) {
    SCOPED_TRACE(name);
    options.compression = name;
    write("a.ktx2", levels, options);
    const auto got = read("a.ktx2", 1);
    ASSERT_TRUE(got) << got.error().message;
    EXPECT_EQ(got->compression, std::string(name).substr(0, 4));
    for (std::size_t i = 0; i < 6; ++i) expect_same(levels[1][i], got->pictures[i], half);
    const std::string bytes = bytes_of("a.ktx2"), plain = bytes_of("plain.ktx2");
    if (std::string(name) == "none") {
      EXPECT_EQ(bytes, plain);
    } else {
      EXPECT_LT(bytes.size(), plain.size());
    }
    // Whatever the number of threads.
    options.threads = 1;
    write("b.ktx2", levels, options);
    options.threads = 0;
    EXPECT_EQ(bytes, bytes_of("b.ktx2"));
  }
  for (const char* name : {"zstd:0", "zstd:23", "zstd:", "zlib:13", "zstd,zlib", "zstd,", "best", "fast", ",", "lz4"}) {
    options.compression = name;
    const auto refused = can_write(path("a.ktx2"), options, 6, 3, 7);
    ASSERT_FALSE(refused) << name;
    EXPECT_EQ(refused.error().code, ErrorCode::unsupported);
  }
  options.type = bc6h;
  options.type_given = true;
  for (const char* name : {"fast", "normal", "best", "zstd:3,best", "fast,zlib", "none,normal"}) {
    options.compression = name;
    EXPECT_TRUE(can_write(path("a.ktx2"), options, 6, 3, 7)) << name;
  }
  options.compression = "zstd";
  EXPECT_FALSE(can_write(path("a.dds"), options, 6, 3, 7));
  options.compression = "best";
  EXPECT_TRUE(can_write(path("a.dds"), options, 6, 3, 7));
}

TEST_F(Container, WhatTheyCannotHold) {
  WriteOptions options;
  options.type_given = true;
  options.type = rgb9e5;
  EXPECT_TRUE(can_write("a.dds", options, 30, 3, 5));
  EXPECT_FALSE(can_write("a.dds", options, 6, 4));  // alpha
  options.type = half;
  EXPECT_FALSE(can_write("a.ktx2", options, 1, 5));
  EXPECT_FALSE(can_write("a.ktx2", options, 65, 3));
  options.type = uint16;
  EXPECT_FALSE(can_write("a.ktx2", options, 6, 3));
  options.type = half;
  Levels gutters = make_levels(8, 8, 3, 1, 2);
  gutters[1][0] = make(6, 6, 3, 0, 1);
  const auto other_levels = write_levels(path("a.dds"), gutters, options);
  ASSERT_FALSE(other_levels);
  EXPECT_EQ(other_levels.error().code, ErrorCode::unsupported);
  Levels uneven = make_levels(8, 8, 3, 2, 1);
  uneven[0][1] = make(4, 8, 3, 1, 0);
  const auto refused = write_levels(path("a.dds"), uneven, options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::unsupported);
  EXPECT_TRUE(std::filesystem::is_empty(folder()));
}

// --- bytes ---------------------------------------------------------------------------------------------------------

// As the Khronos Group's own dfdutils prints them for these formats.
TEST(Descriptor, IsTheOneOfTheKhronosGroup) {
  const std::uint32_t one = 0x3f800000, minus = 0xbf800000;
  const std::pair<std::uint32_t, std::vector<std::uint32_t>> golden[] = {
      {97, {0x5c, 0,     0x00580002, 0x00010101, 0, 8,     0,   0xc00f0000, 0, minus, one, 0xc10f0010,
            0,    minus, one,        0xc20f0020, 0, minus, one, 0xcf0f0030, 0, minus, one}},
      {109, {0x5c, 0,     0x00580002, 0x00010101, 0, 16,    0,   0xc01f0000, 0, minus, one, 0xc11f0020,
             0,    minus, one,        0xc21f0040, 0, minus, one, 0xcf1f0060, 0, minus, one}},
      {90,
       {0x4c, 0, 0x00480002, 0x00010101, 0, 6, 0, 0xc00f0000, 0, minus, one, 0xc10f0010, 0, minus, one, 0xc20f0020, 0,
        minus, one}},
      {122,
       {0x4c, 0, 0x00480002, 0x00010101, 0, 4, 0, 0x800a0000, 0, 0, one, 0x810a000b, 0, 0, one, 0x82090016, 0, 0, one}},
      {123, {0x7c, 0, 0x00780002, 0x00010101, 0, 4,  0,  0x00080000, 0, 0, 0x2100, 0x2004001b, 0, 15, 31, 0x01080009,
             0,    0, 0x2100,     0x2104001b, 0, 15, 31, 0x02080012, 0, 0, 0x2100, 0x2204001b, 0, 15, 31}},
      {143, {0x2c, 0, 0x00280002, 0x00010185, 0x303, 16, 0, 0x807f0000, 0, 0, one}},
      {144, {0x2c, 0, 0x00280002, 0x00010185, 0x303, 16, 0, 0xc07f0000, 0, minus, one}},
      {37, {0x5c, 0, 0x00580002, 0x00010101, 0, 4, 0,   0x00070000, 0, 0, 255, 0x01070008,
            0,    0, 255,        0x02070010, 0, 0, 255, 0x0f070018, 0, 0, 255}},
      {43, {0x5c, 0, 0x00580002, 0x00020101, 0, 4, 0,   0x00070000, 0, 0, 255, 0x01070008,
            0,    0, 255,        0x02070010, 0, 0, 255, 0x1f070018, 0, 0, 255}},
  };
  for (const auto& [number, words] : golden) {
    const TexelFormat* format = format_of_vk(number);
    ASSERT_NE(format, nullptr) << number;
    EXPECT_EQ(make_descriptor(*format, false), words) << number;
  }
}

TEST_F(Container, HeaderOfDds) {
  WriteOptions options;
  options.type = half;
  options.cube = true;
  write("a.dds", make_levels(12, 12, 3, 6, 4), options);
  const std::string a = bytes_of("a.dds");
  EXPECT_EQ(a.size(), 148 + 6 * 8 * (144 + 36 + 9 + 1));
  EXPECT_EQ(a.substr(0, 4), "DDS ");
  const std::pair<int, std::uint32_t> words[] = {{4, 124},        {8, 0x2100F},  {12, 12}, {16, 12}, {20, 12 * 8},
                                                 {24, 0},         {28, 4},       {76, 32}, {80, 4},  {88, 0},
                                                 {108, 0x401008}, {112, 0xFE00}, {116, 0}, {120, 0}, {124, 0},
                                                 {128, 10},       {132, 3},      {136, 4}, {140, 1}, {144, 3}};
  for (const auto& [at, value] : words) EXPECT_EQ(word_at(a, static_cast<std::size_t>(at)), value) << at;
  EXPECT_EQ(a.substr(84, 4), "DX10");

  options.cube = false;
  options.type = bc6h;
  write("b.dds", make_levels(10, 6, 3, 2, 1), options);
  const std::string b = bytes_of("b.dds");
  EXPECT_EQ(b.size(), 148 + 2 * 3 * 2 * 16);
  const std::pair<int, std::uint32_t> others[] = {{8, 0x81007}, {20, 3 * 2 * 16}, {28, 1},  {108, 0x1008},
                                                  {112, 0},     {128, 95},        {136, 0}, {140, 2}};
  for (const auto& [at, value] : others) EXPECT_EQ(word_at(b, static_cast<std::size_t>(at)), value) << at;

  const std::pair<PixelType, std::uint32_t> numbers[] = {{half, 10},       {float32, 2}, {uint8, 29},
                                                         {r11g11b10f, 26}, {rgb9e5, 67}, {bc6h, 95}};
  for (const auto& [type, number] : numbers) {
    options.type = type;
    write("c.dds", make_levels(4, 4, 3, 1, 1), options);
    EXPECT_EQ(word_at(bytes_of("c.dds"), 128), number);
  }
  options.type = uint8;
  options.encoding = Encoding::as_is;
  write("c.dds", make_levels(4, 4, 3, 1, 1), options);
  EXPECT_EQ(word_at(bytes_of("c.dds"), 128), 28u);
}

TEST_F(Container, LongNamesFitIntoTheHeaderOfDds) {
  WriteOptions options;
  const Metadata longest{
      {"envconv:layout", "polar-capped-conformal"}, {"envconv:frame", "renderman"}, {"envconv:seam", "stretch"}};
  options.metadata = longest;
  write("a.dds", make_levels(4, 4, 3, 1, 1), options);
  EXPECT_EQ(read("a.dds")->metadata, longest);
  options.metadata = {{"envconv:layout", "tennis-ball"}, {"envconv:seam", "gutter:4"}, {"envconv:frame", "world"}};
  write("a.dds", make_levels(4, 4, 3, 1, 1), options);
  options.metadata.erase("envconv:frame");  // the usual one
  EXPECT_EQ(read("a.dds")->metadata, options.metadata);
  // The size is left out before anything else, but not where there are gutters.
  options.metadata["envconv:size"] = "1024";
  write("a.dds", make_levels(4, 4, 3, 1, 1), options);
  EXPECT_EQ(read("a.dds")->metadata, options.metadata);
  options.metadata = longest;
  options.metadata["envconv:size"] = "1024";
  EXPECT_TRUE(write("a.dds", make_levels(4, 4, 3, 1, 1), options).warnings.empty());
  EXPECT_EQ(read("a.dds")->metadata, longest);
  options.metadata["envconv:seam"] = "gutter";
  EXPECT_EQ(write("a.dds", make_levels(4, 4, 3, 1, 1), options).warnings.size(), 1u);
  options.metadata = {{"envconv:layout", std::string(41, 'x')}};
  EXPECT_EQ(write("a.dds", make_levels(4, 4, 3, 1, 1), options).warnings.size(), 1u);
  EXPECT_TRUE(read("a.dds")->metadata.empty());
}

TEST_F(Container, OrderInKtx2) {
  WriteOptions options;
  options.type = bc6h;
  options.cube = true;
  options.metadata = {{"envconv:layout", "cube"}};
  write("a.ktx2", make_levels(12, 12, 3, 6, 4), options);
  const std::string a = bytes_of("a.ktx2");
  const std::pair<int, std::uint32_t> words[] = {{12, 143}, {16, 1}, {20, 12}, {24, 12}, {28, 0},
                                                 {32, 0},   {36, 6}, {40, 4},  {44, 0},  {48, 80 + 4 * 24}};
  for (const auto& [at, value] : words) EXPECT_EQ(word_at(a, static_cast<std::size_t>(at)), value) << at;
  std::uint64_t before = UINT64_MAX;
  for (std::size_t level = 0; level < 4; ++level) {
    const auto* entry = reinterpret_cast<const std::uint8_t*>(a.data()) + 80 + 24 * level;
    const auto offset = little_endian<std::uint64_t>(entry);
    EXPECT_EQ(offset % 16, 0u) << "aligned to blocks";
    EXPECT_LT(offset, before) << "the smallest level comes first";
    before = offset;
    const std::uint64_t size = (level == 0 ? 9 : 4 / (level == 1 ? 1 : 4)) * 16 * 6;
    EXPECT_EQ(little_endian<std::uint64_t>(entry + 8), size);
    EXPECT_EQ(little_endian<std::uint64_t>(entry + 16), size);
  }
  EXPECT_LT(a.find("KTXorientation"), a.find("KTXwriter"));
  EXPECT_LT(a.find("KTXwriter"), a.find("envconv:layout"));
  options.cube = false;
  write("b.ktx2", make_levels(4, 4, 3, 12, 1), options);
  EXPECT_EQ(word_at(bytes_of("b.ktx2"), 32), 12u);
  EXPECT_EQ(word_at(bytes_of("b.ktx2"), 36), 1u);
}

// Codes of KHR_DF_PRIMARIES: BT.709 is 1, BT.2020 is 4.
TEST_F(Container, PrimariesInKtx2) {
  WriteOptions options;
  const Levels levels = make_levels(4, 4, 3, 1, 1);
  const auto code = [&] {
    const std::string bytes = bytes_of("a.ktx2");
    return word_at(bytes, word_at(bytes, 48) + 12) >> 8 & 0xFF;
  };
  write("a.ktx2", levels, options);
  EXPECT_EQ(code(), 1u);
  options.color.primaries = find_named_primaries("rec2020").xy;
  options.color.transfer = Transfer::linear;
  write("a.ktx2", levels, options);
  EXPECT_EQ(code(), 4u);
  EXPECT_EQ(read("a.ktx2")->color_encoding.primaries, options.color.primaries);
  options.color.primaries->red_x = 0.5;  // nobody's
  write("a.ktx2", levels, options);
  EXPECT_EQ(code(), 0u);
}

TEST_F(Container, SizesInKtx) {
  WriteOptions options;
  options.type = r11g11b10f;
  options.cube = true;
  write("a.ktx", make_levels(3, 3, 3, 6, 2), options);
  const std::string a = bytes_of("a.ktx");
  // Type, its size, format, internal format, base format; size; faces and levels.
  const std::uint32_t words[] = {0x04030201, 0x8C3B, 4, 0x1907, 0x8C3A, 0x1907, 3, 3, 0, 0, 6, 2};
  for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(word_at(a, 12 + 4 * i), words[i]) << i;
  const std::size_t data = 64 + word_at(a, 60);
  EXPECT_EQ(word_at(a, data), 3u * 3 * 4) << "of one face";
  EXPECT_EQ(word_at(a, data + 4 + 6 * 36), 4u);
  EXPECT_EQ(a.size(), data + 4 + 6 * 36 + 4 + 6 * 4);
  options.cube = false;
  write("b.ktx", make_levels(3, 3, 3, 2, 1), options);
  const std::string b = bytes_of("b.ktx");
  EXPECT_EQ(word_at(b, 48), 2u);
  EXPECT_EQ(word_at(b, 64 + word_at(b, 60)), 2u * 36) << "of all layers";
}

// --- other people's files ------------------------------------------------------------------------------------------

TEST_F(Container, OldCubesOfFloats) {
  // Face-major: each texel is 10 face + level.
  for (const bool single : {true, false}) {
    std::string bytes = dds_header(4, 3, 4, single ? 116 : 113, 0, {});
    for (int face = 0; face < 6; ++face) {
      for (int level = 0; level < 3; ++level) {
        for (int i = 0; i < (4 >> level) * (4 >> level) * 4; ++i) {
          const float v = static_cast<float>(10 * face + level);
          if (single) {
            bytes.append(reinterpret_cast<const char*>(&v), 4);
          } else {
            int e = 0;
            const auto code = static_cast<std::uint16_t>(
                v == 0 ? 0 : (std::frexp(v, &e), ((e + 14) << 10) | (static_cast<int>(std::ldexp(v, 11 - e)) & 1023)));
            bytes.append(reinterpret_cast<const char*>(&code), 2);
          }
        }
      }
    }
    put("old.dds", bytes);
    for (int level = 0; level < 3; ++level) {
      const auto got = read("old.dds", level);
      ASSERT_TRUE(got) << got.error().message;
      ASSERT_EQ(got->pictures.size(), 6u);
      EXPECT_EQ(got->color, "linear");
      for (int face = 0; face < 6; ++face) {
        EXPECT_EQ(got->pictures[static_cast<std::size_t>(face)].image.width(), 4 >> level);
        EXPECT_EQ(got->pictures[static_cast<std::size_t>(face)].image.at(0, 0)[1], 10 * face + level);
      }
    }
  }
}

TEST_F(Container, OldPicturesByMasks) {
  struct Masks {
    std::uint32_t flags, bits;
    std::array<std::uint32_t, 4> masks;
    bool bgr;
    int channels;
  };
  const Masks all[] = {{0x41, 32, {0xFF, 0xFF00, 0xFF0000, 0xFF000000}, false, 4},
                       {0x41, 32, {0xFF0000, 0xFF00, 0xFF, 0xFF000000}, true, 4},
                       {0x40, 32, {0xFF0000, 0xFF00, 0xFF, 0}, true, 3},
                       {0x40, 24, {0xFF0000, 0xFF00, 0xFF, 0}, true, 3}};
  for (const Masks& m : all) {
    std::string bytes = dds_header(2, 2, m.flags, 0, m.bits, m.masks);
    for (int i = 0; i < 6 * 5; ++i) {
      const char texel[4] = {static_cast<char>(255), 0, 0, static_cast<char>(255)};
      bytes.append(texel, m.bits / 8);
    }
    put("old.dds", bytes);
    const auto got = read("old.dds", 1);
    ASSERT_TRUE(got) << got.error().message;
    ASSERT_EQ(got->pictures.size(), 6u);
    EXPECT_EQ(got->color, "sRGB");
    ASSERT_EQ(got->pictures[0].image.channels(), m.channels);
    EXPECT_EQ(got->pictures[5].image.at(0, 0)[m.bgr ? 2 : 0], 1);
    EXPECT_EQ(got->pictures[5].image.at(0, 0)[m.bgr ? 0 : 2], 0);
  }
}

// The image library's decoder of BC6H is another one.
TEST_F(Container, Bc6hAsTheImageLibraryHasIt) {
  std::vector<Picture> faces;
  std::mt19937 random(6);
  std::lognormal_distribution<float> value(0, 2);
  for (int face = 0; face < 6; ++face) {
    Picture picture = make(16, 16, 3, face, 0);
    for (std::size_t i = 0; i < picture.image.value_count(); ++i) picture.image.data()[i] *= 1 + value(random);
    faces.push_back(std::move(picture));
  }
  WriteOptions options;
  options.type = bc6h;
  options.cube = true;
  options.type_given = true;
  const auto report = write_pictures(path("a.dds"), faces, options);
  ASSERT_TRUE(report) << report.error().message;
  const auto ours = read("a.dds");
  ASSERT_TRUE(ours) << ours.error().message;
  const int fd = ::open(path("a.dds").c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_GE(fd, 0);
  {
    auto theirs = open_imageio("dds", fd, {.max_pixels = 1 << 20});
    ASSERT_TRUE(theirs) << theirs.error().message;
    const PictureSpec& spec = (*theirs)->spec().pictures[0];
    ASSERT_EQ(spec.width, 16);
    ASSERT_EQ(spec.height, 96);
    ASSERT_EQ(spec.element, float32);
    const int channels = spec.channels.count();
    ASSERT_GE(channels, 3);
    std::vector<float> strip(static_cast<std::size_t>(16 * 96 * channels));
    ASSERT_TRUE((*theirs)->decode(0, strip.data()));
    for (int y = 0; y < 96; ++y) {
      for (int x = 0; x < 16; ++x) {
        const float* a = ours->pictures[static_cast<std::size_t>(y / 16)].image.at(x, y % 16);
        for (int c = 0; c < 3; ++c) ASSERT_EQ(strip[static_cast<std::size_t>((y * 16 + x) * channels + c)], a[c]);
      }
    }
  }
  ::close(fd);
}

TEST_F(Container, OrientationOfKtx2) {
  WriteOptions options;
  options.type = float32;
  write("a.ktx2", make_levels(3, 2, 3, 1, 1), options);
  const std::string good = bytes_of("a.ktx2");
  const std::size_t at = good.find("KTXorientation") + 15;
  ASSERT_EQ(good.substr(at, 2), "rd");
  const Picture source = make(3, 2, 3, 0, 0);
  const std::tuple<const char*, int, int> cases[] = {{"rd", 0, 0}, {"ru", 0, 1}, {"ld", 2, 0}, {"lu", 2, 1}};
  for (const auto& [text, x, y] : cases) {
    std::string bytes = good;
    bytes.replace(at, 2, text);
    put("b.ktx2", bytes);
    const auto got = read("b.ktx2");
    ASSERT_TRUE(got) << got.error().message;
    EXPECT_EQ(got->pictures[0].image.at(0, 0)[0], source.image.at(x, y)[0]) << text;
  }
}

}  // namespace
}  // namespace envconv
