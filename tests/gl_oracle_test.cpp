// SPDX-License-Identifier: Apache-2.0
// Cube maps as a graphics driver sees them: what we write as DDS and KTX goes to OpenGL as the files' own headers say,
// and a shader looks directions up.  Mesa's software renderer does it, which has a BC6H decoder of its own.
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>

#include "envconv.h"
#include "temporary_folder.h"

namespace envconv {
namespace {

using enum PixelType;

constexpr int kSize = 16;  // whole blocks at the levels that are looked at
constexpr int kLevels = 3;

// A context without a window, for the whole program.
class Gl : public testing::Test, protected TemporaryFolder {
 protected:
  static void SetUpTestSuite() {
    ::setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
    display_ = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    ASSERT_NE(display_, EGL_NO_DISPLAY);
    ASSERT_TRUE(eglInitialize(display_, nullptr, nullptr));
    ASSERT_TRUE(eglBindAPI(EGL_OPENGL_API));
    const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION, 4, EGL_CONTEXT_MINOR_VERSION, 5, EGL_NONE};
    const EGLContext context = eglCreateContext(display_, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
    ASSERT_NE(context, EGL_NO_CONTEXT);
    ASSERT_TRUE(eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context));
  }
  static void TearDownTestSuite() { eglTerminate(display_); }

  // A cube of directions with levels.
  std::string written(const std::string& name, PixelType type) {
    const Layout& cube = *find_layout("cube");
    std::vector<std::vector<Picture>> levels;
    for (int level = 0; level < kLevels; ++level) {
      std::vector<Picture>& faces = levels.emplace_back();
      const int n = kSize >> level;
      for (int face = 0; face < 6; ++face) {
        Picture picture{"", Image(n, n, 3), Channels::standard(3), type};
        for (int y = 0; y < n; ++y) {
          for (int x = 0; x < n; ++x) {
            const Vec3 d = cube.direction(face, (x + 0.5) / n, (y + 0.5) / n);
            const double color[3] = {d.x, d.y, d.z};
            for (int c = 0; c < 3; ++c) picture.image.at(x, y)[c] = static_cast<float>(0.5 + 0.45 * color[c]);
          }
        }
        faces.push_back(std::move(picture));
      }
    }
    WriteOptions options;
    options.type = type;
    options.type_given = true;
    options.cube = true;
    const auto report = write_levels(path(name), levels, options);
    EXPECT_TRUE(report) << report.error().message;
    return bytes_of(name);
  }

  static inline EGLDisplay display_ = EGL_NO_DISPLAY;
};

std::uint32_t word(const std::string& bytes, std::size_t at) {
  std::uint32_t v;
  std::memcpy(&v, bytes.data() + at, 4);
  return v;
}

struct GlFormat {
  GLenum internal, format, type;  // format 0: compressed
  int bytes;                      // of a texel or a block of 4x4
};

GLsizei surface(const GlFormat& format, int n) {
  return format.format ? n * n * format.bytes : (n + 3) / 4 * ((n + 3) / 4) * format.bytes;
}

void upload(const GlFormat& format, int face, int level, const char* data) {
  const GLenum target = GL_TEXTURE_CUBE_MAP_POSITIVE_X + static_cast<GLenum>(face);
  const int n = kSize >> level;
  if (format.format) {
    glTexImage2D(target, level, static_cast<GLint>(format.internal), n, n, 0, format.format, format.type, data);
  } else {
    glCompressedTexImage2D(target, level, format.internal, n, n, 0, surface(format, n), data);
  }
}

// Face-major, after a header of 148 bytes; DXGI's numbers in OpenGL's.
void upload_dds(const std::string& bytes) {
  GlFormat format{};
  switch (word(bytes, 128)) {
    case 2: format = {GL_RGBA32F, GL_RGBA, GL_FLOAT, 16}; break;
    case 10: format = {GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 8}; break;
    case 26: format = {GL_R11F_G11F_B10F, GL_RGB, GL_UNSIGNED_INT_10F_11F_11F_REV, 4}; break;
    case 29: format = {GL_SRGB8_ALPHA8, GL_RGBA, GL_UNSIGNED_BYTE, 4}; break;
    case 67: format = {GL_RGB9_E5, GL_RGB, GL_UNSIGNED_INT_5_9_9_9_REV, 4}; break;
    case 95: format = {GL_COMPRESSED_RGB_BPTC_UNSIGNED_FLOAT, 0, 0, 16}; break;
    default: FAIL() << "DXGI format " << word(bytes, 128);
  }
  std::size_t at = 148;
  for (int face = 0; face < 6; ++face) {
    for (int level = 0; level < kLevels; ++level) {
      upload(format, face, level, bytes.data() + at);
      at += static_cast<std::size_t>(surface(format, kSize >> level));
    }
  }
  EXPECT_EQ(at, bytes.size());
}

// Level-major; OpenGL's numbers are in the header.
void upload_ktx(const std::string& bytes) {
  const GlFormat format{word(bytes, 28), word(bytes, 24), word(bytes, 16), 0};
  std::size_t at = 64 + word(bytes, 60);
  for (int level = 0; level < kLevels; ++level) {
    const std::uint32_t size = word(bytes, at);  // of a face
    at += 4;
    for (int face = 0; face < 6; ++face) {
      GlFormat here = format;
      const int n = kSize >> level;
      here.bytes = static_cast<int>(size) / (format.format ? n * n : n * n / 16);
      upload(here, face, level, bytes.data() + at);
      at += (size + 3) / 4 * 4;
    }
  }
  EXPECT_EQ(at, bytes.size());
}

constexpr const char* kShader = R"(#version 450
layout(local_size_x = 64) in;
layout(binding = 0) uniform samplerCube cube;
layout(std430, binding = 0) readonly buffer In { vec4 directions[]; };   // and a level
layout(std430, binding = 1) writeonly buffer Out { vec4 colors[]; };
void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i < directions.length()) colors[i] = textureLod(cube, directions[i].xyz, directions[i].w);
}
)";

GLuint program() {
  const GLuint shader = glCreateShader(GL_COMPUTE_SHADER), linked = glCreateProgram();
  glShaderSource(shader, 1, &kShader, nullptr);
  glCompileShader(shader);
  glAttachShader(linked, shader);
  glLinkProgram(linked);
  GLint good = 0;
  glGetProgramiv(linked, GL_LINK_STATUS, &good);
  EXPECT_TRUE(good);
  return linked;
}

using Vec4 = std::array<float, 4>;

std::vector<Vec4> look_up(const std::vector<Vec4>& directions) {
  GLuint buffers[2];
  glGenBuffers(2, buffers);
  const auto bytes = static_cast<GLsizeiptr>(directions.size() * sizeof(Vec4));
  for (GLuint i = 0; i < 2; ++i) {
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, i, buffers[i]);
    glBufferData(GL_SHADER_STORAGE_BUFFER, bytes, i == 0 ? directions.data() : nullptr, GL_STATIC_READ);
  }
  glUseProgram(program());
  glDispatchCompute(static_cast<GLuint>(directions.size() + 63) / 64, 1, 1);
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  std::vector<Vec4> colors(directions.size());
  glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, bytes, colors.data());
  glDeleteBuffers(2, buffers);
  return colors;
}

// The centres of all texels of all faces and levels: along the axes of a face, without any table.
std::vector<Vec4> texel_centres() {
  std::vector<Vec4> directions;
  for (int level = 0; level < kLevels; ++level) {
    const int n = kSize >> level;
    for (int axis = 0; axis < 3; ++axis) {
      for (const float side : {-1.f, 1.f}) {
        for (int i = 0; i < n * n; ++i) {
          Vec4 d{};
          d[static_cast<std::size_t>(axis)] = side;
          d[static_cast<std::size_t>((axis + 1) % 3)] = static_cast<float>(2 * (i % n) + 1) / static_cast<float>(n) - 1;
          d[static_cast<std::size_t>((axis + 2) % 3)] = static_cast<float>(2 * (i / n) + 1) / static_cast<float>(n) - 1;
          d[3] = static_cast<float>(level);
          directions.push_back(d);
        }
      }
    }
  }
  return directions;
}

// What our own reader has at the texel of each direction.
std::vector<Vec4> read_back(const std::string& path, const std::vector<Vec4>& directions) {
  std::vector<PictureFile> levels;
  for (int level = 0; level < kLevels; ++level) {
    ReadOptions options;
    options.level = level;
    options.trust_input = true;
    auto file = read_pictures(path, options);
    EXPECT_TRUE(file) << file.error().message;
    if (!file) return {};
    levels.push_back(std::move(*file));
  }
  std::vector<Vec4> colors;
  for (const Vec4& d : directions) {
    const Location at = find_layout("cube")->locate({d[0], d[1], d[2]});
    const Image& image = levels[static_cast<std::size_t>(d[3])].pictures[static_cast<std::size_t>(at.face)].image;
    const float* texel = image.at(static_cast<int>(at.u * image.width()), static_cast<int>(at.v * image.height()));
    colors.push_back({texel[0], texel[1], texel[2], 1});
  }
  return colors;
}

struct Case {
  PixelType type;
  double of_direction;  // half a step below 1; of 8 bits with the driver's approximation of the curve
  double of_reader;
};

TEST_F(Gl, EveryDirectionAtEveryLevel) {
  // How near BC6H comes is its encoder's matter.
  const Case cases[] = {{half, 0x1p-11, 0},      {float32, 1e-6, 0},  {uint8, 0.006, 0.002},
                        {r11g11b10f, 0x1p-6, 0}, {rgb9e5, 0x1p-9, 0}, {bc6h, 2, 0}};
  const std::vector<Vec4> directions = texel_centres();
  for (const char* name : {"a.dds", "a.ktx"}) {
    for (const auto& [type, of_direction, of_reader] : cases) {
      SCOPED_TRACE(std::string(name) + " " + std::string(name_of(type)));
      const std::string bytes = written(name, type);
      GLuint texture = 0;
      glGenTextures(1, &texture);
      glBindTexture(GL_TEXTURE_CUBE_MAP, texture);
      glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
      glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
      glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, kLevels - 1);
      if (std::string_view(name) == "a.dds") {
        upload_dds(bytes);
      } else {
        upload_ktx(bytes);
      }
      const std::vector<Vec4> colors = look_up(directions);
      ASSERT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
      const std::vector<Vec4> ours = read_back(path(name), directions);
      ASSERT_EQ(ours.size(), colors.size());
      double worst = 0, apart = 0;
      for (std::size_t i = 0; i < colors.size(); ++i) {
        const Vec4& d = directions[i];
        const double length = std::hypot(d[0], d[1], d[2]);
        for (std::size_t c = 0; c < 3; ++c) {
          worst = std::fmax(worst, std::abs(static_cast<double>(colors[i][c]) - (0.5 + 0.45 * d[c] / length)));
        }
        for (std::size_t c = 0; c < 4; ++c) {
          apart = std::fmax(apart, std::abs(static_cast<double>(colors[i][c]) - ours[i][c]));
        }
      }
      EXPECT_LE(worst, of_direction + 1e-6);
      EXPECT_LE(apart, of_reader);
      glDeleteTextures(1, &texture);
    }
  }
}

}  // namespace
}  // namespace envconv
