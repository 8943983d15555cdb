// SPDX-License-Identifier: Apache-2.0
// What tests of DDS, KTX and KTX2 share: files with levels, and their bytes.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "io.h"
#include "isolated_reader.h"
#include "temporary_folder.h"
#include "texture_file.h"

namespace envconv {

using Levels = std::vector<std::vector<Picture>>;

class Container : public testing::Test, protected TemporaryFolder {
 protected:
  static void SetUpTestSuite() {
    ::setenv("ENVCONV_MODULE_PATH", ENVCONV_BUILD, 0);
    start_isolated_reader();
  }
  WriteReport write(const std::string& file, const Levels& levels, WriteOptions options) {
    options.type_given = true;
    options.verify = true;
    const auto report = write_levels(path(file), levels, options);
    EXPECT_TRUE(report) << report.error().message;
    return report ? *report : WriteReport{};
  }
  // In this process, so that a sanitizer sees it.
  Result<PictureFile> read(const std::string& file, int level = 0) const {
    ReadOptions options;
    options.trust_input = true;
    options.level = level;
    return read_pictures(path(file), options);
  }
};

// Values that tell picture, level and place; above 1 where the type has room.
inline Picture make(int width, int height, int channels, int picture, int level) {
  Picture p;
  p.channels = Channels::standard(channels);
  p.image = Image(width, height, channels);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float* to = p.image.at(x, y);
      const float a = channels % 2 == 0 ? 0.25f + 0.5f * static_cast<float>(x + 1) / static_cast<float>(width) : 1.f;
      for (int c = 0; c < channels; ++c) {
        const float v = 0.02f + 0.04f * static_cast<float>(picture % 16) + 0.03f * static_cast<float>(c) +
                        0.05f * static_cast<float>(level) + 0.1f * static_cast<float>(x) / static_cast<float>(width) +
                        0.07f * static_cast<float>(y) / static_cast<float>(height);
        to[c] = c == p.channels.alpha ? a : v * a;
      }
    }
  }
  return p;
}

inline Levels make_levels(int width, int height, int channels, int pictures, int levels) {
  Levels all;
  for (int level = 0; level < levels; ++level) {
    std::vector<Picture>& here = all.emplace_back();
    const Size size = size_of_level({width, height}, level);
    for (int i = 0; i < pictures; ++i) here.push_back(make(size.width, size.height, channels, i, level));
  }
  return all;
}

// --- bytes

inline std::uint32_t word_at(const std::string& bytes, std::size_t at) {
  return little_endian<std::uint32_t>(reinterpret_cast<const std::uint8_t*>(bytes.data()) + at);
}
inline void set_word(std::string& bytes, std::size_t at, std::uint32_t v) { std::memcpy(bytes.data() + at, &v, 4); }
inline void set_long(std::string& bytes, std::size_t at, std::uint64_t v) { std::memcpy(bytes.data() + at, &v, 8); }

// The older header: DX10's place is the pixel format's.
inline std::string dds_header(int size, int levels, std::uint32_t pixel_flags, std::uint32_t code, std::uint32_t bits,
                              std::array<std::uint32_t, 4> masks, bool cube = true) {
  ByteWriter out;
  out.text("DDS ");
  for (const int v : {124, 0x21007, size, size, 0, 0, levels}) out.u32(static_cast<std::uint32_t>(v));
  out.zeros(44);
  for (const std::uint32_t v : {32u, pixel_flags, code, bits}) out.u32(v);
  for (const std::uint32_t mask : masks) out.u32(mask);
  out.u32(0x401008);
  out.u32(cube ? 0xFE00u : 0u);
  out.zeros(12);
  return out.bytes();
}

}  // namespace envconv
