// SPDX-License-Identifier: Apache-2.0
// DDS files of the older kind, which we read and do not write: DevIL reads the same texels of every face and level.
#include <IL/il.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <random>
#include <string>

#include "container_cases.h"
#include "dds.h"

namespace envconv {
namespace {

constexpr int kSize = 8, kLevels = 4;

struct Old {
  const char* name;
  std::uint32_t flags, code, bits;
  std::array<std::uint32_t, 4> masks;
  int texel_bytes;
};
constexpr Old kOld[] = {{"float", 4, 116, 0, {}, 16},
                        {"half", 4, 113, 0, {}, 8},
                        {"rgba", 0x41, 0, 32, {0xFF, 0xFF00, 0xFF0000, 0xFF000000}, 4},
                        {"bgra", 0x41, 0, 32, {0xFF0000, 0xFF00, 0xFF, 0xFF000000}, 4},
                        {"bgr", 0x40, 0, 24, {0xFF0000, 0xFF00, 0xFF, 0}, 3}};

// A cube of noise.
std::string file_of(const Old& old) {
  std::string bytes = dds_header(kSize, kLevels, old.flags, old.code, old.bits, old.masks);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> value(0, 1);
  int texels = 0;
  for (int level = 0; level < kLevels; ++level) texels += 6 * (kSize >> level) * (kSize >> level);
  for (int i = 0; i < texels * (old.code ? 4 : old.texel_bytes); ++i) {
    const float v = value(random);
    if (old.code == 116) {
      bytes.append(reinterpret_cast<const char*>(&v), 4);
    } else if (old.code == 113) {
      // From 0.5 up to 1: exponent 14 and any mantissa.
      const auto half = static_cast<std::uint16_t>(14 << 10 | static_cast<int>(v * 1023));
      bytes.append(reinterpret_cast<const char*>(&half), 2);
    } else {
      bytes += static_cast<char>(static_cast<int>(v * 255));
    }
  }
  return bytes;
}

class Devil : public testing::TestWithParam<Old> {
 protected:
  static void SetUpTestSuite() { ilInit(); }
};

TEST_P(Devil, HasTheSameTexels) {
  const Old& old = GetParam();
  const std::string bytes = file_of(old);
  const int fd = ::memfd_create("old", MFD_CLOEXEC);
  ASSERT_EQ(::pwrite(fd, bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
  const ILuint image = ilGenImage();
  ilBindImage(image);
  ASSERT_TRUE(ilLoadL(IL_DDS, bytes.data(), static_cast<ILuint>(bytes.size()))) << ilGetError();
  for (int level = 0; level < kLevels; ++level) {
    const auto decoder = open_dds(fd, {.max_pixels = 1 << 20, .level = level});
    ASSERT_TRUE(decoder) << decoder.error().message;
    const FileSpec& spec = (*decoder)->spec();
    ASSERT_EQ(spec.pictures.size(), 6u);
    ASSERT_EQ(spec.levels, kLevels);
    const int n = kSize >> level, channels = spec.pictures[0].channels.count();
    const bool real = spec.pictures[0].element == PixelType::float32;
    for (int face = 0; face < 6; ++face) {
      // Face and level count from the image that is bound.
      ilBindImage(image);
      ASSERT_TRUE(ilActiveFace(static_cast<ILuint>(face)) && ilActiveMipmap(static_cast<ILuint>(level)));
      ASSERT_EQ(ilGetInteger(IL_IMAGE_WIDTH), n);
      const auto values = static_cast<std::size_t>(n * n * channels);
      const auto form = static_cast<ILenum>(channels == 4 ? IL_RGBA : IL_RGB);
      const auto type = static_cast<ILenum>(real ? IL_FLOAT : IL_UNSIGNED_BYTE);
      const std::size_t size = values * (real ? 4 : 1);
      std::string theirs(size, '\0'), ours(size, '\0');
      ASSERT_GT(ilCopyPixels(0, 0, 0, static_cast<ILuint>(n), static_cast<ILuint>(n), 1, form, type, theirs.data()),
                0u);
      const auto decoded = (*decoder)->decode(face, ours.data());
      ASSERT_TRUE(decoded) << decoded.error().message;
      EXPECT_TRUE(ours == theirs) << old.name << ", face " << face << ", level " << level;
    }
  }
  ilDeleteImage(image);
  ::close(fd);
}

INSTANTIATE_TEST_SUITE_P(Old, Devil, testing::ValuesIn(kOld),
                         [](const testing::TestParamInfo<Old>& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace envconv
