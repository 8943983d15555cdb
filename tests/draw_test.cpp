// SPDX-License-Identifier: Apache-2.0
// Text, lines and rectangles in images, and the colours of scales.
#include "draw.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <string>

#include "colormap.h"

namespace envconv {
namespace {

constexpr std::array<float, 1> ink{1.0f};

Image canvas(int width, int height) {
  Image image(width, height, 1);
  image.fill(0);
  return image;
}

double total(const Image& image) {
  double sum = 0;
  for (std::size_t i = 0; i < image.value_count(); ++i) sum += static_cast<double>(image.data()[i]);
  return sum;
}

TEST(Draw, EveryPrintableCharacterIsUniqueAndOnlySpaceIsEmpty) {
  std::set<std::string> seen;
  for (char c = ' '; c <= '~'; ++c) {
    std::string dots;
    for (int row = 0; row < glyph_height + glyph_descent; ++row)
      for (int column = 0; column < glyph_width; ++column) dots += glyph_dot(c, column, row) ? '#' : '.';
    EXPECT_TRUE(seen.insert(dots).second) << c;
    EXPECT_EQ(dots.find('#') == std::string::npos, c == ' ') << c;
  }
  EXPECT_EQ(seen.size(), 95u);
}

TEST(Draw, LettersLookAsTheyAreRead) {
  // The letter L: a stem on the left, a foot along the baseline, nothing below.
  for (int row = 0; row < glyph_height; ++row)
    for (int column = 0; column < glyph_width; ++column)
      EXPECT_EQ(glyph_dot('L', column, row), column == 0 || row == glyph_height - 1);
  for (int column = 0; column < glyph_width; ++column) EXPECT_FALSE(glyph_dot('L', column, glyph_height));
  // Symmetric letters are, in both axes; capitals and digits have no descenders.
  for (const char c : std::string("AHIMOTUVWXY"))
    for (int row = 0; row < glyph_height; ++row)
      for (int column = 0; column < glyph_width; ++column)
        EXPECT_EQ(glyph_dot(c, column, row), glyph_dot(c, glyph_width - 1 - column, row)) << c;
  for (const char c : std::string("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"))
    for (int column = 0; column < glyph_width; ++column) EXPECT_FALSE(glyph_dot(c, column, glyph_height)) << c;
}

TEST(Draw, UnknownCharactersAreQuestionMarks) {
  for (const char c : {'\n', '\x7f', '\xe9'})
    for (int row = 0; row < glyph_height; ++row)
      for (int column = 0; column < glyph_width; ++column)
        EXPECT_EQ(glyph_dot(c, column, row), glyph_dot('?', column, row));
  EXPECT_FALSE(glyph_dot('L', -1, 0));
  EXPECT_FALSE(glyph_dot('L', 0, glyph_height + glyph_descent));
}

TEST(Draw, TextCoversItsDotsScaledAndIsClipped) {
  Image image = canvas(40, 20);
  draw_text(image, 1, 2, "LL", ink, 2);
  // The dots of an L: 7 of the stem and 4 more of the foot; 4 pixels each.
  EXPECT_EQ(total(image), 2 * 11 * 4);
  EXPECT_EQ(*image.at(1, 2), 1);
  EXPECT_EQ(*image.at(0, 2), 0);
  EXPECT_EQ(*image.at(1 + 2 * glyph_advance, 2), 1);
  EXPECT_EQ(*image.at(1 + text_width("LL", 2) - 1, 2 + text_height(2) - 1), 1);
  EXPECT_EQ(*image.at(1 + text_width("LL", 2), 2 + text_height(2) - 1), 0);
  Image corner = canvas(4, 4);
  draw_text(corner, -3, -3, "LLLL", ink, 3);  // no pixel outside is touched: the sanitizers watch
  EXPECT_EQ(total(corner), 0);
  draw_text(corner, 2, 2, "L", ink, 1);
  EXPECT_EQ(total(corner), 2);
}

TEST(Draw, LinesHaveTheirArea) {
  const double length = 100, width = 6;
  for (const double degrees : {0.0, 17.0, 45.0, 90.0, 200.0}) {
    Image image = canvas(256, 256);
    const double angle = degrees * std::numbers::pi / 180;
    const Point from{128.3, 127.6}, to{from.x + length * std::cos(angle), from.y + length * std::sin(angle)};
    draw_line(image, from, to, width, ink);
    const double area = length * width + std::numbers::pi * width * width / 4;
    EXPECT_NEAR(total(image), area, 0.01 * area) << degrees;
    EXPECT_EQ(*image.at(static_cast<int>(from.x), static_cast<int>(from.y)), 1);
  }
  Image image = canvas(8, 8);
  draw_line(image, {-100, -100}, {100, -100}, 3, ink);
  EXPECT_EQ(total(image), 0);
}

TEST(Draw, RectanglesAreClipped) {
  Image image = canvas(8, 8);
  fill_rectangle(image, 6, -2, 10, 4, ink);
  EXPECT_EQ(total(image), 2 * 2);
  fill_rectangle(image, 0, 0, -3, 5, ink);
  EXPECT_EQ(total(image), 2 * 2);
}

// OKLab of linear sRGB: the other direction of Ottosson's pair of formulas, with his constants.
std::array<double, 3> oklab(const Rgb& c) {
  const double l = std::cbrt(0.4122214708 * c[0] + 0.5363325363 * c[1] + 0.0514459929 * c[2]);
  const double m = std::cbrt(0.2119034982 * c[0] + 0.6806995451 * c[1] + 0.1073969566 * c[2]);
  const double s = std::cbrt(0.0883024619 * c[0] + 0.2817188376 * c[1] + 0.6299787005 * c[2]);
  return {0.2104542553 * l + 0.7936177850 * m - 0.0040720468 * s,
          1.9779984951 * l - 2.4285922050 * m + 0.4505937099 * s,
          0.0259040371 * l + 0.7827717662 * m - 0.8086757660 * s};
}

TEST(Colors, OklabIsInvertedAndGreysAreGrey) {
  for (const Rgb& color : {Rgb{0.2, 0.5, 0.9}, Rgb{1, 0, 0}, Rgb{0, 0.01, 0.3}}) {
    const auto lab = oklab(color);
    const Rgb back = linear_from_oklab(lab[0], lab[1], lab[2]);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(back[i], color[i], 1e-6);
  }
  for (const double v : srgb_from_oklch(1, 0, 0)) EXPECT_NEAR(v, 1, 1e-6);
  const Rgb grey = srgb_from_oklch(0.5, 0, 123);
  EXPECT_NEAR(grey[0], grey[1], 1e-6);
  EXPECT_NEAR(grey[1], grey[2], 1e-6);
  // Beyond what screens show, the hue stays and the chroma gives way.
  for (const double v : srgb_from_oklch(0.6, 1, 200)) EXPECT_TRUE(v >= 0 && v <= 1);
}

TEST(Colors, TheScaleRisesInLightnessByEqualDistances) {
  constexpr int steps = 64;
  std::array<double, steps> distance;
  auto last = oklab(scale_color(0));
  for (int i = 1; i <= steps; ++i) {
    const Rgb color = scale_color(static_cast<double>(i) / steps);
    for (const double v : color) EXPECT_TRUE(v > 0 && v < 1) << i;  // nothing was cut off to fit the screen
    const auto lab = oklab(color);
    EXPECT_GT(lab[0], last[0]);
    distance[static_cast<std::size_t>(i) - 1] = std::hypot(lab[0] - last[0], lab[1] - last[1], lab[2] - last[2]);
    last = lab;
  }
  const auto [least, most] = std::ranges::minmax(distance);
  EXPECT_LT(most / least, 1.01);
  EXPECT_EQ(scale_color(-3), scale_color(0));
  EXPECT_EQ(scale_color(7), scale_color(1));
  EXPECT_EQ(scale_color(std::nan("")), scale_color(0));
}

}  // namespace
}  // namespace envconv
