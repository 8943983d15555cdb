// SPDX-License-Identifier: Apache-2.0
// Blocks of BC1 to BC5 and BC7 in DDS, KTX2 and KTX files: against the image library's decoder, and by hand where it
// has none.
#include "block_code.h"

#include <fcntl.h>
#include <unistd.h>

#include <cmath>
#include <random>
#include <tuple>

#include "container_cases.h"
#include "imageio_loader.h"
#include "ktx2_descriptor.h"

namespace envconv {
namespace {

using Blocks = Container;

constexpr std::uint32_t fourcc(const char (&text)[5]) {
  return static_cast<std::uint32_t>(text[0] | text[1] << 8 | text[2] << 16 | text[3] << 24);
}

struct Code {
  BlockCode code;
  std::uint32_t fourcc, dxgi, vk, gl;  // of the first of these that there are; linear values
  int bytes, channels;
};
constexpr Code kCodes[] = {
    {BlockCode::bc1, fourcc("DXT1"), 71, 133, 0x83F1, 8, 4},  {BlockCode::bc2, fourcc("DXT3"), 74, 135, 0x83F2, 16, 4},
    {BlockCode::bc3, fourcc("DXT5"), 77, 137, 0x83F3, 16, 4}, {BlockCode::bc4, fourcc("ATI1"), 80, 139, 0x8DBB, 8, 1},
    {BlockCode::bc5, fourcc("ATI2"), 83, 141, 0x8DBD, 16, 2}, {BlockCode::bc7, fourcc("DX10"), 98, 145, 0x8E8C, 16, 4}};

std::string words(std::initializer_list<std::uint32_t> list) {
  std::string bytes;
  for (const std::uint32_t word : list) bytes.append(reinterpret_cast<const char*>(&word), 4);
  return bytes;
}

// All modes of BC7 as often, whose codes are of different lengths.
std::string random_blocks(const Code& code, int count, unsigned seed) {
  std::mt19937 random(seed);
  std::string bytes;
  for (int block = 0; block < count; ++block) {
    const std::size_t at = bytes.size();
    for (int i = 0; i < code.bytes; ++i) bytes += static_cast<char>(random());
    if (code.code != BlockCode::bc7) continue;
    const unsigned mode = static_cast<unsigned>(block) % 8;
    bytes[at] = static_cast<char>((static_cast<unsigned char>(bytes[at]) >> mode | 1u) << mode);
  }
  return bytes;
}

// A picture in the header that the image library knows for the code.
std::string dds_of(const Code& code, int size, const std::string& blocks) {
  std::string bytes = dds_header(size, 1, 4, code.fourcc, 0, {}, false);
  if (code.fourcc == fourcc("DX10")) bytes += words({code.dxgi, 3, 0, 1, 0});
  return bytes + blocks;
}

TEST_F(Blocks, AsTheImageLibraryHasThem) {
  constexpr int size = 256;
  for (const Code& code : kCodes) {
    SCOPED_TRACE(name_of(code.code));
    const std::string blocks = random_blocks(code, size * size / 16, 11);
    put("a.dds", dds_of(code, size, blocks));
    const auto texels = static_cast<std::size_t>(size * size), channels = static_cast<std::size_t>(code.channels);
    std::vector<std::uint8_t> ours(texels * channels), theirs(ours.size());
    decode_blocks(reinterpret_cast<const std::uint8_t*>(blocks.data()), code.code, false, size, size, code.channels,
                  ours.data());
    const int fd = ::open(path("a.dds").c_str(), O_RDONLY | O_CLOEXEC);
    ASSERT_GE(fd, 0);
    {
      auto library = open_imageio("dds", fd, {.max_pixels = 1 << 20});
      ASSERT_TRUE(library) << library.error().message;
      const PictureSpec& spec = (*library)->spec().pictures[0];
      ASSERT_EQ(spec.width, size);
      ASSERT_EQ(spec.height, size);
      ASSERT_EQ(spec.channels.count(), code.channels);
      ASSERT_EQ(spec.element, PixelType::uint8);
      ASSERT_TRUE((*library)->decode(0, theirs.data()));
    }
    ::close(fd);
    // Only of BC7 does a specification say how to round.
    const int tolerance = code.code == BlockCode::bc7 ? 0 : 1;
    std::size_t unlike = 0;
    for (std::size_t i = 0; i < ours.size(); ++i) {
      ASSERT_NEAR(ours[i], theirs[i], tolerance) << "texel " << i / channels << " channel " << i % channels;
      unlike += ours[i] != theirs[i];
    }
    EXPECT_LT(static_cast<double>(unlike), 0.3 * static_cast<double>(ours.size()));
  }
}

// Reserved codes are 0, as the specification has it.
TEST_F(Blocks, OfNoModeAreBlack) {
  std::array<std::uint8_t, 16> block{};
  block[1] = 0xFF;
  std::array<std::uint8_t, 64> texels;
  texels.fill(7);
  decode_blocks(block.data(), BlockCode::bc7, false, 4, 4, 4, texels.data());
  for (const std::uint8_t v : texels) EXPECT_EQ(v, 0);
}

// Signed ramps by hand: -128 counts as -127, six steps between ends that fall, four and the range's ends between
// others.
TEST_F(Blocks, WithASign) {
  const auto block = [](int first, int second) {
    std::array<std::uint8_t, 8> bytes{static_cast<std::uint8_t>(first), static_cast<std::uint8_t>(second)};
    std::uint64_t indices = 0;
    for (std::uint64_t t = 0; t < 16; ++t) indices |= t % 8 << 3 * t;
    for (std::size_t i = 0; i < 6; ++i) bytes[2 + i] = static_cast<std::uint8_t>(indices >> 8 * i);
    return bytes;
  };
  const double falling[8] = {7, -7, 5, 3, 1, -1, -3, -5}, rising[8] = {-127, 63, -89, -51, -13, 25, -127, 127};
  const std::tuple<int, int, const double*> cases[] = {{7, -7, falling}, {-128, 63, rising}};
  for (const auto& [first, second, expected] : cases) {
    float texels[16];
    decode_blocks(block(first, second).data(), BlockCode::bc4, true, 4, 4, 1, texels);
    for (std::size_t t = 0; t < 16; ++t) EXPECT_NEAR(texels[t], expected[t % 8] / 127, 1e-6) << t;
  }
}

// The smallest file of the kind: cube or array, all levels, no keys.
std::string ktx2_of(const TexelFormat& format, std::uint32_t vk, int size, int levels, bool cube, int layers,
                    const std::vector<std::string>& data) {
  const std::vector<std::uint32_t> descriptor = make_descriptor(format, false);
  const auto count = static_cast<std::uint32_t>(levels), edge = static_cast<std::uint32_t>(size);
  const std::uint32_t at = 80 + 24 * count, bytes = static_cast<std::uint32_t>(4 * descriptor.size());
  std::string file("\xABKTX 20\xBB\r\n\x1A\n", 12);
  file += words({vk, 1, edge, edge, 0, cube ? 0u : static_cast<std::uint32_t>(layers), cube ? 6u : 1u, count, 0, at,
                 bytes, 0, 0, 0, 0, 0, 0});
  std::uint32_t offset = (at + bytes + 15) / 16 * 16;
  std::string texels(offset - at - bytes, '\0');
  for (const std::string& level : data) {
    const auto length = static_cast<std::uint32_t>(level.size());
    file += words({offset, 0, length, 0, length, 0});
    texels += level;
    offset += length;
  }
  for (const std::uint32_t word : descriptor) file += words({word});
  return file + texels;
}

// Picture, level and place are told apart in all containers: every one must find the same texels.
class BlockFiles : public Container {
 protected:
  static constexpr int size = 12, levels = 3;  // 3x3, 2x2 and 1 blocks
  static std::string surface(const Code& code, int picture, int level) {
    const int side = (size_of_level({size, size}, level).width + 3) / 4;
    return random_blocks(code, side * side, static_cast<unsigned>(100 * picture + level + 1));
  }
  static std::string dds(const Code& code, std::uint32_t dxgi, bool cube, int pictures) {
    std::string bytes = dds_header(size, levels, 4, fourcc("DX10"), 0, {}, cube);
    bytes += words({dxgi, 3, cube ? 4u : 0u, cube ? 1u : static_cast<std::uint32_t>(pictures), 0});
    for (int picture = 0; picture < pictures; ++picture)
      for (int level = 0; level < levels; ++level) bytes += surface(code, picture, level);
    return bytes;
  }
  static std::string ktx2(const Code& code, std::uint32_t vk, bool cube, int pictures) {
    std::vector<std::string> data(levels);
    for (int level = 0; level < levels; ++level)
      for (int picture = 0; picture < pictures; ++picture)
        data[static_cast<std::size_t>(level)] += surface(code, picture, level);
    return ktx2_of(*format_of_vk(vk), vk, size, levels, cube, pictures, data);
  }
  static std::string ktx(const Code& code, std::uint32_t gl, bool cube, int pictures) {
    std::string file("\xABKTX 11\xBB\r\n\x1A\n", 12);
    file += words({0x04030201, 0, 1, 0, gl, 0x1908, size, size, 0, cube ? 0u : static_cast<std::uint32_t>(pictures),
                   cube ? 6u : 1u, levels, 0});
    for (int level = 0; level < levels; ++level) {
      const std::size_t one = surface(code, 0, level).size();
      file += words({static_cast<std::uint32_t>(cube ? one : one * static_cast<std::size_t>(pictures))});
      for (int picture = 0; picture < pictures; ++picture) file += surface(code, picture, level);
    }
    return file;
  }
  void expect_surfaces(const std::string& file, const Code& code, bool srgb, int pictures) {
    for (int level = 0; level < levels; ++level) {
      const auto got = read(file, level);
      ASSERT_TRUE(got) << got.error().message;
      EXPECT_EQ(got->compression, name_of(code.code));
      EXPECT_EQ(got->levels, levels);
      EXPECT_EQ(got->color, srgb ? "sRGB" : "linear");
      ASSERT_EQ(got->pictures.size(), static_cast<std::size_t>(pictures));
      const int side = size >> level;
      for (int picture = 0; picture < pictures; ++picture) {
        const Picture& p = got->pictures[static_cast<std::size_t>(picture)];
        ASSERT_EQ(p.image.width(), side);
        ASSERT_EQ(p.image.channels(), code.channels);
        const std::string blocks = surface(code, picture, level);
        std::vector<std::uint8_t> texels(p.image.value_count());
        decode_blocks(reinterpret_cast<const std::uint8_t*>(blocks.data()), code.code, false, side, side, code.channels,
                      texels.data());
        for (int y = 0; y < side; ++y)
          for (int x = 0; x < side; ++x) {
            const std::uint8_t* expected = &texels[static_cast<std::size_t>((y * side + x) * code.channels)];
            const float* texel = p.image.at(x, y);
            const double alpha = p.channels.alpha >= 0 ? expected[3] / 255.0 : 1;
            const double coded = expected[0] / 255.0;
            const double value =
                srgb ? (coded <= 0.04045 ? coded / 12.92 : std::pow((coded + 0.055) / 1.055, 2.4)) : coded;
            ASSERT_NEAR(texel[0], value * alpha, 2e-6) << x << "," << y;
            if (p.channels.alpha >= 0) {
              ASSERT_NEAR(texel[3], alpha, 1e-6);
            }
          }
      }
    }
  }
};

TEST_F(BlockFiles, EveryCodeInEveryContainerAtEveryLevel) {
  for (const Code& code : kCodes)
    for (const bool cube : {true, false})
      for (const bool srgb : {false, true}) {
        if (srgb && code.channels < 4) continue;
        SCOPED_TRACE(std::string(name_of(code.code)) + (cube ? " cube" : " array") + (srgb ? " sRGB" : ""));
        const int pictures = cube ? 6 : 2;
        put("a.dds", dds(code, code.dxgi + srgb, cube, pictures));
        expect_surfaces("a.dds", code, srgb, pictures);
        put("a.ktx2", ktx2(code, code.vk + srgb, cube, pictures));
        expect_surfaces("a.ktx2", code, srgb, pictures);
        const std::uint32_t gl_srgb = code.code == BlockCode::bc7 ? code.gl + 1 : code.gl - 0x83F1 + 0x8C4D;
        put("a.ktx", ktx(code, srgb ? gl_srgb : code.gl, cube, pictures));
        expect_surfaces("a.ktx", code, srgb, pictures);
      }
}

// The older header says no more than a code: colour is sRGB, single channels are not.
TEST_F(BlockFiles, BehindTheOlderHeader) {
  const std::pair<const char*, const Code*> more[] = {{"BC4U", &kCodes[3]}, {"BC5U", &kCodes[4]}};
  std::vector<std::pair<std::uint32_t, const Code*>> all;
  for (const Code& code : kCodes)
    if (code.fourcc != fourcc("DX10")) all.emplace_back(code.fourcc, &code);
  for (const auto& [text, code] : more)
    all.emplace_back(little_endian<std::uint32_t>(reinterpret_cast<const std::uint8_t*>(text)), code);
  for (const auto& [number, code] : all) {
    SCOPED_TRACE(name_of(code->code));
    std::string bytes = dds_header(size, levels, 4, number, 0, {});
    for (int face = 0; face < 6; ++face)
      for (int level = 0; level < levels; ++level) bytes += surface(*code, face, level);
    put("old.dds", bytes);
    expect_surfaces("old.dds", *code, code->channels == 4, 6);
    put("old.dds", bytes.substr(0, bytes.size() - 1));
    EXPECT_FALSE(read("old.dds"));
  }
}

TEST_F(BlockFiles, SignedOnesAreFloats) {
  for (const Code& code : {kCodes[3], kCodes[4]}) {
    put("a.dds", dds(code, code.dxgi + 1, true, 6));
    put("a.ktx2", ktx2(code, code.vk + 1, true, 6));
    put("a.ktx", ktx(code, code.gl + 1, true, 6));
    for (const char* file : {"a.dds", "a.ktx2", "a.ktx"}) {
      const auto got = read(file);
      ASSERT_TRUE(got) << got.error().message;
      EXPECT_EQ(got->color, "linear");
      ASSERT_EQ(got->pictures[5].image.channels(), code.channels);
      const std::string blocks = surface(code, 5, 0);
      std::vector<float> texels(got->pictures[5].image.value_count());
      decode_blocks(reinterpret_cast<const std::uint8_t*>(blocks.data()), code.code, true, size, size, code.channels,
                    texels.data());
      EXPECT_EQ(std::memcmp(texels.data(), got->pictures[5].image.data(), texels.size() * sizeof(float)), 0) << file;
    }
  }
}

// BC1 of three channels: where its alpha would be 0, black.
TEST_F(BlockFiles, Bc1WithoutAlpha) {
  put("a.ktx2", ktx2(kCodes[0], 131, true, 6));
  put("a.ktx", ktx(kCodes[0], 0x83F0, true, 6));
  for (const char* file : {"a.ktx2", "a.ktx"}) {
    const auto got = read(file);
    ASSERT_TRUE(got) << got.error().message;
    EXPECT_EQ(got->pictures[0].image.channels(), 3);
  }
}

// As Khronos' own tools write them (dfdutils, createDFDCompressed).
TEST(BlockDescriptors, AreThoseOfTheSpecification) {
  constexpr std::uint32_t all = 0xFFFFFFFF, least = 0x80000000, most = 0x7FFFFFFF;
  const std::pair<std::uint32_t, std::vector<std::uint32_t>> golden[] = {
      {131, {0x2c, 0, 0x00280002, 0x00010180, 0x303, 8, 0, 0x003f0000, 0, 0, all}},
      {134, {0x2c, 0, 0x00280002, 0x00020180, 0x303, 8, 0, 0x013f0000, 0, 0, all}},
      {135, {0x3c, 0, 0x00380002, 0x00010181, 0x303, 16, 0, 0x0f3f0000, 0, 0, all, 0x003f0040, 0, 0, all}},
      {138, {0x3c, 0, 0x00380002, 0x00020182, 0x303, 16, 0, 0x1f3f0000, 0, 0, all, 0x003f0040, 0, 0, all}},
      {140, {0x2c, 0, 0x00280002, 0x00010183, 0x303, 8, 0, 0x403f0000, 0, least, most}},
      {141, {0x3c, 0, 0x00380002, 0x00010184, 0x303, 16, 0, 0x003f0000, 0, 0, all, 0x013f0040, 0, 0, all}},
      {146, {0x2c, 0, 0x00280002, 0x00020186, 0x303, 16, 0, 0x007f0000, 0, 0, all}},
  };
  for (const auto& [number, expected] : golden) {
    const TexelFormat* format = format_of_vk(number);
    ASSERT_NE(format, nullptr) << number;
    EXPECT_EQ(make_descriptor(*format, false), expected) << number;
  }
}

}  // namespace
}  // namespace envconv
