// SPDX-License-Identifier: Apache-2.0
// Files: what is written is what is read, upright and linear, and values that do not fit are counted.
#include "io.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

#include "io_cases.h"

namespace envconv {
namespace {

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
  EXPECT_EQ(files_in(folder()), static_cast<int>(std::size(cases)));
}

TEST_F(Io, CompressionIsHeard) {
  const auto size = [&](const std::string& name, const char* compression) {
    WriteOptions write;
    write.type = PixelType::uint8;
    write.compression = compression;
    EXPECT_TRUE(write_pictures(path(name), one(make(200, 100, 3)), write).ok()) << name << " " << compression;
    return std::filesystem::file_size(path(name));
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

// --- how pixels are stored -----------------------------------------------------------------------------------------

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

}  // namespace
}  // namespace envconv
