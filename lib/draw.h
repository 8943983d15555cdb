// SPDX-License-Identifier: Apache-2.0
// Text, lines and rectangles drawn into an Image: scales of error maps, labels of test cards.
//
// Positions are in pixels, x to the right and y downwards from the image's top left corner, so that the centre of its
// first pixel is (0.5, 0.5).  A colour has one value per channel of the image.  What lies outside is left out.
#pragma once

#include <span>
#include <string_view>

#include "image.h"

namespace envconv {

/// The font: printable ASCII in a cell of 5 by 7 dots, and one row below it for descenders.
inline constexpr int glyph_width = 5, glyph_height = 7, glyph_descent = 1;
/// From one character to the next, and from one line of text to the next, in dots.
inline constexpr int glyph_advance = glyph_width + 1, line_advance = glyph_height + glyph_descent + 2;

/// Whether the character's dot is set; column in [0, glyph_width), row in [0, glyph_height + glyph_descent), from the
/// top left.  Outside no dot is set; a character that is not printable ASCII looks like '?'.
bool glyph_dot(char c, int column, int row);

/// Extent of one line of text in pixels, without the gap after its last character and without descenders.
constexpr int text_width(std::string_view text, int scale = 1) {
  return text.empty() ? 0 : (static_cast<int>(text.size()) * glyph_advance - (glyph_advance - glyph_width)) * scale;
}
constexpr int text_height(int scale = 1) { return glyph_height * scale; }

/// One line of text with its top left corner at pixel (x, y); every dot is a square of `scale` >= 1 pixels.
void draw_text(Image& image, int x, int y, std::string_view text, std::span<const float> colour, int scale = 1);

/// The pixels [x, x + width) by [y, y + height).
void fill_rectangle(Image& image, int x, int y, int width, int height, std::span<const float> colour);

struct Point {
  double x = 0, y = 0;
};
/// A line with round ends, `width` pixels wide, antialiased: each pixel is mixed with the colour by its coverage, to
/// about 1/10.
void draw_line(Image& image, Point from, Point to, double width, std::span<const float> colour);

}  // namespace envconv
