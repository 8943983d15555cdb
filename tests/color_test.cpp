// SPDX-License-Identifier: Apache-2.0
// Colour management: numbers from standards, laws of transforms, names, rules, broken configurations, host locales.
#include "color.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <locale>
#include <random>

namespace envconv {
namespace {

using Color = std::array<float, 3>;

Color apply(const ColorTransform& transform, Color color) {
  Image image(1, 1, 3);
  std::copy(color.begin(), color.end(), image.data());
  const auto done = transform.apply(image, Channels::standard(3));
  EXPECT_TRUE(done.ok());
  return {image.data()[0], image.data()[1], image.data()[2]};
}

ColorSpace space(const ColorConfig& config, const std::string& name) {
  const auto found = config.find_space(name);
  EXPECT_TRUE(found.ok()) << (found.ok() ? "" : found.error().message);
  return found.ok() ? *found : ColorSpace{};
}

Color convert(const std::string& from, const std::string& to, Color color) {
  const ColorConfig config = ColorConfig::embedded();
  const auto transform = config.transform(space(config, from), space(config, to));
  EXPECT_TRUE(transform.ok()) << (transform.ok() ? "" : transform.error().message);
  return transform.ok() ? apply(*transform, color) : Color{};
}

void expect_near(Color got, Color wanted, float tolerance) {
  for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(got[c], wanted[c], tolerance) << "channel " << c;
}

// --- numbers
// -----------------------------------------------------------------------------------------------------------

TEST(ColorNumbers, SrgbTexture) {
  // IEC 61966-2-1: ((0.5 + 0.055) / 1.055) ^ 2.4, and 0.02 / 12.92 on the line, where OpenColorIO has 12.9232, at which
  // the two pieces meet without a corner.
  expect_near(convert("sRGB - Texture", "Linear Rec.709 (sRGB)", {0.5f, 0.02f, 1.f}), {0.2140411f, 0.00154799f, 1.f},
              5e-7f);
}

TEST(ColorNumbers, GammaTextures) {
  expect_near(convert("Gamma 2.2 Rec.709 - Texture", "lin_rec709", {0.5f, 0.25f, 1.f}),
              {std::pow(0.5f, 2.2f), std::pow(0.25f, 2.2f), 1.f}, 1e-6f);
  expect_near(convert("Gamma 1.8 Rec.709 - Texture", "lin_rec709", {0.5f, 0.25f, 1.f}),
              {std::pow(0.5f, 1.8f), std::pow(0.25f, 1.8f), 1.f}, 1e-6f);
  // Rec. ITU-R BT.1886 with black at 0.
  expect_near(convert("Gamma 2.4 Rec.709 - Texture", "lin_rec709", {0.5f, 0.25f, 1.f}),
              {std::pow(0.5f, 2.4f), std::pow(0.25f, 2.4f), 1.f}, 1e-6f);
}

TEST(ColorNumbers, Acescg) {
  // Figures of the Academy's own configurations.
  expect_near(convert("Linear Rec.709 (sRGB)", "ACEScg", {1, 1, 1}), {1, 1, 1}, 1e-6f);
  expect_near(convert("Linear Rec.709 (sRGB)", "ACEScg", {1, 0, 0}), {0.6131f, 0.0702f, 0.0206f}, 5e-5f);
  // S-2014-004, the matrix from AP1 to AP0.
  expect_near(convert("ACEScg", "ACES2065-1", {1, 0, 0}), {0.6954522414f, 0.0447945634f, -0.0055258826f}, 1e-6f);
  expect_near(convert("ACEScg", "ACES2065-1", {0, 0, 1}), {0.1638690622f, 0.0955343182f, 1.0015006723f}, 1e-6f);
}

TEST(ColorNumbers, Views) {
  const ColorConfig config = ColorConfig::embedded();
  const ColorSpace linear = ColorSpace::linear(rec709());
  const auto plain = config.transform(linear, {"sRGB - Display", "Un-tone-mapped"});
  ASSERT_TRUE(plain.ok()) << plain.error().message;
  // sRGB of 0.18: 1.055 * 0.18^(1/2.4) - 0.055.
  expect_near(apply(*plain, {0.18f, 0.18f, 0.18f}), {0.461356f, 0.461356f, 0.461356f}, 2e-5f);
  expect_near(apply(*plain, {1, 0, 0}), {1, 0, 0}, 5e-3f);
  const auto television = config.transform(linear, {"Rec.1886 Rec.709 - Display", "Un-tone-mapped"});
  ASSERT_TRUE(television.ok());
  expect_near(apply(*television, {0.18f, 0.5f, 1.f}), {std::pow(0.18f, 1 / 2.4f), std::pow(0.5f, 1 / 2.4f), 1.f},
              1e-4f);
  // The tone curve: 0.18 is shown at 0.1 of white (S-2014-004 and the output transform: 4.8 of 48 nits), grey stays
  // grey, brighter is never darker, and whatever the light, it is at most a little above the display's white.
  const auto shown = config.find_view("", "");
  ASSERT_TRUE(shown.ok());
  EXPECT_EQ(shown->view, "ACES 1.0 - SDR Video");
  const auto view = config.transform(linear, *shown);
  ASSERT_TRUE(view.ok());
  const Color grey = apply(*view, {0.18f, 0.18f, 0.18f});
  EXPECT_NEAR(std::pow((grey[1] + 0.055) / 1.055, 2.4), 0.1, 0.005);
  float before = -1;
  for (float v = 1e-4f; v < 1e6f; v *= 1.5f) {
    const Color color = apply(*view, {v, v, v});
    EXPECT_NEAR(color[0], color[1], 2e-3f) << v;
    EXPECT_NEAR(color[2], color[1], 2e-3f) << v;
    EXPECT_GE(color[1], before - 1e-6f) << v;
    EXPECT_LE(color[1], 1.05f) << v;
    EXPECT_GE(color[1], 0.f);
    before = color[1];
  }
  EXPECT_GT(before, 0.99f);
  // 4 and 16 are told apart, which clipping would not do.
  EXPECT_GT(apply(*view, {16, 16, 16})[1] - apply(*view, {4, 4, 4})[1], 0.02f);
}

// The CIE's own definition, step by step, in the test's own arithmetic: XYZ of each primary from x and y, scaled so
// that they add up to white.
using Matrix = std::array<std::array<double, 3>, 3>;

Matrix multiply(const Matrix& a, const Matrix& b) {
  Matrix c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}

// Gauss-Jordan.
Matrix invert(Matrix a) {
  Matrix b{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (std::size_t i = 0; i < 3; ++i) {
    std::size_t pivot = i;
    for (std::size_t k = i; k < 3; ++k)
      if (std::abs(a[k][i]) > std::abs(a[pivot][i])) pivot = k;
    std::swap(a[i], a[pivot]);
    std::swap(b[i], b[pivot]);
    const double d = a[i][i];
    for (std::size_t j = 0; j < 3; ++j) a[i][j] /= d, b[i][j] /= d;
    for (std::size_t k = 0; k < 3; ++k) {
      if (k == i) continue;
      const double f = a[k][i];
      for (std::size_t j = 0; j < 3; ++j) a[k][j] -= f * a[i][j], b[k][j] -= f * b[i][j];
    }
  }
  return b;
}

using Triple = std::array<double, 3>;
Triple xyz(double x, double y) { return {x / y, 1, (1 - x - y) / y}; }
Triple times(const Matrix& m, Triple v) {
  Triple r{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) r[i] += m[i][k] * v[k];
  return r;
}

Matrix to_xyz(const std::array<double, 8>& c) {
  const Triple r = xyz(c[0], c[1]), g = xyz(c[2], c[3]), b = xyz(c[4], c[5]), w = xyz(c[6], c[7]);
  Matrix m;
  for (std::size_t i = 0; i < 3; ++i) m[i] = {r[i], g[i], b[i]};
  const Triple s = times(invert(m), w);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) m[i][j] *= s[j];
  return m;
}

// Bradford's matrix as Lindbloom prints it.
Matrix adapt(Triple from, Triple to) {
  const Matrix cone{{{0.8951, 0.2664, -0.1614}, {-0.7502, 1.7135, 0.0367}, {0.0389, -0.0685, 1.0296}}};
  const Triple a = times(cone, from), b = times(cone, to);
  const Matrix scale{{{b[0] / a[0], 0, 0}, {0, b[1] / a[1], 0}, {0, 0, b[2] / a[2]}}};
  return multiply(invert(cone), multiply(scale, cone));
}

struct Named {
  const char* name;
  std::array<double, 8> xy;
};
// Rec. ITU-R BT.709-6 and BT.2020-2; SMPTE EG 432-1; SMPTE ST 2065-1; S-2014-004.
const std::array<Named, 5> kSpaces{{
    {"Linear Rec.709 (sRGB)", {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}},
    {"Linear Rec.2020", {0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}},
    {"Linear P3-D65", {0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290}},
    {"ACES2065-1", {0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767}},
    {"ACEScg", {0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767}},
}};

// y = 0 has no XYZ at Y = 1.
TEST(ColorMatrices, AgreeWithTheCie) {
  for (const Named& from : kSpaces) {
    for (const Named& to : kSpaces) {
      const Triple w0 = xyz(from.xy[6], from.xy[7]), w1 = xyz(to.xy[6], to.xy[7]);
      const Matrix wanted = multiply(invert(to_xyz(to.xy)), multiply(adapt(w0, w1), to_xyz(from.xy)));
      for (const Color color : {Color{1, 0, 0}, Color{0, 1, 0}, Color{0, 0, 1}, Color{0.25f, -0.5f, 8}}) {
        const Triple exact = times(wanted, {color[0], color[1], color[2]});
        const Color got = convert(from.name, to.name, color);
        for (std::size_t c = 0; c < 3; ++c) {
          EXPECT_NEAR(got[c], exact[c], 4e-6) << from.name << " to " << to.name << ", channel " << c;
        }
      }
      const auto matrix = rgb_from_rgb(
          {to.xy[0], to.xy[1], to.xy[2], to.xy[3], to.xy[4], to.xy[5], to.xy[6], to.xy[7]},
          {from.xy[0], from.xy[1], from.xy[2], from.xy[3], from.xy[4], from.xy[5], from.xy[6], from.xy[7]});
      ASSERT_TRUE(matrix.has_value());
      for (std::size_t i = 0; i < 9; ++i) EXPECT_NEAR(matrix->m[i], wanted[i / 3][i % 3], 1e-12);
    }
  }
}

TEST(ColorMatrices, LuminanceOfRec709) {
  // Rec. ITU-R BT.709-6, item 3.2: 0.2126, 0.7152, 0.0722.
  const Vec3 weights = luminance_weights(rec709());
  EXPECT_NEAR(weights.x, 0.2126, 5e-5);
  EXPECT_NEAR(weights.y, 0.7152, 5e-5);
  EXPECT_NEAR(weights.z, 0.0722, 5e-5);
}

TEST(ColorMatrices, PrimariesUnderAnotherWhiteAreRecognised) {
  // sRGB adapted to D50 as in ICC's sRGB profile (Lindbloom's table of working spaces: 0.648431 0.330856 ...).
  const auto adapted = usable_primaries({0.648431, 0.330856, 0.321152, 0.597871, 0.155886, 0.066044, 0.34567, 0.35850});
  EXPECT_EQ(adapted, rec709());
  // The same primaries with a white that is meant.
  EXPECT_NE(usable_primaries({0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.34567, 0.35850}), rec709());
}

TEST(ColorMatrices, SenselessChromaticitiesAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(usable_primaries({}));
  EXPECT_FALSE(usable_primaries({0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0}));
  EXPECT_FALSE(usable_primaries({nan, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}));
  EXPECT_FALSE(usable_primaries({0.3, 0.3, 0.4, 0.4, 0.5, 0.5, 0.3127, 0.3290}));  // on a line
  EXPECT_FALSE(usable_primaries({1e30, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}));
  EXPECT_TRUE(usable_primaries({0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 0.3333, 0.3333}));  // Radiance's
}

// --- laws
// ----------------------------------------------------------------------------------------------------------------

TEST(ColorLaws, ThereAndBack) {
  const ColorConfig config = ColorConfig::embedded();
  std::mt19937 random(1);
  std::uniform_real_distribution<float> value(0.f, 4.5f);
  for (const std::string& name : config.spaces()) {
    if (config.is_data(space(config, name))) continue;
    const auto there = config.transform(ColorSpace::linear(rec709()), space(config, name));
    const auto back = config.transform(space(config, name), ColorSpace::linear(rec709()));
    ASSERT_TRUE(there.ok() && back.ok()) << name;
    for (int i = 0; i < 50; ++i) {
      // Values above 1 come back, and negative ones too, but for displays, which cannot go below black.
      const float low = name.find("Display") == std::string::npos ? -0.5f : 0.f;
      const Color color{low + value(random), low + value(random), low + value(random)};
      expect_near(apply(*back, apply(*there, color)), color, 1e-4f);
    }
  }
}

TEST(ColorLaws, NegativeAndLargeValuesSurviveLinearConversions) {
  const Color odd{-1e-3f, 60000.f, -250.f};
  const Color there = convert("Linear Rec.709 (sRGB)", "ACES2065-1", odd);
  const Color back = convert("ACES2065-1", "Linear Rec.709 (sRGB)", there);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(back[c], odd[c], 0.05f);
  EXPECT_LT(convert("ACEScg", "Linear Rec.709 (sRGB)", {0, 1, 0})[0], -0.5f) << "out of gamut is not clipped";
}

TEST(ColorLaws, TheSameLightByTwoNamesIsNotTouched) {
  const ColorConfig config = ColorConfig::embedded();
  for (const Named& named : kSpaces) {
    const auto& v = named.xy;
    const auto primaries = usable_primaries(v);
    ASSERT_TRUE(primaries.has_value());
    const auto transform = config.transform(ColorSpace::linear(*primaries), space(config, named.name));
    ASSERT_TRUE(transform.ok());
    EXPECT_TRUE(transform->is_identity()) << named.name;
  }
  EXPECT_TRUE(config.transform(space(config, "Raw"), space(config, "ACEScg"))->is_identity());
}

TEST(ColorLaws, AlphaStaysAndColourIsTakenOffItAroundCurves) {
  const ColorConfig config = ColorConfig::embedded();
  const auto curve = config.transform(space(config, "lin_rec709"), space(config, "sRGB - Texture"));
  ASSERT_TRUE(curve.ok());
  Image image(3, 1, 4);
  const std::array<float, 12> texels{0.1f, 0.2f, 0.05f, 0.25f, 0, 0, 0, 0, 0.3f, 0.3f, 0.3f, 0};
  std::copy(texels.begin(), texels.end(), image.data());
  ASSERT_TRUE(curve->apply(image, Channels::standard(4)).ok());
  const auto srgb = [](double v) { return 1.055 * std::pow(v, 1 / 2.4) - 0.055; };
  EXPECT_NEAR(image.data()[0], 0.25 * srgb(0.4), 1e-6);
  EXPECT_NEAR(image.data()[1], 0.25 * srgb(0.8), 1e-6);
  EXPECT_NEAR(image.data()[2], 0.25 * srgb(0.2), 1e-6);
  EXPECT_EQ(image.data()[3], 0.25f);
  for (std::size_t i = 4; i < 8; ++i) EXPECT_EQ(image.data()[i], 0.f);
  EXPECT_NEAR(image.data()[8], srgb(0.3), 1e-6);  // glow: light without cover
  EXPECT_EQ(image.data()[11], 0.f);
}

TEST(ColorLaws, GreyAndOtherChannels) {
  const ColorConfig config = ColorConfig::embedded();
  const auto curve = config.transform(space(config, "lin_rec709"), space(config, "sRGB - Texture"));
  ASSERT_TRUE(curve.ok());
  Image grey(1, 1, 1);
  grey.data()[0] = 0.18f;
  ASSERT_TRUE(curve->apply(grey, Channels::standard(1)).ok());
  EXPECT_NEAR(grey.data()[0], 0.461356f, 1e-5f);
  // In any order, and depth is no colour.
  Image image(1, 1, 4);
  const std::array<float, 4> texel{0.5f, 7.f, 0.18f, 1.f};
  std::copy(texel.begin(), texel.end(), image.data());
  ASSERT_TRUE(curve->apply(image, {{"B", "Z", "G", "R"}, -1}).ok());
  EXPECT_NEAR(image.data()[2], 0.461356f, 1e-5f);
  EXPECT_EQ(image.data()[1], 7.f);
  const auto none = curve->apply(image, {{"a", "b", "c", "d"}, -1});
  ASSERT_FALSE(none.ok());
  EXPECT_EQ(none.error().code, ErrorCode::unsupported);
}

TEST(ColorLaws, RowsDoNotDependOnTheirNeighbours) {
  const ColorConfig config = ColorConfig::embedded();
  const auto view = config.transform(ColorSpace::linear(rec709()), *config.find_view("", ""));
  ASSERT_TRUE(view.ok());
  Image image(37, 41, 3);
  for (std::size_t i = 0; i < image.value_count(); ++i) image.data()[i] = static_cast<float>(i % 977) * 0.01f;
  Image whole = image.clone();
  ASSERT_TRUE(view->apply(whole, Channels::standard(3)).ok());
  for (const auto& [x, y] : {std::pair{0, 0}, {36, 40}, {17, 23}}) {
    const float* p = image.at(x, y);
    const Color one = apply(*view, {p[0], p[1], p[2]});
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(whole.at(x, y)[c], one[c], 1e-6f);
  }
}

// --- what a space is
// -----------------------------------------------------------------------------------------------------

TEST(ColorEncodings, AreFoundByTransforming) {
  const ColorConfig config = ColorConfig::embedded();
  const auto check = [&](const char* name, Transfer transfer, double gamma, const char* primaries) {
    const ColorEncoding encoding = config.encoding_of(space(config, name));
    EXPECT_EQ(encoding.space, space(config, name).name);
    EXPECT_EQ(encoding.transfer, transfer) << name;
    if (transfer == Transfer::gamma) {
      EXPECT_NEAR(encoding.gamma, gamma, 2e-3) << name;
    }
    const Primaries* found = encoding.primaries ? find_primaries(*encoding.primaries) : nullptr;
    EXPECT_EQ(found ? found->name : "", primaries) << name;
  };
  check("lin_rec709", Transfer::linear, 1, "rec709");
  check("ACEScg", Transfer::linear, 1, "aces-ap1");
  check("aces2065_1", Transfer::linear, 1, "aces-ap0");
  check("Linear Rec.2020", Transfer::linear, 1, "rec2020");
  check("Linear P3-D65", Transfer::linear, 1, "p3-d65");
  check("sRGB - Texture", Transfer::srgb, 1, "rec709");
  check("Gamma 2.4 Rec.709 - Texture", Transfer::gamma, 2.4, "rec709");
  check("Gamma 2.2 Rec.709 - Texture", Transfer::gamma, 2.2, "rec709");
  check("Gamma 1.8 Rec.709 - Texture", Transfer::gamma, 1.8, "rec709");
  check("sRGB - Display", Transfer::srgb, 1, "rec709");
  check("Rec.1886 Rec.709 - Display", Transfer::gamma, 2.4, "rec709");
  check("Raw", Transfer::unknown, 1, "");
}

TEST(ColorEncodings, WorkingSpaces) {
  const ColorConfig config = ColorConfig::embedded();
  const ColorSpace srgb = space(config, "sRGB - Texture"), acescg = space(config, "ACEScg");
  EXPECT_EQ(*config.working_space(srgb, {}), ColorSpace::linear(rec709()));
  EXPECT_EQ(*config.working_space(srgb, acescg), acescg);
  EXPECT_EQ(*config.working_space(acescg, srgb), acescg);
  EXPECT_EQ(config.working_space(space(config, "Raw"), {})->name, "Raw");
}

// --- names -----------------------------------------------------------------------------------------------------------

TEST(ColorNames, NearMissesAreSuggested) {
  const ColorConfig config = ColorConfig::embedded();
  EXPECT_EQ(space(config, "acescg").name, "ACEScg");
  EXPECT_EQ(space(config, "LIN_REC709").name, "Linear Rec.709 (sRGB)");
  EXPECT_EQ(space(config, "scene_linear").name, "Linear Rec.709 (sRGB)");
  for (const auto& [typed, meant] : {std::pair{"ACEScq", "ACEScg"}, {"lin_rec790", "lin_rec709"}, {"srbg", "sRGB"}}) {
    const auto found = config.find_space(typed);
    ASSERT_FALSE(found.ok()) << typed;
    EXPECT_EQ(found.error().code, ErrorCode::usage);
    EXPECT_NE(found.error().message.find(std::string("did you mean '") + meant), std::string::npos)
        << found.error().message;
  }
  const auto none = config.find_space("XXXXXXXXXXXXXXXXXX");
  ASSERT_FALSE(none.ok());
  EXPECT_NE(none.error().message.find("there are: "), std::string::npos);
  for (const std::string& name : config.spaces()) EXPECT_NE(none.error().message.find(name), std::string::npos);
  EXPECT_NE(config.find_view("sRGB - Dispay", "").error().message.find("sRGB - Display"), std::string::npos);
  EXPECT_NE(config.find_view("", "Un-tone-maped").error().message.find("Un-tone-mapped"), std::string::npos);
  EXPECT_EQ(config.find_view("", "un-tone-mapped")->view, "Un-tone-mapped");
}

TEST(ColorNames, RulesForFileNames) {
  const ColorConfig config = ColorConfig::embedded();
  EXPECT_EQ(config.space_from_name("sky_acescg.exr"), "ACEScg");
  EXPECT_EQ(config.space_from_name("/a/b/ACEScg.0001.exr"), "ACEScg");
  EXPECT_EQ(config.space_from_name("sky-lin_rec2020-4k.exr"), "Linear Rec.2020");
  EXPECT_EQ(config.space_from_name("wall.srgb_texture.png"), "sRGB - Texture");
  // Parts of words, folders and extensions say nothing, and data is never guessed.
  for (const char* name : {"sky.exr", "mysrgbfile.png", "/acescg/sky.exr", "draw.exr", "raw.exr", "sky_raw.png", "",
                           "acescg/", "x.acescg"}) {
    EXPECT_EQ(config.space_from_name(name), "") << name;
  }
}

// --- configurations in files
// --------------------------------------------------------------------------------------------

class ColorFiles : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "envconv-color-XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    ::unsetenv("OCIO");
    std::filesystem::remove_all(folder_);
  }
  std::string file(const std::string& name, const std::string& text) {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  std::filesystem::path folder_;
};

// Spaces of odd names: half of ACES2065-1, and a gamma of 1.5.
std::string odd() {
  std::ifstream in(ENVCONV_TESTDATA "/color/odd.ocio", std::ios::binary);
  EXPECT_TRUE(in.good());
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST_F(ColorFiles, NamesMayBeOdd) {
  const auto config = ColorConfig::from_file(file("odd.ocio", odd()));
  ASSERT_TRUE(config.ok()) << config.error().message;
  const auto half = config->transform(space(*config, "the: odd, 'one'"), space(*config, "ref"));
  ASSERT_TRUE(half.ok());
  expect_near(apply(*half, {1, -2, 3}), {0.5f, -1, 1.5f}, 1e-6f);
  const auto view = config->find_view("", "");
  ASSERT_TRUE(view.ok()) << view.error().message;
  EXPECT_EQ(view->display, "d 1");
  const auto shown = config->transform(space(*config, "ref"), *view);
  ASSERT_TRUE(shown.ok());
  EXPECT_NEAR(apply(*shown, {0.25f, 0, 0})[0], std::pow(0.25f, 1 / 1.5f), 1e-5f);
  EXPECT_EQ(config->space_from_name("plate_1.exr"), "gamma 1,5");
  EXPECT_EQ(config->space_from_name("sky.exr"), "");
}

TEST_F(ColorFiles, LinearLightIsRelatedByTheInterchangeRole) {
  const auto config = ColorConfig::from_file(file("odd.ocio", odd()));
  ASSERT_TRUE(config.ok());
  // White of Rec. 709 is white of ACES2065-1, half of which is this configuration's reference.
  const auto transform = config->transform(ColorSpace::linear(rec709()), space(*config, "ref"));
  ASSERT_TRUE(transform.ok()) << transform.error().message;
  expect_near(apply(*transform, {1, 1, 1}), {0.5f, 0.5f, 0.5f}, 1e-5f);
  std::string text = odd();
  text.erase(text.find("  aces_interchange"), std::string("  aces_interchange: \"the: odd, 'one'\"\n").size());
  const auto lone = ColorConfig::from_file(file("lone.ocio", text));
  ASSERT_TRUE(lone.ok()) << lone.error().message;
  const auto none = lone->transform(ColorSpace::linear(rec709()), space(*lone, "ref"));
  ASSERT_FALSE(none.ok());
  EXPECT_NE(none.error().message.find("aces_interchange"), std::string::npos);
}

TEST_F(ColorFiles, BrokenOnesAreErrorsWithTheLibrarysText) {
  std::string no_space = odd(), version = odd();
  no_space.replace(no_space.find("scene_linear: ref"), 17, "scene_linear: nix");
  version.replace(version.find("version: 2"), 10, "version: 99");
  const std::string deep(200000, '[');
  const struct {
    const char *name, *says;
    std::string path;
  } cases[] = {
      {"bad YAML", "yaml", file("a.ocio", "ocio_profile_version: 2\nroles: {default: [\n")},
      {"empty", "", file("b.ocio", "")},
      {"version 99", "version", file("c.ocio", version)},
      {"deep", "", file("d.ocio", deep)},
      {"missing file", "No such file", (folder_ / "none.ocio").string()},
      {"missing space", "nix", file("e.ocio", no_space)},
      {"a folder", "regular file", folder_.string()},
  };
  for (const auto& broken : cases) {
    const auto config = ColorConfig::from_file(broken.path);
    ASSERT_FALSE(config.ok()) << broken.name;
    EXPECT_EQ(config.error().code, ErrorCode::usage) << broken.name;
    EXPECT_NE(config.error().message.find(broken.says), std::string::npos)
        << broken.name << ": " << config.error().message;
    EXPECT_NE(config.error().message.find(broken.path), std::string::npos) << config.error().message;
    EXPECT_EQ(config.error().message.find('\n'), std::string::npos);
    ::setenv("OCIO", broken.path.c_str(), 1);
    EXPECT_FALSE(ColorConfig::from_environment().ok()) << broken.name << ": fell back";
  }
}

TEST_F(ColorFiles, ATableThatIsNoneIsFoundByName) {
  std::string text = odd();
  text += "  - !<ColorSpace>\n    name: outside\n    to_scene_reference: !<FileTransform> {src: /etc/passwd}\n";
  const auto config = ColorConfig::from_file(file("lut.ocio", text));
  ASSERT_TRUE(config.ok()) << config.error().message;
  EXPECT_TRUE(config->find_space("ref").ok());
  const auto found = config->find_space("outside");
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().code, ErrorCode::usage);
  EXPECT_NE(found.error().message.find("passwd"), std::string::npos) << found.error().message;
}

TEST_F(ColorFiles, TheEnvironmentNamesOne) {
  ::unsetenv("OCIO");
  EXPECT_EQ(ColorConfig::from_environment()->path(), "");
  ::setenv("OCIO", "", 1);
  EXPECT_EQ(ColorConfig::from_environment()->path(), "");
  const std::string path = file("odd.ocio", odd());
  ::setenv("OCIO", path.c_str(), 1);
  EXPECT_EQ(ColorConfig::from_environment()->path(), path);
}

// A host whose C++ locale writes 0,5: figures of the embedded configuration stay, and files are refused, not misread.
TEST_F(ColorFiles, CommaLocaleOfTheHost) {
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const std::string path = file("odd.ocio", odd());
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const Color srgb = convert("sRGB - Texture", "ACEScg", {0.5f, 0.25f, 0.75f});
  const ColorConfig embedded = ColorConfig::embedded();
  const auto view = embedded.transform(ColorSpace::linear(rec709()), *embedded.find_view("", ""));
  const Color shown = view.ok() ? apply(*view, {0.18f, 4, 0.5f}) : Color{};
  const auto refused = ColorConfig::from_file(path);
  std::locale::global(before);
  ASSERT_TRUE(view.ok());
  EXPECT_EQ(srgb, convert("sRGB - Texture", "ACEScg", {0.5f, 0.25f, 0.75f}));
  EXPECT_EQ(shown, apply(*ColorConfig::embedded().transform(ColorSpace::linear(rec709()), *embedded.find_view("", "")),
                         {0.18f, 4, 0.5f}));
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().message.find("locale"), std::string::npos);
}

}  // namespace
}  // namespace envconv
