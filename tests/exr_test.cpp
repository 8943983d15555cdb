// SPDX-License-Identifier: Apache-2.0
// OpenEXR files whose chunks we pack and unpack: OpenEXR reads what we write, we read what OpenEXR writes, and chunks
// that are not what they should be are errors.
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfTiledInputPart.h>
#include <ImfTiledOutputFile.h>
#include <gtest/gtest.h>
#include <half.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#include <hwy/highway.h>

#include "exr_zip.h"
#include "io.h"
#include "row_kernels.h"
#include "temporary_folder.h"

namespace envconv {
namespace {

// --- rows ----------------------------------------------------------------------------------------------------------

// Calls f with each SIMD target of this processor in use.
template <class F>
void on_all_targets(F&& f) {
  hwy::SetSupportedTargetsForTest(0);
  const std::int64_t targets = hwy::SupportedTargets() & HWY_TARGETS;
  for (int bit = 0; bit < 63; ++bit) {
    const std::int64_t target = std::int64_t{1} << bit;
    if ((targets & target) == 0) continue;
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    f();
  }
  hwy::SetSupportedTargetsForTest(0);
}

std::uint32_t bits_of(float v) {
  std::uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  return bits;
}

TEST(Rows, EveryHalfIsExact) {
  std::vector<std::uint16_t> codes(65536);
  for (std::size_t i = 0; i < codes.size(); ++i) codes[i] = static_cast<std::uint16_t>(i);
  on_all_targets([&] {
    std::vector<float> values(codes.size());
    halves_to_floats(codes.data(), codes.size(), values.data());
    for (std::size_t i = 0; i < codes.size(); ++i) {
      half expected;
      expected.setBits(codes[i]);
      ASSERT_EQ(bits_of(values[i]), bits_of(expected)) << i;
    }
  });
}

TEST(Rows, FloatsRoundToTheNearestHalf) {
  // Halves, the middles between them, and what is next to either.
  std::vector<float> values{0.f,     -0.f,     1e-40f,   1e38f,     -1e38f, 65504.f, 65519.99f,
                            65520.f, -65520.f, INFINITY, -INFINITY, NAN,    -NAN};
  for (int code = 0; code < 0x7C00; ++code) {
    half low, high;
    low.setBits(static_cast<std::uint16_t>(code)), high.setBits(static_cast<std::uint16_t>(code + 1));
    const float middle = code == 0x7BFF ? 65520.f : (static_cast<float>(low) + static_cast<float>(high)) / 2;
    for (const float v : {static_cast<float>(low), middle}) {
      for (const float to : {0.f, v, INFINITY}) {
        values.push_back(std::nextafter(v, to));
        values.push_back(-values.back());
      }
    }
  }
  values.resize(values.size() / 16 * 16 + 5, 1.f);  // no whole number of vectors
  on_all_targets([&] {
    std::vector<std::uint16_t> codes(values.size());
    HalfCounts counts;
    floats_to_halves(values.data(), values.size(), codes.data(), counts);
    std::int64_t high = 0, nonfinite = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const float v = values[i];
      high += std::isfinite(v) && std::abs(v) >= 65520.f;
      nonfinite += !std::isfinite(v);
      const float kept = std::isnan(v) ? 0.f : std::abs(v) > 65504.f ? std::copysign(65504.f, v) : v;
      ASSERT_EQ(codes[i], half(kept).bits()) << v;
    }
    EXPECT_EQ(counts.high, high);
    EXPECT_EQ(counts.nonfinite, nonfinite);
  });
}

TEST(Rows, BytesAreSplitAndJoined) {
  std::mt19937 random(3);
  for (std::size_t count = 0; count < 400; ++count) {
    std::vector<std::uint8_t> bytes(count), expected;
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    for (const std::size_t first : {0, 1}) {
      for (std::size_t i = first; i < count; i += 2) expected.push_back(bytes[i]);
    }
    for (std::size_t i = count; i-- > 1;) expected[i] = static_cast<std::uint8_t>(expected[i] - expected[i - 1] + 128);
    on_all_targets([&] {
      std::vector<std::uint8_t> split(count), joined(count);
      split_bytes(bytes.data(), count, split.data());
      ASSERT_EQ(split, expected) << count;
      join_bytes(split.data(), count, joined.data());
      ASSERT_EQ(joined, bytes) << count;
    });
  }
}

// --- pictures ------------------------------------------------------------------------------------------------------

class Exr : public testing::Test {
 protected:
  static void SetUpTestSuite() { start_isolated_reader(); }
  TemporaryFolder folder_;
};

// Whole numbers that every type holds, smooth in places and rough in others, as photographs are.
float value_at(std::int64_t x, std::int64_t y, int channel, int level = 0) {
  const std::int64_t rough = x / 20 % 2 == 0 ? (x * 7919 + y * 104729) % 97 : 0;
  return static_cast<float>((x + 3 * y + 100 * channel + 40 * level + rough) % 1024);
}

struct StoredChannel {
  const char* name;
  Imf::PixelType type;
};
constexpr StoredChannel kStored[] = {
    {"A", Imf::HALF}, {"B", Imf::FLOAT}, {"G", Imf::HALF}, {"R", Imf::UINT}, {"Z", Imf::FLOAT}};
constexpr int kPlace[] = {3, 2, 1, 0};  // among R, G, B and A

// The channels' values of a window, with a slice for each.
class Planes {
 public:
  Planes(Imath::Box2i window, int level) {
    const std::int64_t width = window.max.x - window.min.x + 1;
    for (int c = 0; c < 5; ++c) {
      const StoredChannel& channel = kStored[c];
      const std::size_t element = channel.type == Imf::HALF ? 2 : 4;
      std::vector<char>& bytes = bytes_[c];
      for (std::int64_t y = window.min.y; y <= window.max.y; ++y) {
        for (std::int64_t x = window.min.x; x <= window.max.x; ++x) {
          const float value = value_at(x, y, c, level);
          const half as_half(value);
          const auto as_integer = static_cast<std::uint32_t>(std::max(value, 0.f));  // less is overscan
          const void* from = channel.type == Imf::HALF   ? static_cast<const void*>(&as_half)
                             : channel.type == Imf::UINT ? static_cast<const void*>(&as_integer)
                                                         : &value;
          bytes.insert(bytes.end(), static_cast<const char*>(from), static_cast<const char*>(from) + element);
        }
      }
      const std::int64_t origin = (window.min.y * width + window.min.x) * static_cast<std::int64_t>(element);
      frame.insert(channel.name, Imf::Slice(channel.type,
                                            reinterpret_cast<char*>(reinterpret_cast<std::uintptr_t>(bytes.data()) -
                                                                    static_cast<std::uintptr_t>(origin)),
                                            element, static_cast<std::size_t>(width) * element));
    }
  }
  Imf::FrameBuffer frame;

 private:
  std::vector<char> bytes_[5];
};

Imf::Header header_of(Imath::Box2i display, Imath::Box2i data, Imf::Compression compression, Imf::LineOrder order) {
  Imf::Header header(display, data);
  for (const StoredChannel& channel : kStored) header.channels().insert(channel.name, Imf::Channel(channel.type));
  header.compression() = compression;
  header.lineOrder() = order;
  return header;
}

// The picture has the values of the display window, in its coordinates.
void expect_values(const std::string& path, Imath::Box2i display, int picture = 0, int level = 0) {
  for (const bool trust : {false, true}) {
    ReadOptions read;
    read.trust_input = trust;
    read.threads = 3;
    read.level = level;
    const auto file = read_pictures(path, read);
    ASSERT_TRUE(file.ok()) << file.error().message;
    const Image& image = file->pictures[static_cast<std::size_t>(picture)].image;
    ASSERT_EQ(image.channels(), 4);
    ASSERT_EQ(image.width(), display.max.x - display.min.x + 1);
    ASSERT_EQ(image.height(), display.max.y - display.min.y + 1);
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        for (int c = 0; c < 4; ++c) {
          ASSERT_EQ(image.at(x, y)[kPlace[c]], value_at(x + display.min.x, y + display.min.y, c, level))
              << x << ' ' << y << ' ' << kStored[c].name;
        }
      }
    }
  }
}

constexpr Imf::Compression kOurs[] = {Imf::NO_COMPRESSION, Imf::RLE_COMPRESSION, Imf::ZIPS_COMPRESSION,
                                      Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION};

TEST_F(Exr, LinesOfOpenExr) {
  const Imath::Box2i whole({0, 0}, {102, 50}), moved({-40, -9}, {62, 37}), inner({-5, 3}, {20, 30});
  for (const Imf::Compression compression : kOurs) {
    for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y}) {
      for (const auto& [data, display] : {std::pair{whole, whole}, {moved, moved}, {moved, inner}}) {
        SCOPED_TRACE(testing::Message() << compression << ' ' << order << ' ' << data.min.x << ' ' << display.min.x);
        const Planes planes(data, 0);
        {
          Imf::OutputFile file(folder_.path("a.exr").c_str(), header_of(display, data, compression, order), 0);
          file.setFrameBuffer(planes.frame);
          file.writePixels(data.max.y - data.min.y + 1);
        }
        expect_values(folder_.path("a.exr"), display);
      }
    }
  }
}

TEST_F(Exr, TilesAndLevelsOfOpenExr) {
  const Imath::Box2i box({-3, 7}, {98, 57});
  for (const Imf::Compression compression : kOurs) {
    for (const Imf::LevelMode mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS}) {
      for (const Imf::LevelRoundingMode rounding : {Imf::ROUND_DOWN, Imf::ROUND_UP}) {
        SCOPED_TRACE(testing::Message() << compression << ' ' << mode << ' ' << rounding);
        Imf::Header header = header_of(box, box, compression, Imf::RANDOM_Y);
        header.setTileDescription({32, 24, mode, rounding});
        std::vector<Imath::Box2i> windows;
        {
          Imf::TiledOutputFile file(folder_.path("t.exr").c_str(), header, 0);
          for (int ly = 0; ly < file.numYLevels(); ++ly) {
            for (int lx = 0; lx < file.numXLevels(); ++lx) {
              if (mode != Imf::RIPMAP_LEVELS && lx != ly) continue;
              const Imath::Box2i window = file.dataWindowForLevel(lx, ly);
              if (lx == ly) windows.push_back(window);
              const Planes planes(window, lx);
              file.setFrameBuffer(planes.frame);
              // From the last to the first: the table, not the order, says where they are.
              for (int y = file.numYTiles(ly) - 1; y >= 0; --y) {
                for (int x = file.numXTiles(lx) - 1; x >= 0; --x) file.writeTile(x, y, lx, ly);
              }
            }
          }
        }
        const std::size_t readable = mode == Imf::MIPMAP_LEVELS ? windows.size() : 1;
        for (std::size_t level = 0; level < readable; ++level) {
          expect_values(folder_.path("t.exr"), windows[level], 0, static_cast<int>(level));
        }
      }
    }
  }
}

TEST_F(Exr, PartsOfOpenExr) {
  // The offset tables of parts follow each other, so what comes before tells where a part's own begins.
  const Imath::Box2i box({0, 0}, {69, 40});
  std::vector<Imf::Header> headers;
  for (const Imf::Compression compression : {Imf::PIZ_COMPRESSION, Imf::ZIP_COMPRESSION, Imf::NO_COMPRESSION}) {
    headers.push_back(header_of(box, box, compression, Imf::INCREASING_Y));
    headers.back().setName("part" + std::to_string(headers.size()));
    headers.back().setType(Imf::SCANLINEIMAGE);
  }
  const Planes planes(box, 0);
  {
    Imf::MultiPartOutputFile file(folder_.path("p.exr").c_str(), headers.data(), 3);
    for (int part = 0; part < 3; ++part) {
      Imf::OutputPart lines(file, part);
      lines.setFrameBuffer(planes.frame);
      lines.writePixels(41);
    }
  }
  for (int part = 0; part < 3; ++part) expect_values(folder_.path("p.exr"), box, part);
}

Picture picture_of(int width, int height, const std::vector<std::string>& names, int level) {
  Picture picture;
  picture.channels.names = names;
  picture.image = Image(width, height, static_cast<int>(names.size()));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < picture.image.channels(); ++c) picture.image.at(x, y)[c] = value_at(x, y, c, level);
    }
  }
  return picture;
}

// OpenEXR finds the values in a level of a part.
void expect_part(Imf::MultiPartInputFile& file, int number, const Picture& expected, int level) {
  const int width = expected.image.width(), height = expected.image.height();
  const std::size_t channels = expected.channels.names.size();
  Image image(width, height, static_cast<int>(channels));
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < channels; ++c) {
    frame.insert(expected.channels.names[c], Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(image.data() + c),
                                                        channels * 4, static_cast<std::size_t>(width) * channels * 4));
  }
  ASSERT_TRUE(file.partComplete(number));
  if (file.header(number).hasTileDescription()) {
    Imf::TiledInputPart part(file, number);
    ASSERT_LT(level, part.numLevels());
    part.setFrameBuffer(frame);
    part.readTiles(0, part.numXTiles(level) - 1, 0, part.numYTiles(level) - 1, level);
  } else {
    Imf::InputPart part(file, number);
    part.setFrameBuffer(frame);
    part.readPixels(0, height - 1);
  }
  for (std::size_t i = 0; i < image.value_count(); ++i) {
    ASSERT_EQ(image.data()[i], expected.image.data()[i]) << i << " of part " << number << " level " << level;
  }
}

TEST_F(Exr, OpenExrReadsLevelsAndParts) {
  // Names in no order, and one longer than old files may have.
  const std::vector<std::string> names{"R", "G", "B", "a.channel.whose.name.has.more.than.31.letters"};
  for (const char* compression : {"none", "zips", "zip", "zip:1", "zip:9"}) {
    for (const PixelType type : {PixelType::half, PixelType::float32, PixelType::uint32}) {
      for (const std::size_t parts : {1, 3}) {
        for (const int level_count : {1, 4}) {
          SCOPED_TRACE(testing::Message() << compression << ' ' << name_of(type) << ' ' << parts << ' ' << level_count);
          std::vector<std::vector<Picture>> levels(static_cast<std::size_t>(level_count));
          for (int level = 0; level < level_count; ++level) {
            for (std::size_t part = 0; part < parts; ++part) {
              levels[static_cast<std::size_t>(level)].push_back(picture_of(150 >> level, 83 >> level, names, level));
            }
          }
          WriteOptions write;
          write.type = type, write.type_given = true;
          write.compression = compression;
          std::string bytes;
          for (const std::size_t threads : {1, 4}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            const auto report = write_levels(folder_.path("w.exr"), levels, write);
            ASSERT_TRUE(report.ok()) << report.error().message;
            const std::string now = folder_.bytes_of("w.exr");
            EXPECT_TRUE(bytes.empty() || now == bytes);
            bytes = now;
          }
          Imf::MultiPartInputFile file(folder_.path("w.exr").c_str(), 0, false);
          ASSERT_EQ(file.parts(), static_cast<int>(parts));
          for (std::size_t part = 0; part < parts; ++part) {
            for (int level = 0; level < level_count; ++level) {
              expect_part(file, static_cast<int>(part), levels[static_cast<std::size_t>(level)][part], level);
            }
          }
        }
      }
    }
  }
}

// Noise does not deflate: chunks are stored as they are, as OpenEXR does.
TEST_F(Exr, NoiseIsStored) {
  std::mt19937 random(5);
  std::vector<Picture> pictures;
  pictures.push_back(picture_of(64, 40, {"Y"}, 0));
  for (std::size_t i = 0; i < pictures[0].image.value_count(); ++i) {
    const std::uint32_t bits = random() & 0xBFFFFFFFu;  // no infinity and no NaN
    std::memcpy(pictures[0].image.data() + i, &bits, sizeof bits);
  }
  WriteOptions write;
  write.type = PixelType::float32, write.type_given = true;
  ASSERT_TRUE(write_pictures(folder_.path("n.exr"), pictures, write).ok());
  EXPECT_GE(folder_.bytes_of("n.exr").size(), 64u * 40 * 4);
  Imf::MultiPartInputFile file(folder_.path("n.exr").c_str(), 0, false);
  expect_part(file, 0, pictures[0], 0);
  const auto read = read_pictures(folder_.path("n.exr"), {});
  ASSERT_TRUE(read.ok()) << read.error().message;
  EXPECT_EQ(std::memcmp(read->pictures[0].image.data(), pictures[0].image.data(), 64 * 40 * 4), 0);
}

// --- damage --------------------------------------------------------------------------------------------------------

TEST_F(Exr, DamagedChunksAreErrors) {
  std::vector<Picture> pictures;
  pictures.push_back(picture_of(60, 40, {"R", "G", "B"}, 0));  // chunks of 16, 16 and 8 lines
  ASSERT_TRUE(write_pictures(folder_.path("good.exr"), pictures, {}).ok());
  const std::string good = folder_.bytes_of("good.exr");
  // One attribute's end and the header's, where the three offsets begin; the first chunk follows them.
  const auto chunk = [&](int number) {
    std::uint64_t offset;
    for (std::size_t at = 8; at + 24 < good.size(); ++at) {
      std::memcpy(&offset, &good[at], 8);
      if (offset == at + 24) {
        std::memcpy(&offset, &good[at + 8 * static_cast<std::size_t>(number)], 8);
        return std::pair(at, static_cast<std::size_t>(offset));
      }
    }
    return std::pair(std::size_t{0}, std::size_t{0});
  };
  const auto [table, first] = chunk(0);
  ASSERT_GT(table, 0u);
  const std::size_t second = chunk(1).second, third = chunk(2).second;
  const auto with = [&](std::size_t at, auto value) {
    std::string bytes = good;
    std::memcpy(&bytes[at], &value, sizeof value);
    return bytes;
  };
  // A chunk that unpacks to fewer bytes, or to more.
  const auto repacked = [&](std::size_t size) {
    std::vector<std::uint8_t> pixels(size, 7);
    ZipCodec codec;
    const auto packed = codec.pack(pixels, 4);
    std::string bytes = good.substr(0, third + 8) + std::string(packed.begin(), packed.end());
    const auto count = static_cast<std::int32_t>(packed.size());
    std::memcpy(&bytes[third + 4], &count, sizeof count);
    return bytes;
  };
  constexpr std::size_t kLast = 60 * 8 * 3 * 2;
  const std::pair<const char*, std::string> cases[] = {
      {"another line", with(first, 1)},
      {"a line of the next chunk", with(first, 16)},
      {"negative size", with(first + 4, -1)},
      {"huge size", with(first + 4, 0x7FFFFFFF)},
      {"no bytes", with(first + 4, 0)},
      {"size of the pixels", with(third + 4, static_cast<std::int32_t>(kLast))},
      {"fewer bytes", with(first + 4, 40)},
      {"offsets exchanged", with(table, static_cast<std::uint64_t>(second))},
      {"offset beyond the end", with(table, std::uint64_t{1} << 40)},
      {"offset that is negative", with(table + 8, ~std::uint64_t{0})},
      {"offset into the header", with(table, std::uint64_t{4})},
      {"never written", with(table + 16, std::uint64_t{0})},
      {"another byte", with(second + 40, static_cast<char>(good[second + 40] ^ 0x10))},
      {"short by a byte", repacked(kLast - 1)},
      {"short by half", repacked(kLast / 2)},
      {"long by a byte", repacked(kLast + 1)},
      {"cut in the table", good.substr(0, table + 10)},
      {"cut in a chunk's head", good.substr(0, third + 3)},
      {"cut in a chunk", good.substr(0, good.size() - 1)},
  };
  folder_.put("bad.exr", repacked(kLast));
  ASSERT_TRUE(read_pictures(folder_.path("bad.exr"), {}).ok());  // the tool of this test itself
  for (const auto& [name, bytes] : cases) {
    folder_.put("bad.exr", bytes);
    for (const bool trust : {false, true}) {
      ReadOptions read;
      read.trust_input = trust;
      const auto file = read_pictures(folder_.path("bad.exr"), read);
      ASSERT_FALSE(file.ok()) << name;
      EXPECT_EQ(file.error().code, ErrorCode::input) << name;
      EXPECT_NE(file.error().message.find("bad.exr: truncated or damaged: "), std::string::npos)
          << name << ": " << file.error().message;
      EXPECT_EQ(file.error().message.find('\n'), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace envconv
