// SPDX-License-Identifier: Apache-2.0
// BC6H by two other decoders: the image library's (from DDS files) and Mesa's (from OpenGL textures).
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/gl.h>
#include <GL/glext.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "bc6h.h"

namespace envconv {
namespace {

constexpr int width = 256, height = 256;

// Blocks of any bits: all modes, the reserved ones too.  In every second one but for the mode most are alike, so that
// end points are the least and greatest there are.
std::vector<std::uint8_t> random_blocks() {
  std::vector<std::uint8_t> blocks(bc6h_bytes(width, height));
  std::mt19937 random(20261122);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const bool extreme = i / 16 % 2 && i % 16 != 0;
    blocks[i] = static_cast<std::uint8_t>(!extreme        ? random()
                                          : random() % 16 ? (i / 32 % 2 ? 0xFF : 0)
                                                          : 1u << random() % 8);
  }
  // One more extreme: mode 15 with the red end points' highest bit alone, -32768 where signed.
  std::fill_n(blocks.begin(), 16, std::uint8_t{0});
  blocks[0] = 15;
  blocks[4] = 0x80;
  return blocks;
}

std::vector<float> ours(const std::vector<std::uint8_t>& blocks, bool is_signed) {
  std::vector<float> rgb(std::size_t{3} * width * height);
  decode_bc6h(blocks.data(), width, height, is_signed, rgb.data());
  return rgb;
}

std::vector<float> by_image_library(const std::vector<std::uint8_t>& blocks, bool is_signed) {
  // DDS_HEADER and DDS_HEADER_DXT10, in words; Microsoft's "DDS programming guide".
  std::uint32_t header[37] = {0x20534444, 124, 0x81007, height, width, static_cast<std::uint32_t>(blocks.size()), 0, 1};
  header[19] = 32;
  header[20] = 4;  // a four-character code follows
  std::memcpy(&header[21], "DX10", 4);
  header[27] = 0x1000;               // a texture
  header[32] = is_signed ? 96 : 95;  // DXGI_FORMAT_BC6H_SF16, DXGI_FORMAT_BC6H_UF16
  header[33] = 3;                    // two dimensions
  header[35] = 1;
  const std::string path =
      (std::filesystem::temp_directory_path() / ("envconv-bc6h-" + std::to_string(::getpid()) + ".dds")).string();
  {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(header), sizeof header);
    file.write(reinterpret_cast<const char*>(blocks.data()), static_cast<std::streamsize>(blocks.size()));
  }
  std::vector<float> rgb(std::size_t{3} * width * height);
  OIIO::attribute("threads", 1);  // its threads hand work over unseen by the thread sanitizer
  const auto input = OIIO::ImageInput::open(path);
  const bool read =
      input && input->spec().nchannels == 3 && input->read_image(0, 0, 0, 3, OIIO::TypeDesc::FLOAT, rgb.data());
  std::filesystem::remove(path);
  if (!read) ADD_FAILURE() << "the image library does not read the file: " << OIIO::geterror();
  return rgb;
}

// OpenGL on Mesa's software renderer, without a window.
class Gl : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    ::setenv("EGL_PLATFORM", "surfaceless", 1);
    ::setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
  }
  void SetUp() override {
    const auto get_display =
        reinterpret_cast<PFNEGLGETPLATFORMDISPLAYEXTPROC>(eglGetProcAddress("eglGetPlatformDisplayEXT"));
    ASSERT_NE(get_display, nullptr);
    display_ = get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    ASSERT_TRUE(eglInitialize(display_, nullptr, nullptr)) << "Mesa is missing (tools/setup.sh test)";
    ASSERT_TRUE(eglBindAPI(EGL_OPENGL_API));
    const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION, 4, EGL_CONTEXT_MINOR_VERSION, 5, EGL_NONE};
    context_ = eglCreateContext(display_, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
    ASSERT_TRUE(eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_));
  }
  void TearDown() override {
    eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(display_, context_);
    // The display stays: with its end Mesa unloads its driver, and what that leaks has no name to suppress it by.
  }
  template <class F>
  static F function(const char* name) {
    return reinterpret_cast<F>(eglGetProcAddress(name));
  }
  static std::vector<float> decode(const std::vector<std::uint8_t>& blocks, bool is_signed) {
    GLuint texture = 0;
    function<decltype(&glGenTextures)>("glGenTextures")(1, &texture);
    function<decltype(&glBindTexture)>("glBindTexture")(GL_TEXTURE_2D, texture);
    function<PFNGLCOMPRESSEDTEXIMAGE2DPROC>("glCompressedTexImage2D")(
        GL_TEXTURE_2D, 0, is_signed ? GL_COMPRESSED_RGB_BPTC_SIGNED_FLOAT : GL_COMPRESSED_RGB_BPTC_UNSIGNED_FLOAT,
        width, height, 0, static_cast<GLsizei>(blocks.size()), blocks.data());
    std::vector<float> rgb(std::size_t{3} * width * height);
    function<decltype(&glGetTexImage)>("glGetTexImage")(GL_TEXTURE_2D, 0, GL_RGB, GL_FLOAT, rgb.data());
    EXPECT_EQ(function<decltype(&glGetError)>("glGetError")(), static_cast<GLenum>(GL_NO_ERROR));
    return rgb;
  }

 private:
  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLContext context_ = EGL_NO_CONTEXT;
};

void expect_same(const std::vector<float>& a, const std::vector<float>& b, const std::vector<std::uint8_t>& blocks) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::size_t x = i / 3 % width, y = i / 3 / width;
    ASSERT_EQ(a[i], b[i]) << "texel " << x << ',' << y << " channel " << i % 3 << ", block starts with byte "
                          << int{blocks[16 * (y / 4 * (width / 4) + x / 4)]};
  }
}

TEST(Bc6hOracle, ImageLibraryUnsigned) {
  const auto blocks = random_blocks();
  expect_same(ours(blocks, false), by_image_library(blocks, false), blocks);
}
TEST(Bc6hOracle, ImageLibrarySigned) {
  const auto blocks = random_blocks();
  expect_same(ours(blocks, true), by_image_library(blocks, true), blocks);
}
TEST_F(Gl, MesaUnsigned) {
  const auto blocks = random_blocks();
  expect_same(ours(blocks, false), decode(blocks, false), blocks);
}
TEST_F(Gl, MesaSigned) {
  const auto blocks = random_blocks();
  expect_same(ours(blocks, true), decode(blocks, true), blocks);
}

}  // namespace
}  // namespace envconv
