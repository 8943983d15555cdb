// SPDX-License-Identifier: Apache-2.0
// Drawing into an Image.
#include "draw.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace envconv {
namespace {

constexpr int glyphs_per_block = 16, glyph_rows = glyph_height + glyph_descent;

// The characters from ' ' to '~', sixteen to a block of eight rows.
// clang-format off
constexpr std::array<std::string_view, 6 * glyph_rows> font = {
    //        !     "     #     $     %     &     '     (     )     *     +     ,     -     .     /
    "..... ..#.. .#.#. .#.#. ..#.. ##..# .##.. ..#.. ...#. .#... ..... ..... ..... ..... ..... ....#",
    "..... ..#.. .#.#. .#.#. .#### ##..# #..#. ..#.. ..#.. ..#.. ..#.. ..#.. ..... ..... ..... ....#",
    "..... ..#.. .#.#. ##### #.#.. ...#. #..#. ..#.. .#... ...#. #.#.# ..#.. ..... ..... ..... ...#.",
    "..... ..#.. ..... .#.#. .###. ..#.. .##.. ..... .#... ...#. .###. ##### ..... ##### ..... ..#..",
    "..... ..#.. ..... ##### ..#.# .#... #.#.# ..... .#... ...#. #.#.# ..#.. ..... ..... ..... .#...",
    "..... ..... ..... .#.#. ####. #..## #..#. ..... ..#.. ..#.. ..#.. ..#.. ..##. ..... ..##. #....",
    "..... ..#.. ..... .#.#. ..#.. #..## .##.# ..... ...#. .#... ..... ..... ..##. ..... ..##. #....",
    "..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..#.. ..... ..... .....",
    //  0     1     2     3     4     5     6     7     8     9     :     ;     <     =     >     ?
    ".###. ..#.. .###. .###. ...#. ##### .###. ##### .###. .###. ..... ..... ...#. ..... .#... .###.",
    "#...# .##.. #...# #...# ..##. #.... #.... ....# #...# #...# .##.. .##.. ..#.. ..... ..#.. #...#",
    "#..## ..#.. ....# ....# .#.#. ####. #.... ...#. #...# #...# .##.. .##.. .#... ##### ...#. ....#",
    "#.#.# ..#.. ..##. ..##. #..#. ....# ####. ...#. .###. .#### ..... ..... #.... ..... ....# ..##.",
    "##..# ..#.. .#... ....# ##### ....# #...# ..#.. #...# ....# .##.. .##.. .#... ##### ...#. ..#..",
    "#...# ..#.. #.... #...# ...#. #...# #...# ..#.. #...# ....# .##.. .##.. ..#.. ..... ..#.. .....",
    ".###. .###. ##### .###. ...#. .###. .###. ..#.. .###. .###. ..... .#... ...#. ..... .#... ..#..",
    "..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... .....",
    //  @     A     B     C     D     E     F     G     H     I     J     K     L     M     N     O
    ".###. .###. ####. .###. ####. ##### ##### .###. #...# .###. ..### #...# #.... #...# #...# .###.",
    "#...# #...# #...# #...# #...# #.... #.... #...# #...# ..#.. ...#. #..#. #.... ##.## ##..# #...#",
    "#.### #...# #...# #.... #...# #.... #.... #.... #...# ..#.. ...#. #.#.. #.... #.#.# ##..# #...#",
    "#.#.# ##### ####. #.... #...# ####. ####. #.### ##### ..#.. ...#. ##... #.... #.#.# #.#.# #...#",
    "#.### #...# #...# #.... #...# #.... #.... #...# #...# ..#.. ...#. #.#.. #.... #...# #..## #...#",
    "#.... #...# #...# #...# #...# #.... #.... #...# #...# ..#.. #..#. #..#. #.... #...# #..## #...#",
    ".###. #...# ####. .###. ####. ##### #.... .#### #...# .###. .##.. #...# ##### #...# #...# .###.",
    "..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... .....",
    //  P     Q     R     S     T     U     V     W     X     Y     Z     [     \     ]     ^     _
    "####. .###. ####. .#### ##### #...# #...# #...# #...# #...# ##### .###. #.... .###. ..#.. .....",
    "#...# #...# #...# #.... ..#.. #...# #...# #...# #...# #...# ....# .#... #.... ...#. .#.#. .....",
    "#...# #...# #...# #.... ..#.. #...# #...# #...# .#.#. .#.#. ...#. .#... .#... ...#. #...# .....",
    "####. #...# ####. .###. ..#.. #...# #...# #.#.# ..#.. ..#.. ..#.. .#... ..#.. ...#. ..... .....",
    "#.... #.#.# #.#.. ....# ..#.. #...# .#.#. #.#.# .#.#. ..#.. .#... .#... ...#. ...#. ..... .....",
    "#.... #..#. #..#. ....# ..#.. #...# .#.#. ##.## #...# ..#.. #.... .#... ....# ...#. ..... .....",
    "#.... .##.# #...# ####. ..#.. .###. ..#.. #...# #...# ..#.. ##### .###. ....# .###. ..... .....",
    "..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... ..... #####",
    //  `     a     b     c     d     e     f     g     h     i     j     k     l     m     n     o
    ".#... ..... #.... ..... ....# ..... ..##. ..... #.... ..#.. ...#. #.... .##.. ..... ..... .....",
    "..#.. ..... #.... ..... ....# ..... .#..# ..... #.... ..... ..... #.... ..#.. ..... ..... .....",
    "..... .###. ####. .###. .#### .###. .#... .#### ####. .##.. ..##. #..#. ..#.. ##.#. ####. .###.",
    "..... ....# #...# #...# #...# #...# ###.. #...# #...# ..#.. ...#. #.#.. ..#.. #.#.# #...# #...#",
    "..... .#### #...# #.... #...# ##### .#... #...# #...# ..#.. ...#. ##... ..#.. #.#.# #...# #...#",
    "..... #...# #...# #...# #...# #.... .#... .#### #...# ..#.. ...#. #.#.. ..#.. #.#.# #...# #...#",
    "..... .#### ####. .###. .#### .###. .#... ....# #...# .###. #..#. #..#. .###. #.#.# #...# .###.",
    "..... ..... ..... ..... ..... ..... ..... .###. ..... ..... .##.. ..... ..... ..... ..... .....",
    //  p     q     r     s     t     u     v     w     x     y     z     {     |     }     ~
    "..... ..... ..... ..... .#... ..... ..... ..... ..... ..... ..... ...#. ..#.. .#... .....",
    "..... ..... ..... ..... .#... ..... ..... ..... ..... ..... ..... ..#.. ..#.. ..#.. .....",
    "####. .#### #.##. .#### ###.. #...# #...# #...# #...# #...# ##### ..#.. ..#.. ..#.. .#...",
    "#...# #...# ##..# #.... .#... #...# #...# #...# .#.#. #...# ...#. .#... ..#.. ...#. #.#.#",
    "#...# #...# #.... .###. .#... #...# #...# #.#.# ..#.. #...# ..#.. ..#.. ..#.. ..#.. ...#.",
    "####. .#### #.... ....# .#..# #...# .#.#. #.#.# .#.#. .#### .#... ..#.. ..#.. ..#.. .....",
    "#.... ....# #.... ####. ..##. .#### ..#.. .#.#. #...# ....# ##### ...#. ..#.. .#... .....",
    "#.... ....# ..... ..... ..... ..... ..... ..... ..... .###. ..... ..... ..... ..... .....",
};
// clang-format on

// The pixels [begin, end) of one axis that lie within an image of `size`.
struct Range {
  int begin, end;
};
Range clipped(double begin, double end, int size) {
  return {static_cast<int>(std::clamp(begin, 0.0, static_cast<double>(size))),
          static_cast<int>(std::clamp(end, 0.0, static_cast<double>(size)))};
}

double distance_to_segment(Point p, Point a, Point b) {
  const double dx = b.x - a.x, dy = b.y - a.y, square = dx * dx + dy * dy;
  const double along = square > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / square, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - along * dx, p.y - a.y - along * dy);
}

}  // namespace

bool glyph_dot(char c, int column, int row) {
  if (column < 0 || column >= glyph_width || row < 0 || row >= glyph_rows) return false;
  const int index = (c >= ' ' && c <= '~' ? c : '?') - ' ';
  const std::string_view line = font[static_cast<std::size_t>(index / glyphs_per_block * glyph_rows + row)];
  return line[static_cast<std::size_t>(index % glyphs_per_block * glyph_advance + column)] == '#';
}

void fill_rectangle(Image& image, int x, int y, int width, int height, std::span<const float> colour) {
  ENVCONV_ASSERT(static_cast<int>(colour.size()) == image.channels());
  const Range columns = clipped(x, static_cast<double>(x) + width, image.width());
  const Range rows = clipped(y, static_cast<double>(y) + height, image.height());
  for (int j = rows.begin; j < rows.end; ++j)
    for (int i = columns.begin; i < columns.end; ++i) std::copy(colour.begin(), colour.end(), image.at(i, j));
}

void draw_text(Image& image, int x, int y, std::string_view text, std::span<const float> colour, int scale) {
  for (const char c : text) {
    for (int row = 0; row < glyph_rows; ++row)
      for (int column = 0; column < glyph_width; ++column)
        if (glyph_dot(c, column, row)) fill_rectangle(image, x + column * scale, y + row * scale, scale, scale, colour);
    x += glyph_advance * scale;
  }
}

void draw_line(Image& image, Point from, Point to, double width, std::span<const float> colour) {
  ENVCONV_ASSERT(static_cast<int>(colour.size()) == image.channels());
  const double reach = width / 2 + 1;
  const Range columns = clipped(std::min(from.x, to.x) - reach, std::max(from.x, to.x) + reach + 1, image.width());
  const Range rows = clipped(std::min(from.y, to.y) - reach, std::max(from.y, to.y) + reach + 1, image.height());
  for (int j = rows.begin; j < rows.end; ++j)
    for (int i = columns.begin; i < columns.end; ++i) {
      // Coverage of a pixel as if it were a disc: falls linearly over one pixel across the line's edge.
      const double outside = distance_to_segment({i + 0.5, j + 0.5}, from, to) - width / 2;
      const float coverage = static_cast<float>(std::clamp(0.5 - outside, 0.0, std::min(1.0, width)));
      if (!(coverage > 0)) continue;
      float* pixel = image.at(i, j);
      for (std::size_t c = 0; c < colour.size(); ++c) pixel[c] += coverage * (colour[c] - pixel[c]);
    }
}

}  // namespace envconv
