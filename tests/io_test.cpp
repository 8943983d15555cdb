// SPDX-License-Identifier: Apache-2.0
// Files: what is written is what is read, damage is an error and never a death, and failures leave the old content.
#include "io.h"

#include <ImfChannelList.h>
#include <ImfDeepScanLineOutputFile.h>
#include <ImfEnvmapAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIntAttribute.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfTiledOutputFile.h>
#include <dirent.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <tbb/task_arena.h>
#include <unistd.h>
#include <zlib.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <thread>

#include "deflate.h"
#include "output_file.h"
#include "stored_pixels.h"
#include "tiff_write.h"

namespace envconv {
namespace {

namespace fs = std::filesystem;

class Io : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    // The module lies in the build's folder, which need not be next to the tests.
    ::setenv("ENVCONV_MODULE_PATH", ENVCONV_BUILD, 0);
    start_isolated_reader();
  }
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "envconv-io-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
  }
  void TearDown() override {
    ::unsetenv("ENVCONV_TEST_READER");
    ::umount2(path("disk").c_str(), MNT_DETACH);  // of a test that failed half way
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  std::string bytes_of(const std::string& file) const {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void put(const std::string& file, const std::string& bytes) const {
    std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  int files_in(const fs::path& folder) const {
    return static_cast<int>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
  }

  fs::path folder_;
};

// Smooth values in [low, high] and some noise; alpha, if any, between 0.2 and 1, colour associated with it.
Picture make(int width, int height, int channels, float low = 0, float high = 1, unsigned seed = 1) {
  Picture picture;
  picture.channels = Channels::standard(channels);
  picture.image = Image(width, height, channels);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> noise(0, 0.1f);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float* to = picture.image.at(x, y);
      for (int c = 0; c < channels; ++c) {
        const float wave = 0.45f + 0.2f * std::sin(0.11f * x + c) + 0.2f * std::cos(0.07f * y + c) + noise(random);
        to[c] = low + (high - low) * wave;
      }
      if (const int a = picture.channels.alpha; a >= 0) {
        to[a] = 0.2f + 0.8f * static_cast<float>(x) / width;
        for (int c = 0; c < channels; ++c) {
          if (c != a) to[c] *= to[a];
        }
      }
    }
  }
  return picture;
}

std::vector<Picture> one(Picture picture) {
  std::vector<Picture> pictures;
  pictures.push_back(std::move(picture));
  return pictures;
}

double srgb(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }

// The largest difference, in the given measure.
template <class F>
double worst(const Image& a, const Image& b, F&& measure) {
  EXPECT_EQ(a.width(), b.width());
  EXPECT_EQ(a.height(), b.height());
  EXPECT_EQ(a.channels(), b.channels());
  if (a.value_count() != b.value_count()) return INFINITY;
  double result = 0;
  for (std::size_t i = 0; i < a.value_count(); ++i) {
    const double d = measure(a.data()[i], b.data()[i]);
    result = std::isnan(d) ? INFINITY : std::max(result, d);
  }
  return result;
}

double relative(float a, float b) { return std::abs(a - b) / std::max(std::abs(a), 1e-6f); }

// --- round trips ---------------------------------------------------------------------------------------------------

struct Case {
  const char* file;
  PixelType type;
  int channels;
  const char* compression;
  double tolerance;  // linear for half and float, coded for integers
  bool metadata;
};

TEST_F(Io, RoundTrips) {
  using enum PixelType;
  const Case cases[] = {
      {"a.exr", half, 3, "", 0.0006, true},     {"b.exr", float32, 4, "zip", 0, true},
      {"c.exr", float32, 1, "none", 0, true},   {"d.exr", half, 4, "piz", 0.0006, true},
      {"e.exr", half, 2, "rle", 0.0006, true},  {"f.exr", float32, 3, "pxr24", 1e-4, true},
      {"g.exr", half, 3, "b44", 0.05, true},    {"g2.exr", half, 3, "b44a", 0.05, true},
      {"h.exr", half, 3, "dwaa:45", 0.2, true}, {"i.exr", half, 3, "dwab:10", 0.2, true},
      {"j.exr", half, 7, "zips", 0.0006, true}, {"k.exr", half, 3, "zip:9", 0.0006, true},
      {"a.hdr", float32, 3, "", 0.03, true},    {"b.pfm", float32, 3, "", 0, false},
      {"c.pfm", float32, 1, "", 0, false},      {"a.tif", float32, 3, "", 0, true},
      {"b.tif", float32, 4, "none", 0, true},   {"c.tif", half, 3, "zip", 0.0006, true},
      {"d.tif", uint16, 3, "lzw", 1e-5, true},  {"e.tif", uint8, 4, "", 0.02, true},
      {"f.tif", uint8, 1, "", 0.0021, true},    {"g.tif", float32, 6, "", 0, true},
      {"a.png", uint8, 3, "", 0.0021, true},    {"b.png", uint8, 4, "", 0.02, true},
      {"c.png", uint16, 3, "", 1e-5, true},     {"d.png", uint16, 1, "", 1e-5, true},
      {"e.png", uint8, 2, "", 0.02, true},      {"f.png", uint16, 4, "9", 1e-4, true},
      {"a.jpg", uint8, 3, "95", 0.15, true},    {"b.jpg", uint8, 1, "quality 90", 0.15, true},
      {"a.tga", uint8, 3, "", 0.0021, true},    {"b.tga", uint8, 4, "rle", 0.02, true},
      {"a.bmp", uint8, 3, "", 0.0021, false},   {"a.webp", uint8, 3, "webp:90", 0.3, false},
      {"b.bmp", uint8, 4, "", 0.02, false},     {"a.ppm", uint8, 3, "", 0.0021, false},
      {"a.pgm", uint8, 1, "", 0.0021, false},
  };
  for (const Case& c : cases) {
    for (const bool trust : {false, true}) {
      SCOPED_TRACE(std::string(c.file) + (trust ? " in process" : " isolated"));
      const auto pictures = one(make(61, 37, c.channels));
      WriteOptions write;
      write.type = c.type;
      write.type_given = true;
      write.compression = c.compression;
      write.metadata = {{"envconv:layout", "cube"}, {"envconv:rotation", "90 0 0"}, {"envconv:seam", "50% \"x\"=y"}};
      write.verify = trust;
      const auto report = write_pictures(path(c.file), pictures, write);
      ASSERT_TRUE(report.ok()) << report.error().message;
      EXPECT_EQ(report->type, c.type);
      EXPECT_EQ(report->nonfinite + report->clamped_high + report->clamped_negative, 0);
      EXPECT_EQ(report->warnings.empty(), c.metadata);
      ReadOptions read;
      read.trust_input = trust;
      const auto file = read_pictures(path(c.file), read);
      ASSERT_TRUE(file.ok()) << file.error().message;
      ASSERT_EQ(file->pictures.size(), 1u);
      EXPECT_EQ(file->warnings.size(), 0u) << file->warnings[0];
      const Picture& got = file->pictures[0];
      EXPECT_EQ(got.type, c.type);
      if (c.channels <= 4) {
        EXPECT_EQ(got.channels, pictures[0].channels);
      }
      const bool integer = c.type == uint8 || c.type == uint16;
      EXPECT_EQ(file->color, integer ? "sRGB" : "linear");
      EXPECT_LE(worst(pictures[0].image, got.image,
                      [&](float a, float b) { return integer ? std::abs(srgb(a) - srgb(b)) : relative(a, b); }),
                c.tolerance);
      for (const auto& [name, value] : write.metadata) {
        const auto found = file->metadata.find(name);
        EXPECT_EQ(found == file->metadata.end() ? "" : found->second, c.metadata ? value : "") << name;
      }
      // The same bytes whenever it is written.
      const std::string bytes = bytes_of(path(c.file));
      ASSERT_TRUE(write_pictures(path(c.file), pictures, write).ok());
      EXPECT_EQ(bytes_of(path(c.file)), bytes);
      // Only the size.
      read.header_only = true;
      const auto header = read_pictures(path(c.file), read);
      ASSERT_TRUE(header.ok());
      EXPECT_TRUE(header->pictures[0].image.empty());
      EXPECT_EQ(header->pictures[0].image.width(), 61);
      EXPECT_EQ(header->pictures[0].image.height(), 37);
      EXPECT_EQ(header->metadata, file->metadata);
    }
  }
  EXPECT_EQ(files_in(folder_), static_cast<int>(std::size(cases)));
}

TEST_F(Io, CompressionIsHeard) {
  const auto size = [&](const std::string& name, const char* compression) {
    WriteOptions write;
    write.type = PixelType::uint8;
    write.compression = compression;
    EXPECT_TRUE(write_pictures(path(name), one(make(200, 100, 3)), write).ok()) << name << " " << compression;
    return fs::file_size(path(name));
  };
  EXPECT_GT(size("a.png", "0"), size("a.png", "9"));
  EXPECT_GT(size("a.jpg", "95"), size("a.jpg", "jpeg:20"));
  EXPECT_GT(size("a.webp", "95"), size("a.webp", "20"));
  EXPECT_GT(size("a.tif", "none"), size("a.tif", "zip"));
  EXPECT_GT(size("a.exr", "none"), size("a.exr", "zip"));
  EXPECT_GT(size("a.exr", "dwaa:1"), size("a.exr", "dwaa:200"));
}

TEST_F(Io, MultiPartKeepsNamesAndSizes) {
  std::vector<Picture> faces;
  const char* names[] = {"+X", "-X", "+Y", "-Y", "+Z", "-Z"};
  for (int i = 0; i < 6; ++i) {
    faces.push_back(make(16 + i, 16, 3, 0, 1, static_cast<unsigned>(i + 1)));
    faces.back().name = names[i];
  }
  WriteOptions write;
  write.type = PixelType::float32;
  write.metadata = {{"envconv:layout", "cube"}};
  write.verify = true;
  const auto report = write_pictures(path("faces.exr"), faces, write);
  ASSERT_TRUE(report.ok()) << report.error().message;
  const auto file = read_pictures(path("faces.exr"), {});
  ASSERT_TRUE(file.ok()) << file.error().message;
  ASSERT_EQ(file->pictures.size(), 6u);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(file->pictures[i].name, names[i]);
    EXPECT_EQ(worst(faces[i].image, file->pictures[i].image, relative), 0);
  }
  EXPECT_EQ(can_write("x.png", write, 6, 3).error().code, ErrorCode::unsupported);
}

// --- TIFF and PNG ---------------------------------------------------------------------------------------------------

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

TEST_F(Io, UprightRadiance) {
  // A 2 x 3 picture, in all eight orders.  Texel values 1 to 6 in reading order, as stored with -Y 3 +X 2.
  const float upright[] = {1, 2, 3, 4, 5, 6};
  const auto at = [&](int x, int y) { return upright[y * 2 + x]; };
  for (const char* form : {"-Y+X", "-Y-X", "+Y+X", "+Y-X", "+X-Y", "+X+Y", "-X-Y", "-X+Y"}) {
    SCOPED_TRACE(form);
    const bool rows = form[1] == 'Y';
    // The sign says which way the coordinate runs as the file goes on; Y grows upwards.
    const auto index = [](char axis, char sign, int k, int n) {
      const bool forward = axis == 'X' ? sign == '+' : sign == '-';
      return forward ? k : n - 1 - k;
    };
    std::string file = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE= 4\n\n";
    const int major = rows ? 3 : 2, minor = rows ? 2 : 3;
    file += std::string{form[0], form[1]} + " " + std::to_string(major) + " " + std::string{form[2], form[3]} + " " +
            std::to_string(minor) + "\n";
    for (int i = 0; i < major; ++i) {
      for (int k = 0; k < minor; ++k) {
        const int a = index(form[1], form[0], i, major), b = index(form[3], form[2], k, minor);
        const float v = rows ? at(b, a) : at(a, b);
        file += static_cast<char>(static_cast<int>(v) * 16);
        file += static_cast<char>(static_cast<int>(v) * 16);
        file += static_cast<char>(static_cast<int>(v) * 16);
        file += static_cast<char>(128 + 4);  // * 16 / 256 * 2^4 = the value
      }
    }
    put(path("o.hdr"), file);
    const auto read = read_pictures(path("o.hdr"), {});
    ASSERT_TRUE(read.ok()) << read.error().message;
    const Image& image = read->pictures[0].image;
    ASSERT_EQ(image.width(), 2);
    ASSERT_EQ(image.height(), 3);
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 2; ++x) EXPECT_EQ(image.at(x, y)[1], at(x, y) / 8) << x << " " << y;
    }
  }
}

TEST_F(Io, IntegersAreLinearised) {
  // A 1 x 1 PPM is the plainest integer file.
  put(path("grey.pgm"), std::string("P5\n2 1\n65535\n\x80\x00\x00\x00", 18));
  const auto file = read_pictures(path("grey.pgm"), {});
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->color, "sRGB");
  // 32768/65535 is 0.5000076; 0.5 itself becomes 0.2140411.
  EXPECT_NEAR(file->pictures[0].image.data()[0], 0.2140411 + 0.0000076 * 0.911, 1e-6);
  EXPECT_EQ(file->pictures[0].image.data()[1], 0);
}

TEST_F(Io, EveryCodeSurvives) {
  for (const bool wide : {false, true}) {
    Picture picture;
    picture.channels = Channels::standard(1);
    const int width = 256, height = wide ? 256 : 1;
    picture.image = Image(width, height, 1);
    const double top = wide ? 65535 : 255;
    for (int i = 0; i < width * height; ++i) {
      const double v = i / top;
      picture.image.data()[i] = static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
    }
    const auto pictures = one(std::move(picture));
    WriteOptions write;
    write.type = wide ? PixelType::uint16 : PixelType::uint8;
    write.type_given = true;
    ASSERT_TRUE(write_pictures(path("codes.png"), pictures, write).ok());
    const auto file = read_pictures(path("codes.png"), {});
    ASSERT_TRUE(file.ok()) << file.error().message;
    for (int i = 0; i < width * height; ++i) {
      ASSERT_EQ(file->pictures[0].image.data()[i], pictures[0].image.data()[i]) << i;
    }
  }
}

TEST_F(Io, OrientationTags) {
  // A grey TIFF of 2 x 3 codes, 10 to 60 in stored order, for each orientation.
  for (int orientation = 1; orientation <= 8; ++orientation) {
    std::string file("II*\0\x0e\0\0\0\x0a\x14\x1e\x28\x32\x3c", 14);
    const auto u16 = [&](int v) { file += {static_cast<char>(v & 255), static_cast<char>(v >> 8)}; };
    const std::pair<int, int> tags[] = {{256, 2}, {257, 3},           {258, 8}, {259, 1}, {262, 1},
                                        {273, 8}, {274, orientation}, {277, 1}, {278, 3}, {279, 6}};
    u16(static_cast<int>(std::size(tags)));
    for (const auto& [tag, value] : tags) {
      for (const int v : {tag, 3, 1, 0, value, 0}) u16(v);
    }
    u16(0);
    u16(0);
    put(path("o.tif"), file);
    const auto read = read_pictures(path("o.tif"), {});
    ASSERT_TRUE(read.ok()) << read.error().message;
    const Image& image = read->pictures[0].image;
    ASSERT_EQ(image.width(), orientation >= 5 ? 3 : 2);
    ASSERT_EQ(image.height(), orientation >= 5 ? 2 : 3);
    // What is at the top left, and to the right of it, when shown upright.
    const int first[] = {10, 20, 60, 50, 10, 50, 60, 20}, second[] = {20, 10, 50, 60, 30, 30, 40, 40};
    const auto code = [&](float v) { return std::lround(srgb(v) * 255); };
    EXPECT_EQ(code(*image.at(0, 0)), first[orientation - 1]) << orientation;
    EXPECT_EQ(code(*image.at(1, 0)), second[orientation - 1]) << orientation;
  }
}

// --- what an EXR can be --------------------------------------------------------------------------------------------

// Writes channels of 1 float each, whose value is 1000 * channel + 100 * y + x in the data window's coordinates.
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
        plane[static_cast<std::size_t>(y * width + x)] = static_cast<float>(1000 * c) +
                                                         100.f * static_cast<float>(y + box.min.y) +
                                                         static_cast<float>(x + box.min.x);
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
    // A part is not an environment; both windows are named.
    file = read({{0, 0}, {19, 9}}, {{0, 0}, {9, 9}}, tiled);
    ASSERT_FALSE(file.ok());
    EXPECT_EQ(file.error().code, ErrorCode::input);
    EXPECT_NE(file.error().message.find("10x10"), std::string::npos) << file.error().message;
    EXPECT_NE(file.error().message.find("20x10"), std::string::npos);
  }
  // An origin far away.
  const int far = 1000000000;
  auto file = read({{far, far}, {far + 19, far + 9}}, {{far, far}, {far + 19, far + 9}}, false);
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->pictures[0].image.width(), 20);
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
  EXPECT_NE(file.error().message.find("chroma"), std::string::npos) << file.error().message;
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

// --- values that do not fit ----------------------------------------------------------------------------------------

TEST_F(Io, ValuesThatDoNotFitAreCounted) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  const float values[] = {70000, -70000, inf, -inf, NAN, 65504, 65503, -1, 0.5f, 0, 3e38f, 1e-42f};
  Picture picture;
  picture.channels = Channels::standard(3);
  picture.image = Image(4, 1, 3);
  std::copy(std::begin(values), std::end(values), picture.image.data());
  const auto pictures = one(std::move(picture));
  WriteOptions write;
  write.verify = true;
  auto report = write_pictures(path("v.exr"), pictures, write);
  ASSERT_TRUE(report.ok()) << report.error().message;
  EXPECT_EQ(report->clamped_high, 3);
  EXPECT_EQ(report->nonfinite, 3);
  EXPECT_EQ(report->clamped_negative, 0);
  auto file = read_pictures(path("v.exr"), {});
  ASSERT_TRUE(file.ok());
  const float halves[] = {65504, -65504, 65504, -65504, 0, 65504, 65504, -1, 0.5f, 0, 65504, 0};
  for (int i = 0; i < 12; ++i) EXPECT_EQ(file->pictures[0].image.data()[i], halves[i]) << i;

  write.type = PixelType::float32;
  report = write_pictures(path("v.exr"), pictures, write);
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(report->nonfinite, 3);
  file = read_pictures(path("v.exr"), {});
  ASSERT_TRUE(file.ok());
  for (int i = 0; i < 12; ++i) {
    EXPECT_EQ(std::memcmp(&file->pictures[0].image.data()[i], &values[i], 4), 0) << i;
  }

  report = write_pictures(path("v.hdr"), pictures, write);
  ASSERT_TRUE(report.ok()) << report.error().message;
  EXPECT_EQ(report->clamped_high, 1);
  EXPECT_EQ(report->clamped_negative, 2);
  EXPECT_EQ(report->nonfinite, 3);
  file = read_pictures(path("v.hdr"), {});
  ASSERT_TRUE(file.ok());
  EXPECT_GT(file->pictures[0].image.data()[2], 1.6e38f);  // the sun is no black hole
  EXPECT_GT(file->pictures[0].image.data()[10], 1.6e38f);

  report = write_pictures(path("v.png"), pictures, write);
  ASSERT_TRUE(report.ok()) << report.error().message;
  EXPECT_EQ(report->clamped_high, 4);
  EXPECT_EQ(report->clamped_negative, 2);
  EXPECT_EQ(report->nonfinite, 3);
}

// --- damage --------------------------------------------------------------------------------------------------------

TEST_F(Io, TruncatedFilesAreErrors) {
  for (const char* name :
       {"a.exr", "b.exr", "a.hdr", "a.png", "a.tif", "a.jpg", "a.tga", "a.bmp", "a.ppm", "a.pfm", "a.webp"}) {
    WriteOptions write;
    write.type = PixelType::float32;
    if (std::string(name) == "b.exr") write.compression = "none";
    if (std::string(name) == "a.tif") write.compression = "none";
    ASSERT_TRUE(write_pictures(path(name), one(make(64, 48, 3)), write).ok()) << name;
    const std::string bytes = bytes_of(path(name));
    for (const double part : {0.0, 0.002, 0.01, 0.1, 0.3, 0.5, 0.75, 0.9}) {
      const auto size = static_cast<std::size_t>(part * static_cast<double>(bytes.size()));
      put(path(name), bytes.substr(0, size));
      const auto file = read_pictures(path(name), {});
      ASSERT_FALSE(file.ok()) << name << " of " << size << " of " << bytes.size() << " bytes";
      EXPECT_EQ(file.error().code, ErrorCode::input) << file.error().message;
      EXPECT_EQ(file.error().message.find(path(name) + ": "), 0u) << file.error().message;
      EXPECT_EQ(file.error().message.find('\n'), std::string::npos);
    }
  }
}

TEST_F(Io, AnyDamageIsSurvived) {
  for (const char* name : {"a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"}) {
    ASSERT_TRUE(write_pictures(path(name), one(make(32, 16, 3)), {}).ok()) << name;
    const std::string bytes = bytes_of(path(name));
    std::mt19937 random(7);
    for (int round = 0; round < 25; ++round) {
      std::string damaged = bytes;
      for (int k = 0; k < 1 + round / 5; ++k) damaged[random() % damaged.size()] = static_cast<char>(random());
      put(path(name), damaged);
      const auto file = read_pictures(path(name), {});
      if (file.ok()) {
        EXPECT_GE(file->pictures.size(), 1u);
      } else {
        EXPECT_TRUE(file.error().code == ErrorCode::input || file.error().code == ErrorCode::limit);
      }
    }
  }
}

TEST_F(Io, HugeClaimsAreRefusedAtOnce) {
  // PNG: signature and an IHDR of 1000000 x 1000000, with a right checksum.
  std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\x0f\x42\x40\0\x0f\x42\x40\x08\x02\0\0\0", 29);
  std::uint32_t crc = ~0u;
  for (std::size_t i = 12; i < 29; ++i) {
    crc ^= static_cast<unsigned char>(png[i]);
    for (int k = 0; k < 8; ++k) crc = (crc >> 1) ^ ((crc & 1) ? 0xEDB88320u : 0);
  }
  for (int shift = 24; shift >= 0; shift -= 8) png += static_cast<char>(~crc >> shift);
  put(path("claim.png"), png + std::string("\0\0\0\0IDAT\x35\xaf\x06\x1e", 12));
  put(path("claim.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 1000000\n");
  // EXR: the windows of a real file, overwritten.
  WriteOptions none;
  none.compression = "none";
  ASSERT_TRUE(write_pictures(path("claim.exr"), one(make(8, 8, 3)), none).ok());
  std::string exr = bytes_of(path("claim.exr"));
  for (const char* window : {"dataWindow", "displayWindow"}) {
    const std::size_t at = exr.find(std::string(window) + '\0' + "box2i") + std::strlen(window) + 1 + 6 + 4;
    const std::int32_t box[4] = {0, 0, 999999, 999999};
    std::memcpy(&exr[at], box, sizeof box);
  }
  put(path("claim.exr"), exr);
  for (const char* name : {"claim.png", "claim.hdr", "claim.exr"}) {
    for (const bool trust : {false, true}) {
      ReadOptions read;
      read.trust_input = trust;
      const auto begin = std::chrono::steady_clock::now();
      const auto file = read_pictures(path(name), read);
      const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
      ASSERT_FALSE(file.ok()) << name;
      EXPECT_LT(spent.count(), 10) << name;  // a busy machine; in truth some milliseconds
      if (std::string(name) != "claim.exr" || file.error().code == ErrorCode::limit) {
        EXPECT_TRUE(file.error().code == ErrorCode::limit || std::string(name) == "claim.png") << file.error().message;
      }
      if (file.error().code == ErrorCode::limit) {
        EXPECT_NE(file.error().message.find("1000000x1000000"), std::string::npos) << file.error().message;
        EXPECT_NE(file.error().message.find("1073741824"), std::string::npos);
        EXPECT_NE(file.error().message.find("--max-pixels"), std::string::npos);
      }
    }
  }
}

TEST_F(Io, LimitIsTheCallers) {
  ASSERT_TRUE(write_pictures(path("a.exr"), one(make(20, 10, 3)), {}).ok());
  ASSERT_TRUE(write_pictures(path("a.png"), one(make(20, 10, 3)), {}).ok());
  for (const char* name : {"a.exr", "a.png"}) {
    ReadOptions read;
    read.max_pixels = 200;
    EXPECT_TRUE(read_pictures(path(name), read).ok());
    read.max_pixels = 199;
    const auto file = read_pictures(path(name), read);
    ASSERT_FALSE(file.ok());
    EXPECT_EQ(file.error().code, ErrorCode::limit);
    EXPECT_NE(file.error().message.find("20x10"), std::string::npos);
  }
}

TEST_F(Io, AReaderThatDiesIsAnError) {
  ASSERT_TRUE(write_pictures(path("a.exr"), one(make(20, 10, 3)), {}).ok());
  ASSERT_TRUE(write_pictures(path("a.png"), one(make(20, 10, 3)), {}).ok());
  for (const char* name : {"a.exr", "a.png"}) {
    for (const auto& [how, text] : {std::pair{"crash", "crashed (SIGSEGV)"},
                                    {"hang", "too long"},
                                    {"spin", "too long"},
                                    {"exit", "ended early"},
                                    {"rubbish", "senseless"},
                                    {"zygote", "ended early"}}) {
      ::setenv("ENVCONV_TEST_READER", how, 1);
      const auto file = read_pictures(path(name), {});
      ::unsetenv("ENVCONV_TEST_READER");
      ASSERT_FALSE(file.ok()) << how;
      EXPECT_EQ(file.error().code, ErrorCode::input);
      EXPECT_NE(file.error().message.find(text), std::string::npos) << file.error().message;
      const auto next = read_pictures(path(name), {});
      EXPECT_TRUE(next.ok()) << "after " << how << ": " << next.error().message;
    }
  }
}

TEST_F(Io, ManyReadersAtOnce) {
  ASSERT_TRUE(write_pictures(path("a.exr"), one(make(100, 50, 3)), {}).ok());
  ASSERT_TRUE(write_pictures(path("a.png"), one(make(100, 50, 3)), {}).ok());
  std::atomic<int> good{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 10; ++i) good += read_pictures(path(t % 2 ? "a.exr" : "a.png"), {}).ok();
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(good, 40);
}

// --- what is not a picture -----------------------------------------------------------------------------------------

TEST_F(Io, WhatIsNotAPictureIsNamed) {
  put(path("page.exr"), "  \n<!DOCTYPE html><html><body>404</body></html>");
  put(path("lfs.hdr"), "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n");
  put(path("empty.exr"), "");
  put(path("text.exr"), "hello");
  ASSERT_EQ(::mkfifo(path("fifo.exr").c_str(), 0600), 0);
  const std::pair<std::string, const char*> cases[] = {
      {path("page.exr"), "HTML"},          {path("lfs.hdr"), "Git LFS pointer"}, {path("empty.exr"), "empty file"},
      {path("text.exr"), "known format"},  {path("fifo.exr"), "regular file"},   {folder_.string(), "directory"},
      {"/dev/zero", "not a regular file"}, {path("none.exr"), "No such file"},
  };
  for (const auto& [name, text] : cases) {
    const auto file = read_pictures(name, {});
    ASSERT_FALSE(file.ok()) << name;
    EXPECT_EQ(file.error().code, ErrorCode::input);
    EXPECT_NE(file.error().message.find(text), std::string::npos) << file.error().message;
  }
  const auto odd = read_pictures(path("new\nline\x1b[31m.exr"), {});
  ASSERT_FALSE(odd.ok());
  EXPECT_NE(odd.error().message.find("new\\x0aline\\x1b[31m.exr: "), std::string::npos) << odd.error().message;
}

TEST_F(Io, TheContentsSayWhatAFileIs) {
  ASSERT_TRUE(write_pictures(path("a.png"), one(make(20, 10, 3)), {}).ok());
  fs::rename(path("a.png"), path("a.exr"));
  const auto file = read_pictures(path("a.exr"), {});
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->format, "png");
}

// Grey, in 256 or 16 steps.
std::string rle_bmp(bool nibbles, int width, const std::vector<unsigned char>& stream) {
  const int colors = nibbles ? 16 : 256;
  std::string bytes = "BM";
  const auto word = [&bytes](int v) { bytes.append(reinterpret_cast<const char*>(&v), 4); };
  const int planes_and_bits = 1 | (nibbles ? 4 : 8) << 16;
  for (const int v : {0, 0, 54 + 4 * colors, 40, width, 3, planes_and_bits, nibbles ? 2 : 1, 0, 0, 0, 0, 0}) word(v);
  for (int i = 0; i < colors; ++i) word(i * (nibbles ? 17 : 1) * 0x10101);
  return bytes.append(stream.begin(), stream.end());
}

TEST_F(Io, RunLengthEncodedBitmaps) {
  // The examples of Microsoft's "Bitmap Compression", and the indices that it says they stand for, lowest row first.
  struct Example {
    bool nibbles;
    std::vector<unsigned char> stream;
    std::vector<std::vector<int>> rows;
  };
  const Example examples[] = {
      {false,
       {3, 4, 5, 6, 0, 3, 0x45, 0x56, 0x67, 0, 2, 0x78, 0, 2, 5, 1, 2, 0x78, 0, 0, 9, 0x1E},
       {{4, 4, 4, 6, 6, 6, 6, 6, 0x45, 0x56, 0x67, 0x78, 0x78, 0, 0, 0, 0, 0, 0, 0},
        {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x78, 0x78},
        {0x1E, 0x1E, 0x1E, 0x1E, 0x1E, 0x1E, 0x1E, 0x1E, 0x1E, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}},
      {true,
       {3, 4, 5, 6, 0, 6, 0x45, 0x56, 0x67, 0, 4, 0x78, 0, 2, 5, 1, 4, 0x78, 0, 0, 9, 0x1E},
       {{0, 4, 0, 0, 6, 0, 6, 0, 4, 5, 5, 6, 6, 7, 7, 8, 7, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0},
        {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7, 8, 7, 8},
        {1, 14, 1, 14, 1, 14, 1, 14, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}},
  };
  for (const auto& [nibbles, stream, rows] : examples) {
    const int width = static_cast<int>(rows[0].size());
    // ImageMagick ends the last line before the bitmap.
    for (const std::vector<unsigned char>& end : {std::vector<unsigned char>{0, 1}, {0, 0, 0, 1}}) {
      std::vector<unsigned char> whole = stream;
      whole.insert(whole.end(), end.begin(), end.end());
      put(path("a.bmp"), rle_bmp(nibbles, width, whole));
      const auto file = read_pictures(path("a.bmp"), {});
      ASSERT_TRUE(file.ok()) << file.error().message;
      for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < width; ++x) {
          const double value = 255 * srgb(file->pictures[0].image.at(x, 2 - y)[0]);
          const int index = rows[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)];
          ASSERT_NEAR(value, index * (nibbles ? 17 : 1), 0.01) << x << " " << y;
        }
      }
    }
    // No end of the bitmap, or pixels outside it; and an index without a colour.
    std::vector<unsigned char> bad[] = {stream, stream, stream, stream, stream};
    bad[1].insert(bad[1].end(), {200, 0x1E, 0, 1});
    bad[2].insert(bad[2].end(), {0, 0, 1, 0x1E, 0, 1});
    bad[3].insert(bad[3].end(), {0, 2, 1, 2, 0, 1});
    const int left = width - 9;
    bad[4].insert(bad[4].end(), {static_cast<unsigned char>(left), 0, 0, 0});  // all pixels, and no end
    for (const std::vector<unsigned char>& damaged : bad) {
      put(path("bad.bmp"), rle_bmp(nibbles, width, damaged));
      const auto file = read_pictures(path("bad.bmp"), {});
      ASSERT_FALSE(file.ok());
      EXPECT_NE(file.error().message.find("run-length"), std::string::npos) << file.error().message;
    }
    std::string few = rle_bmp(nibbles, width, stream);
    few[46] = 14;
    put(path("few.bmp"), few);
    EXPECT_FALSE(read_pictures(path("few.bmp"), {}).ok());
  }
}

// --- failures of writing -------------------------------------------------------------------------------------------

TEST_F(Io, AFormatThatCannotHoldItIsRefusedBeforeAnythingIsWritten) {
  WriteOptions half;
  half.type_given = true;
  WriteOptions bad;
  bad.compression = "zap";
  const std::tuple<const char*, WriteOptions, int> cases[] = {
      {"a.xyz", {}, 3}, {"noextension", {}, 3}, {"a.png", half, 3}, {"a.jpg", {}, 4},
      {"a.hdr", {}, 4}, {"a.exr", bad, 3},      {"a.png", bad, 3},  {"a.png", {}, 6},
  };
  for (const auto& [name, options, channels] : cases) {
    const auto can = can_write(path(name), options, 1, channels);
    ASSERT_FALSE(can.ok()) << name;
    EXPECT_EQ(can.error().code, ErrorCode::unsupported);
    EXPECT_EQ(can.error().message.find(path(name) + ": "), 0u) << can.error().message;
    EXPECT_FALSE(write_pictures(path(name), one(make(4, 4, channels)), options).ok());
  }
  EXPECT_NE(can_write("a.xyz", {}, 1, 3).error().message.find("exr hdr"), std::string::npos);
  EXPECT_TRUE(can_write("a.PNG", {}, 1, 3).ok());
  EXPECT_EQ(files_in(folder_), 0);
}

TEST_F(Io, OutputsThatAreNotFiles) {
  ASSERT_EQ(::mkfifo(path("fifo.exr").c_str(), 0600), 0);
  fs::create_directory(path("dir.exr"));
  fs::create_symlink("nowhere.exr", path("dangling.exr"));
  const std::pair<std::string, const char*> cases[] = {{path("fifo.exr"), "regular file"},
                                                       {path("dir.exr"), "directory"},
                                                       {path("dangling.exr"), "leads nowhere"},
                                                       {path("missing/a.exr"), "folder does not exist"}};
  for (const auto& [name, text] : cases) {
    const auto report = write_pictures(name, one(make(4, 4, 3)), {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output);
    EXPECT_NE(report.error().message.find(text), std::string::npos) << report.error().message;
  }
  EXPECT_EQ(files_in(folder_), 3);
  // A link to a file stays a link, and its target is what changes.
  fs::create_directory(path("elsewhere"));
  put(path("elsewhere/target.exr"), "old");
  fs::create_symlink("elsewhere/target.exr", path("link.exr"));
  ASSERT_TRUE(write_pictures(path("link.exr"), one(make(4, 4, 3)), {}).ok());
  EXPECT_TRUE(fs::is_symlink(path("link.exr")));
  EXPECT_TRUE(read_pictures(path("elsewhere/target.exr"), {}).ok());
  EXPECT_EQ(files_in(path("elsewhere")), 1);
  // A name as long as names can be.
  EXPECT_TRUE(write_pictures(path(std::string(251, 'n') + ".exr"), one(make(4, 4, 3)), {}).ok());
}

TEST_F(Io, AFullDiskLeavesTheOldContent) {
  const std::string mount = path("disk");
  fs::create_directory(mount);
  if (::mount("tmpfs", mount.c_str(), "tmpfs", 0, "size=64k") != 0) GTEST_SKIP() << "needs the right to mount";
  for (const char* name :
       {"a.exr", "b.exr", "a.hdr", "a.png", "a.tif", "a.jpg", "a.tga", "a.bmp", "a.webp", "a.ppm", "a.pfm"}) {
    const std::string file = mount + "/" + name;
    put(file, "old content");
    WriteOptions write;
    write.type = PixelType::float32;
    if (std::string(name) == "b.exr") write.compression = "none";
    if (std::string(name).find(".jpg") != std::string::npos) write.compression = "100";
    const auto report = write_pictures(file, one(make(700, 400, 3)), write);
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output) << name;
    EXPECT_NE(report.error().message.find("No space left"), std::string::npos) << report.error().message;
    EXPECT_EQ(bytes_of(file), "old content") << name;
    EXPECT_EQ(files_in(mount), 1) << name;
    fs::remove(file);
  }
  for (const char* name : {"levels.tif", "levels.exr"}) {
    std::vector<std::vector<Picture>> levels;
    for (const int width : {700, 350, 175}) levels.push_back(one(make(width, width * 4 / 7, 3)));
    const auto report = write_levels(mount + "/" + name, levels, {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_NE(report.error().message.find("No space left"), std::string::npos) << report.error().message;
    EXPECT_EQ(files_in(mount), 0) << name;
  }
  // Full to the last byte: not even the first one can be written.
  put(mount + "/filler", std::string(200000, 'x'));
  for (const char* name : {"a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"}) {
    const auto report = write_pictures(mount + "/" + name, one(make(16, 8, 3)), {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output) << report.error().message;
    EXPECT_EQ(files_in(mount), 1) << name;
  }
  EXPECT_EQ(::umount(mount.c_str()), 0);
}

TEST_F(Io, VerificationFindsDamage) {
  for (const char* name : {"a.exr", "a.hdr", "a.tif", "a.png", "a.pfm"}) {
    WriteOptions write;
    write.type = PixelType::float32;
    if (std::string(name) == "a.exr" || std::string(name) == "a.tif") write.compression = "none";
    put(path(name), "old content");
    ::setenv("ENVCONV_TEST_WRITER", "flip", 1);
    write.verify = true;
    const auto report = write_pictures(path(name), one(make(40, 20, 3)), write);
    ::unsetenv("ENVCONV_TEST_WRITER");
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output);
    EXPECT_NE(report.error().message.find("read back"), std::string::npos) << report.error().message;
    EXPECT_EQ(bytes_of(path(name)), "old content");
  }
  EXPECT_EQ(files_in(folder_), 5);
  // In the middle of a file with levels is level 0.
  WriteOptions write;
  write.type = PixelType::float32;
  write.compression = "none";
  write.verify = true;
  ::setenv("ENVCONV_TEST_WRITER", "flip", 1);
  std::vector<std::vector<Picture>> levels;
  for (const int side : {128, 64}) levels.push_back(one(make(side, side, 3)));
  const auto report = write_levels(path("levels.tif"), levels, write);
  ::unsetenv("ENVCONV_TEST_WRITER");
  ASSERT_FALSE(report.ok());
  EXPECT_NE(report.error().message.find("read back"), std::string::npos) << report.error().message;
  EXPECT_EQ(files_in(folder_), 5);
}

TEST_F(Io, TemporariesAreRemoved) {
  {
    auto file = OutputFile::create(path("a.exr"));
    ASSERT_TRUE(file.ok());
    file->write("abc", 3);
    EXPECT_EQ(files_in(folder_), 1);
    EXPECT_FALSE(fs::exists(path("a.exr")));
  }
  EXPECT_EQ(files_in(folder_), 0);
  auto file = OutputFile::create(path("a.exr"));
  ASSERT_TRUE(file.ok());
  // As a signal handler would, in a process that then ends: none is made any more.
  EXPECT_EXIT(
      {
        remove_temporaries();
        ::_exit(files_in(folder_) == 0 && !OutputFile::create(path("b.exr")).ok() ? 0 : 1);
      },
      testing::ExitedWithCode(0), "");
  EXPECT_EQ(files_in(folder_), 0);
  file->write("abc", 3);
  EXPECT_FALSE(file->commit().ok());
  // What a killed process left behind goes with the next output of another process, in a folder not seen before.
  fs::create_directory(path("stale"));
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  const std::string mine = ".envconv-" + std::to_string(::getpid()) + "-0123456789ab.tmp";
  put(path("stale/.envconv-" + std::to_string(child) + "-0123456789ab.tmp"), "x");
  put(path("stale/" + mine), "x");
  put(path("stale/.envconv-notes.tmp"), "x");
  ASSERT_TRUE(write_pictures(path("stale/a.exr"), one(make(4, 4, 3)), {}).ok());
  EXPECT_EQ(files_in(path("stale")), 3);
  EXPECT_TRUE(fs::exists(path("stale/" + mine)));
}

}  // namespace
}  // namespace envconv
