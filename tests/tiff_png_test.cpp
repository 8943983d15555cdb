// SPDX-License-Identifier: Apache-2.0
// TIFF and PNG, which are written in parts: what is put together is what libtiff, libpng and zlib read.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <zlib.h>

#include <cmath>
#include <random>

#include "deflate.h"
#include "io.h"
#include "io_cases.h"
#include "output_file.h"
#include "stored_pixels.h"
#include "tiff_write.h"

namespace envconv {
namespace {

// Levels of 40x20 down to 1x1, of noise, so that none is made of another.
std::vector<std::vector<Picture>> chain_of(int channels) {
  std::vector<std::vector<Picture>> levels;
  for (int k = 0; k < 6; ++k)
    levels.push_back(
        one(make(std::max(1, 40 >> k), std::max(1, 20 >> k), channels, 0, 1, static_cast<unsigned>(k + 1))));
  return levels;
}

TEST_F(Io, TiffLevels) {
  using enum PixelType;
  struct Case {
    PixelType type;
    int channels;
    const char* compression;
    double tolerance;  // relative of floats, in coded values of integers
  };
  const Case cases[] = {{float32, 1, "", 0},      {float32, 3, "zip", 0},         {float32, 4, "none", 0},
                        {float32, 7, "lzw", 0},   {half, 3, "", 0.0006},          {half, 4, "packbits", 0.0006},
                        {uint16, 1, "zip", 1e-5}, {uint16, 3, "lzw", 1e-5},       {uint16, 4, "none", 1e-4},
                        {uint8, 2, "zip", 0.02},  {uint8, 3, "packbits", 0.0021}, {uint8, 4, "none", 0.02}};
  for (const Case& c : cases) {
    SCOPED_TRACE(std::string(name_of(c.type)) + " " + std::to_string(c.channels) + " " + c.compression);
    const auto levels = chain_of(c.channels);
    WriteOptions write;
    write.type = c.type;
    write.type_given = true;
    write.compression = c.compression;
    write.metadata = {{"envconv:layout", "latlong"}};
    write.verify = true;
    const auto report = write_levels(path("levels.tif"), levels, write);
    ASSERT_TRUE(report.ok()) << report.error().message;
    EXPECT_TRUE(report->warnings.empty());
    ReadOptions read;
    for (read.level = 0; read.level < 6; ++read.level) {
      read.trust_input = read.level % 2 == 0;
      const auto file = read_pictures(path("levels.tif"), read);
      ASSERT_TRUE(file.ok()) << file.error().message;
      EXPECT_TRUE(file->warnings.empty());
      EXPECT_EQ(file->levels, 6);
      EXPECT_EQ(file->metadata.at("envconv:layout"), "latlong");
      const Picture &got = file->pictures[0], &given = levels[static_cast<std::size_t>(read.level)][0];
      EXPECT_EQ(got.type, c.type);
      const bool integer = c.type == uint8 || c.type == uint16;
      EXPECT_LE(worst(given.image, got.image,
                      [&](float a, float b) { return integer ? std::abs(srgb(a) - srgb(b)) : relative(a, b); }),
                c.tolerance);
    }
    EXPECT_EQ(read_pictures(path("levels.tif"), read).error().code, ErrorCode::input);
  }
}

// As if 32 bits did not hold the offsets.
TEST_F(Io, ATiffBeyond4GiB) {
  const auto levels = chain_of(3);
  for (const std::uint64_t largest : {std::uint64_t{0xFFFFFFFF}, std::uint64_t{1000}}) {
    auto output = OutputFile::create(path("big.tif"));
    ASSERT_TRUE(output.ok());
    {
      TiffWriter writer(*output, 40 * 20 * 3 * 4 * 4 / 3, largest);
      WriteReport report;
      report.type = PixelType::float32;
      for (const auto& level : levels) {
        const auto added = writer.add(stored_pixels(level[0], {}, report), {"lzw", "", 64});
        ASSERT_TRUE(added.ok()) << added.error().message;
      }
      ASSERT_TRUE(writer.finish().ok());
    }
    ASSERT_TRUE(output->commit().ok());
    EXPECT_EQ(bytes_of(path("big.tif")).substr(0, 4), std::string(largest > 1000 ? "II*\0" : "II+\0", 4));
    for (int level = 0; level < 6; ++level) {
      ReadOptions read;
      read.level = level;
      const auto file = read_pictures(path("big.tif"), read);
      ASSERT_TRUE(file.ok()) << file.error().message;
      EXPECT_EQ(file->levels, 6);
      EXPECT_EQ(worst(file->pictures[0].image, levels[static_cast<std::size_t>(level)][0].image, relative), 0);
    }
  }
}

// Strips and bands, many of them and one that is cut, are put together by libtiff and libpng.
TEST_F(Io, LargePngAndTiff) {
  using enum PixelType;
  struct Case {
    const char* file;
    PixelType type;
    int channels;
    const char* compression;
  };
  for (const Case& c : {Case{"a.png", uint8, 3, ""},
                        {"b.png", uint16, 4, ""},
                        {"c.png", uint8, 1, "0"},
                        {"d.png", uint16, 3, "1"},
                        {"e.png", uint8, 4, "9"},
                        {"a.tif", uint8, 3, "zip"},
                        {"b.tif", uint16, 4, "zip"},
                        {"c.tif", half, 3, "zip"},
                        {"d.tif", float32, 6, "zip"},
                        {"e.tif", float32, 3, "lzw"},
                        {"f.tif", uint8, 1, "packbits"},
                        {"g.tif", half, 4, "none"}}) {
    SCOPED_TRACE(c.file);
    const auto pictures = one(make(1021, 769, c.channels));
    WriteOptions write;
    write.type = c.type;
    write.type_given = true;
    write.compression = c.compression;
    ASSERT_TRUE(write_pictures(path(c.file), pictures, write).ok());
    const auto file = read_pictures(path(c.file), {});
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_EQ(file->pictures[0].type, c.type);
    const double steps = c.type == uint8 ? 255 : 65535;
    const bool alpha = c.channels == 4;
    EXPECT_LE(worst(pictures[0].image, file->pictures[0].image,
                    [&](float a, float b) {
                      return c.type == float32 ? std::abs(a - b)
                             : c.type == half  ? relative(a, b) * 1000
                             : alpha           ? std::abs(a - b) * steps / 8
                                               : std::abs(srgb(a) - srgb(b)) * steps;
                    }),
              c.type == float32 ? 0 : 0.51);
    const std::string bytes = bytes_of(path(c.file));
    tbb::task_arena(1).execute([&] { ASSERT_TRUE(write_pictures(path(c.file), pictures, write).ok()); });
    EXPECT_EQ(bytes_of(path(c.file)), bytes);
  }
}

// Parts of a stream, put behind each other, are what zlib inflates to all bytes.
TEST(Deflate, PartsAreAStream) {
  std::mt19937 random(7);
  Deflater deflater;
  for (const int level : {0, 1, 6, 9, 12}) {
    for (const unsigned kinds : {1u, 2u, 20u, 256u}) {
      std::vector<std::uint8_t> all, stream, part;
      for (const std::size_t size : {0, 1, 2, 3, 5, 70, 1000, 32768, 40000, 300000, 9}) {
        std::vector<std::uint8_t> bytes(size);
        for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random() % kinds);
        deflater.part(bytes, level, size == 9, part);
        stream.insert(stream.end(), part.begin(), part.end());
        all.insert(all.end(), bytes.begin(), bytes.end());
      }
      std::vector<std::uint8_t> back(all.size() + 1);
      z_stream z{};
      ASSERT_EQ(inflateInit2(&z, -15), Z_OK);
      z.next_in = stream.data(), z.avail_in = static_cast<uInt>(stream.size());
      z.next_out = back.data(), z.avail_out = static_cast<uInt>(back.size());
      EXPECT_EQ(inflate(&z, Z_FINISH), Z_STREAM_END);
      EXPECT_EQ(z.avail_in, 0u);
      back.resize(z.total_out);
      inflateEnd(&z);
      EXPECT_EQ(back, all) << level << " " << kinds;
    }
  }
}

}  // namespace
}  // namespace envconv
