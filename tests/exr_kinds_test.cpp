// SPDX-License-Identifier: Apache-2.0
// What an OpenEXR file can be: tiles, levels, windows, channels and attributes, as OpenEXR itself writes them.
#include <ImfChannelList.h>
#include <ImfDeepScanLineOutputFile.h>
#include <ImfEnvmapAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIntAttribute.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfTileDescriptionAttribute.h>
#include <ImfTiledOutputFile.h>
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <fstream>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "io.h"
#include "io_cases.h"

namespace envconv {
namespace {

float last_digits(std::int64_t v) { return static_cast<float>((v % 1000 + 1000) % 1000); }

// Writes channels of 1 float each, whose value is 1000 * channel + 100 * y + x in the data window's coordinates, of
// which the last three digits count.
void write_raw(const std::string& path, Imf::Header header, const std::vector<std::string>& names,
               Imf::LevelMode levels, bool tiled) {
  for (const std::string& name : names) header.channels().insert(name, Imf::Channel(Imf::FLOAT));
  const auto box = header.dataWindow();
  const std::int64_t width = box.max.x - std::int64_t{box.min.x} + 1, height = box.max.y - std::int64_t{box.min.y} + 1;
  std::vector<std::vector<float>> planes;
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < names.size(); ++c) {
    std::vector<float>& plane = planes.emplace_back(static_cast<std::size_t>(width * height));
    for (std::int64_t y = 0; y < height; ++y) {
      for (std::int64_t x = 0; x < width; ++x) {
        plane[static_cast<std::size_t>(y * width + x)] =
            static_cast<float>(1000 * c) + 100.f * last_digits(y + box.min.y) + last_digits(x + box.min.x);
      }
    }
  }
  for (std::size_t c = 0; c < names.size(); ++c) {
    const auto origin = reinterpret_cast<std::uintptr_t>(planes[c].data()) -
                        static_cast<std::uintptr_t>(box.min.y * width + box.min.x) * 4;
    frame.insert(names[c],
                 Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(origin), 4, static_cast<std::size_t>(width) * 4));
  }
  if (!tiled) {
    Imf::OutputFile file(path.c_str(), header, 0);
    file.setFrameBuffer(frame);
    file.writePixels(static_cast<int>(height));
    return;
  }
  header.setTileDescription(Imf::TileDescription(16, 16, levels));
  Imf::TiledOutputFile file(path.c_str(), header, 0);
  file.setFrameBuffer(frame);
  for (int level = 0; level < file.numLevels(); ++level) {
    // Smaller levels hold the corner of the picture: nobody reads them.
    file.writeTiles(0, file.numXTiles(level) - 1, 0, file.numYTiles(level) - 1, level);
  }
}

Imf::Header windows(Imath::Box2i display, Imath::Box2i data) { return Imf::Header(display, data); }

TEST_F(Io, ExrTilesAndLevels) {
  const Imath::Box2i box({0, 0}, {49, 29});
  for (const Imf::LevelMode mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS}) {
    write_raw(path("t.exr"), windows(box, box), {"R", "G", "B"}, mode, true);
    for (const bool trust : {false, true}) {
      ReadOptions read;
      read.trust_input = trust;
      const auto file = read_pictures(path("t.exr"), read);
      ASSERT_TRUE(file.ok()) << file.error().message;
      EXPECT_EQ(file->levels, mode == Imf::ONE_LEVEL ? 1 : 6);
      const Image& image = file->pictures[0].image;
      for (int y = 0; y < 30; ++y) {
        for (int x = 0; x < 50; ++x) {
          // Stored as B, G, R; 2000 is the red one's.
          ASSERT_EQ(image.at(x, y)[0], 100.f * y + x);
          ASSERT_EQ(image.at(x, y)[2], 2000 + 100.f * y + x);
        }
      }
    }
  }
}

TEST_F(Io, ExrLinesWithADescriptionOfTiles) {
  // What a program leaves there that copies the header of a tiled file: nothing is made of it.
  const Imath::Box2i box({0, 0}, {49, 29});
  for (const Imf::Compression compression : {Imf::ZIP_COMPRESSION, Imf::PXR24_COMPRESSION}) {
    for (const unsigned height : {64u, 8u, 0u}) {
      Imf::Header header = windows(box, box);
      header.compression() = compression;
      header.insert("tiles", Imf::TileDescriptionAttribute(Imf::TileDescription(64, height, Imf::MIPMAP_LEVELS)));
      write_raw(path("l.exr"), header, {"Y"}, Imf::ONE_LEVEL, false);
      // OpenEXR itself says in the second byte of the version that these are tiles, and could not read them.
      std::string bytes = bytes_of(path("l.exr"));
      ASSERT_EQ(bytes[5], 2);
      bytes[5] = 0;
      std::ofstream(path("l.exr"), std::ios::binary) << bytes;
      const auto file = read_pictures(path("l.exr"), {});
      ASSERT_TRUE(file.ok()) << file.error().message;
      EXPECT_EQ(file->levels, 1);
      EXPECT_EQ(*file->pictures[0].image.at(7, 9), 907);
      EXPECT_EQ(*file->pictures[0].image.at(49, 29), 2949);
    }
  }
}

TEST_F(Io, ExrWindows) {
  const auto read = [&](Imath::Box2i display, Imath::Box2i data, bool tiled) {
    write_raw(path("w.exr"), windows(display, data), {"Y"}, Imf::ONE_LEVEL, tiled);
    return read_pictures(path("w.exr"), {});
  };
  for (const bool tiled : {false, true}) {
    // Overscan on all sides: the display window is the picture, with a warning.
    auto file = read({{0, 0}, {19, 9}}, {{-3, -5}, {30, 20}}, tiled);
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_EQ(file->pictures[0].image.width(), 20);
    EXPECT_EQ(file->pictures[0].image.height(), 10);
    EXPECT_EQ(*file->pictures[0].image.at(0, 0), 0);
    EXPECT_EQ(*file->pictures[0].image.at(7, 9), 907);
    ASSERT_EQ(file->warnings.size(), 1u);
    EXPECT_NE(file->warnings[0].find("34x26"), std::string::npos) << file->warnings[0];
    // Overscan above and below only.
    file = read({{0, 0}, {19, 9}}, {{0, -100}, {19, 20}}, tiled);
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_EQ(*file->pictures[0].image.at(7, 9), 907);
    // The same size elsewhere is the same picture.
    file = read({{0, 0}, {19, 9}}, {{100, 50}, {119, 59}}, tiled);
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_TRUE(file->warnings.empty());
    EXPECT_EQ(*file->pictures[0].image.at(7, 9), 5900 + 107);
    // The same size one column to the side is the same picture, with a warning.
    file = read({{0, 0}, {19, 9}}, {{1, 0}, {20, 9}}, tiled);
    ASSERT_TRUE(file.ok()) << file.error().message;
    ASSERT_EQ(file->warnings.size(), 1u);
    EXPECT_NE(file->warnings[0].find("20x10 at (1, 0)"), std::string::npos) << file->warnings[0];
    EXPECT_EQ(*file->pictures[0].image.at(7, 9), 908);
    // A part is not an environment; both windows are named.
    file = read({{0, 0}, {19, 9}}, {{0, 0}, {9, 9}}, tiled);
    ASSERT_FALSE(file.ok());
    EXPECT_EQ(file.error().code, ErrorCode::input);
    EXPECT_NE(file.error().message.find("10x10"), std::string::npos) << file.error().message;
    EXPECT_NE(file.error().message.find("20x10"), std::string::npos);
  }
  // An origin far away, of chunks that are unpacked here and of those that OpenEXR unpacks.
  for (const int far : {1000000000, -1000000000}) {
    const Imath::Box2i box({far, far}, {far + 19, far + 9}), wider({far - 5, far}, {far + 30, far + 9});
    for (const Imf::Compression compression : {Imf::ZIP_COMPRESSION, Imf::PXR24_COMPRESSION}) {
      for (const Imath::Box2i& data : {box, wider}) {
        Imf::Header header = windows(box, data);
        header.compression() = compression;
        write_raw(path("far.exr"), header, {"Y"}, Imf::ONE_LEVEL, false);
        const auto file = read_pictures(path("far.exr"), {});
        ASSERT_TRUE(file.ok()) << file.error().message;
        EXPECT_EQ(file->pictures[0].image.width(), 20);
        EXPECT_EQ(*file->pictures[0].image.at(0, 0), 0);
        EXPECT_EQ(*file->pictures[0].image.at(7, 9), 907);
      }
    }
  }
}

TEST_F(Io, ExrChannels) {
  const Imath::Box2i box({0, 0}, {7, 3});
  const auto read = [&](const std::vector<std::string>& names) {
    write_raw(path("c.exr"), windows(box, box), names, Imf::ONE_LEVEL, false);
    return read_pictures(path("c.exr"), {});
  };
  using Names = std::vector<std::string>;
  const std::tuple<Names, Names, const char*> cases[] = {
      {{"R", "G", "B"}, {"R", "G", "B"}, ""},
      {{"A", "R", "G", "B", "Z"}, {"R", "G", "B", "A"}, "left out: Z"},
      {{"r", "g", "b"}, {"R", "G", "B"}, ""},
      {{"Y"}, {"Y"}, ""},
      {{"A", "Y"}, {"Y", "A"}, ""},
      {{"diffuse.R", "diffuse.G", "diffuse.B", "depth.Z"}, {"R", "G", "B"}, "left out: depth.Z"},
      {{"R", "G", "B", "sun.R", "sun.G", "sun.B"}, {"R", "G", "B"}, "left out: sun.B, sun.G, sun.R"},
      {{"X", "Y", "Z"}, {"X", "Y", "Z"}, ""},
      {{"400nm", "500nm", "600nm", "700nm", "A"}, {"400nm", "500nm", "600nm", "700nm", "A"}, ""},
  };
  for (const auto& [stored, expected, warning] : cases) {
    const auto file = read(stored);
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_EQ(file->pictures[0].channels.names, expected);
    const auto alpha = std::find(expected.begin(), expected.end(), "A");
    EXPECT_EQ(file->pictures[0].channels.alpha, alpha == expected.end() ? -1 : alpha - expected.begin());
    EXPECT_EQ(file->warnings.empty(), !*warning);
    if (*warning) {
      EXPECT_NE(file->warnings.at(0).find(warning), std::string::npos) << file->warnings[0];
    }
  }
  Names many;
  for (int i = 0; i < 65; ++i) many.push_back("c" + std::to_string(i));
  auto file = read(many);
  ASSERT_FALSE(file.ok());
  EXPECT_NE(file.error().message.find("65 channels"), std::string::npos) << file.error().message;
  many.pop_back();
  EXPECT_TRUE(read(many).ok());
}

TEST_F(Io, ExrKindsThatAreRefused) {
  const Imath::Box2i box({0, 0}, {7, 3});
  {
    Imf::Header header(box, box);
    header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
    header.setType(Imf::DEEPSCANLINE);
    header.compression() = Imf::ZIPS_COMPRESSION;
    Imf::DeepScanLineOutputFile file(path("deep.exr").c_str(), header, 0);
  }
  auto file = read_pictures(path("deep.exr"), {});
  ASSERT_FALSE(file.ok());
  EXPECT_NE(file.error().message.find("deep images are not environment maps"), std::string::npos)
      << file.error().message;
  {
    Imf::Header header(box, box);
    header.channels().insert("Y", Imf::Channel(Imf::HALF));
    header.channels().insert("RY", Imf::Channel(Imf::HALF, 2, 2));
    header.channels().insert("BY", Imf::Channel(Imf::HALF, 2, 2));
    Imf::OutputFile file(path("chroma.exr").c_str(), header, 0);
  }
  file = read_pictures(path("chroma.exr"), {});
  ASSERT_FALSE(file.ok());
  EXPECT_NE(file.error().message.find("luminance and subsampled chroma"), std::string::npos) << file.error().message;
  {
    Imf::Header header(box, box);
    header.channels().insert("R", Imf::Channel(Imf::HALF));
    header.channels().insert("G", Imf::Channel(Imf::HALF));
    header.channels().insert("B", Imf::Channel(Imf::HALF, 2, 2));
    Imf::OutputFile file(path("thin.exr").c_str(), header, 0);
  }
  file = read_pictures(path("thin.exr"), {});
  ASSERT_FALSE(file.ok());
  EXPECT_NE(file.error().message.find("channel B is subsampled"), std::string::npos) << file.error().message;
  {
    // A type that is none, and what it would do to a terminal.
    std::vector<Picture> parts;
    for (const char* name : {"px", "nx"}) {
      parts.push_back(make(8, 8, 3));
      parts.back().name = name;
    }
    ASSERT_TRUE(write_pictures(path("type.exr"), std::move(parts), {}).ok());
    std::string bytes = bytes_of(path("type.exr"));
    const std::size_t at = bytes.find("scanlineimage");
    ASSERT_NE(at, std::string::npos);
    bytes.replace(at, 4, "\x1b[1m");
    std::ofstream(path("type.exr"), std::ios::binary) << bytes;
  }
  file = read_pictures(path("type.exr"), {});
  ASSERT_FALSE(file.ok());
  EXPECT_EQ(file.error().code, ErrorCode::input);
  EXPECT_NE(file.error().message.find("type \\x1b[1mlineimage, which"), std::string::npos) << file.error().message;
  {
    // Begun and never finished.
    Imf::Header header(box, box);
    header.channels().insert("Y", Imf::Channel(Imf::HALF));
    Imf::OutputFile file(path("begun.exr").c_str(), header, 0);
  }
  file = read_pictures(path("begun.exr"), {});
  ASSERT_FALSE(file.ok());
  EXPECT_NE(file.error().message.find("truncated or damaged"), std::string::npos) << file.error().message;
}

TEST_F(Io, PizOfFewAndManyValues) {
  // Its wavelet is another one where there are more than 2^14 values; of only one there is next to nothing to code.
  constexpr int width = 331, height = 203;
  std::mt19937 random(7);
  for (const std::uint32_t values : {1u, 2u, 16383u, 16384u, 16385u, 31744u}) {
    std::vector<half> halves(width * height), read;
    for (std::size_t i = 0; i < halves.size(); ++i)
      halves[i].setBits(static_cast<std::uint16_t>(i < values ? i : random() % values));
    {
      Imf::Header header(width, height);
      header.channels().insert("Y", Imf::Channel(Imf::HALF));
      header.compression() = Imf::PIZ_COMPRESSION;
      header.setTileDescription({300, 200, Imf::ONE_LEVEL});  // one tile has them all
      Imf::TiledOutputFile file(path("piz.exr").c_str(), header, 0);
      Imf::FrameBuffer frame;
      frame.insert("Y", Imf::Slice(Imf::HALF, reinterpret_cast<char*>(halves.data()), 2, width * 2));
      file.setFrameBuffer(frame);
      file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
    }
    const auto file = read_pictures(path("piz.exr"), {});
    ASSERT_TRUE(file.ok()) << file.error().message;
    const Image& image = file->pictures[0].image;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x)
        ASSERT_EQ(image.at(x, y)[0], static_cast<float>(halves[static_cast<std::size_t>(y * width + x)])) << values;
    }
  }
}

TEST_F(Io, EnvmapAttribute) {
  for (const char* kind : {"latlong", "cube"}) {
    WriteOptions write;
    write.metadata = {{"envmap", kind}};
    ASSERT_TRUE(write_pictures(path("e.exr"), one(make(8, 48, 3)), write).ok());
    const auto file = read_pictures(path("e.exr"), {});
    ASSERT_TRUE(file.ok());
    EXPECT_EQ(file->metadata.at("envmap"), kind);
    // A real attribute of its own type, not a string of that name.
    EXPECT_NE(bytes_of(path("e.exr")).find(std::string("envmap\0envmap\0", 14)), std::string::npos);
  }
}

}  // namespace
}  // namespace envconv
