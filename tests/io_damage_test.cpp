// SPDX-License-Identifier: Apache-2.0
// Damaged files, and what is no picture: an error and never a death, in a reader that dies as well.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <thread>

#include "io.h"
#include "io_cases.h"

namespace envconv {
namespace {

namespace fs = std::filesystem;

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
      {path("text.exr"), "known format"},  {path("fifo.exr"), "regular file"},   {folder().string(), "directory"},
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

}  // namespace
}  // namespace envconv
