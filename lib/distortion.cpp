// SPDX-License-Identifier: Apache-2.0
#include "distortion.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "analyze.h"
#include "colormap.h"
#include "draw.h"
#include "packing.h"

namespace envconv {
namespace {

using Color = std::array<float, 3>;
constexpr Color background{0.010f, 0.010f, 0.012f}, unowned{0.09f, 0.09f, 0.1f}, ink{0.9f, 0.9f, 0.9f},
    outline{0.0f, 0.0f, 0.0f};

// What a panel shows: a quantity on a logarithmic scale.
struct Panel {
  const char* title;
  double low, high;  // at the ends of the scale
  bool density;

  double shade(double value) const { return std::log(value / low) / std::log(high / low); }
};

std::string text_of(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

double mean_density(const Layout& layout) {
  double area = 0;
  for (const Face& face : layout.info().faces) area += face.aspect * face.scale * face.scale;
  return 4 * std::numbers::pi / area;
}

// Powers of 2 at the ends, so that middle and ends have readable numbers; what lies beyond 8 looks like 8.
std::array<Panel, 2> panels_of(const Layout& layout) {
  const LayoutFigures& f = figures(layout);
  const double anisotropy = std::clamp(f.anisotropy, 1.5, 8.0);
  const double mean = 4 * std::numbers::pi;
  const double away = std::max(f.largest_texel / mean, mean / f.smallest_texel);
  const double range = std::clamp(std::exp2(std::ceil(std::log2(away) - 1e-6)), 2.0, 8.0);
  return {{{"anisotropy", 1, anisotropy, false}, {"solid angle of a texel over the mean", 1 / range, range, true}}};
}

void put(float* pixel, const Color& color, double share) {
  for (std::size_t c = 0; c < 3; ++c) pixel[c] += static_cast<float>(share) * (color[c] - pixel[c]);
}

// The derivative of the direction per unit of face 0's height, at a point of a face, in an orthonormal basis.
struct Jacobian {
  double xx, xy, yx, yy;
};
Jacobian jacobian(const Layout& layout, int face, double u, double v) {
  const Face& f = layout.info().faces[static_cast<std::size_t>(face)];
  const DirectionJet jet = layout.direction_jet(face, u, v);
  const Vec3 du = (1 / (f.aspect * f.scale)) * jet.du, dv = (1 / f.scale) * jet.dv;
  const double along = length(du);
  const Vec3 e = along > 0 ? (1 / along) * du : Vec3{1, 0, 0};
  const double shear = dot(dv, e);
  return {along, shear, 0, length(dv - shear * e)};
}

struct Plot {
  const Layout& layout;
  Image& image;
  int height;  // of face 0

  void heat(const Panel& panel, const Cell& cell, int face, int x0, int y0) const;
  void indicatrices(const Cell& cell, int face, int x0, int y0) const;
  void indicatrix(const Jacobian& j, double x, double y, double radius, double reach, const Cell& cell, int x0,
                  int y0) const;
  void scale(const Panel& panel, int x, int y, int width, int letter) const;
};

void Plot::heat(const Panel& panel, const Cell& cell, int face, int x0, int y0) const {
  const double aspect = layout.info().faces[static_cast<std::size_t>(face)].aspect;
  const double area = std::pow(layout.info().faces[static_cast<std::size_t>(face)].scale, 2);
  const double mean = mean_density(layout);
  tbb::parallel_for(0, cell.size.height, [&](int y) {
    for (int x = 0; x < cell.size.width; ++x) {
      const double u = (x + 0.5) / cell.size.width, v = (y + 0.5) / cell.size.height;
      float* pixel = image.at(x0 + cell.x + x, y0 + cell.y + y);
      if (!layout.owns(face, u, v)) {
        std::ranges::copy(unowned, pixel);
        continue;
      }
      const Stretch s = stretch(layout, face, u, v);
      const double value =
          panel.density ? layout.density(face, u, v) / (aspect * area) / mean : s.largest / std::max(s.smallest, 1e-12);
      const Rgb color = scale_color(panel.shade(value));
      for (std::size_t c = 0; c < 3; ++c) pixel[c] = static_cast<float>(color[c]);
    }
  });
}

// {p : |J p| <= radius} around (x, y), p in pixels: a pale disc with a dark rim.
void Plot::indicatrix(const Jacobian& j, double x, double y, double radius, double reach, const Cell& cell, int x0,
                      int y0) const {
  for (int py = std::max(0, static_cast<int>(y - reach)); py < std::min(cell.size.height, static_cast<int>(y + reach));
       ++py)
    for (int px = std::max(0, static_cast<int>(x - reach)); px < std::min(cell.size.width, static_cast<int>(x + reach));
         ++px) {
      const double dx = px + 0.5 - x, dy = py + 0.5 - y;
      const double a = j.xx * dx + j.xy * dy, b = j.yy * dy, r = std::hypot(a, b);
      // Distance from the rim in pixels: the implicit function over the length of its gradient.
      const double gradient = std::hypot(j.xx * a, j.xy * a + j.yy * b) / std::max(r, 1e-300);
      const double inside = (radius - r) / std::max(gradient, 1e-300);
      float* pixel = image.at(x0 + cell.x + px, y0 + cell.y + py);
      put(pixel, ink, 0.4 * std::clamp(inside + 0.5, 0.0, 1.0));
      put(pixel, outline, 0.9 * std::clamp(1.3 - std::abs(inside), 0.0, 1.0));
    }
}

void Plot::indicatrices(const Cell& cell, int face, int x0, int y0) const {
  const double scale = layout.info().faces[static_cast<std::size_t>(face)].scale;
  const double spacing = height * scale / (layout.face_count() > 8 ? 5.0 : 7.0);
  const int columns = std::max(1, static_cast<int>(std::lround(cell.size.width / spacing)));
  const int rows = std::max(1, static_cast<int>(std::lround(cell.size.height / spacing)));
  const double radius = 0.33 * spacing * std::sqrt(mean_density(layout));
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const double u = (i + 0.5) / columns, v = (j + 0.5) / rows;
      // On a crease the derivative is one-sided: a little beside it.
      if (layout.owns(face, u, v))
        indicatrix(jacobian(layout, face, u + 1e-7, v + 2e-7), u * cell.size.width, v * cell.size.height, radius,
                   1.5 * spacing, cell, x0, y0);
    }
}

// A bar with the numbers at its ends and in its middle.
void Plot::scale(const Panel& panel, int x, int y, int width, int letter) const {
  const int bar = 2 * text_height(letter);
  draw_text(image, x, y, panel.title, ink, letter);
  y += text_height(letter) * 3 / 2;
  for (int px = 0; px < width; ++px) {
    const Rgb color = scale_color((px + 0.5) / width);
    const Color pixel{static_cast<float>(color[0]), static_cast<float>(color[1]), static_cast<float>(color[2])};
    fill_rectangle(image, x + px, y, 1, bar, pixel);
  }
  y += bar + text_height(letter) / 2;
  const std::string low = text_of(panel.low), middle = text_of(std::sqrt(panel.low * panel.high)),
                    high = text_of(panel.high);
  draw_text(image, x, y, low, ink, letter);
  draw_text(image, x + (width - text_width(middle, letter)) / 2, y, middle, ink, letter);
  draw_text(image, x + width - text_width(high, letter), y, high, ink, letter);
}

}  // namespace

Result<Image> distortion_picture(const Layout& layout, int height) {
  height = std::max(64, height);
  ENVCONV_TRY(const PackedShape shape, packed_shape(layout, default_packing(layout), height));
  const int letter = std::max(1, height / 120), margin = std::max(8, height / 16);
  const int legend = 7 * text_height(letter);
  const bool side_by_side = shape.size.width <= 2 * shape.size.height;
  const int step_x = side_by_side ? shape.size.width + margin : 0;
  const int step_y = side_by_side ? 0 : shape.size.height + legend + margin;
  const std::int64_t width = std::int64_t{shape.size.width} + step_x + 2 * margin;
  const std::int64_t rows = std::int64_t{shape.size.height} + legend + step_y + 2 * margin;
  if (width * rows > (std::int64_t{1} << 27))
    return Error{ErrorCode::limit, "a picture of " + std::to_string(width) + "x" + std::to_string(rows) +
                                       " pixels is too large (choose a smaller one)"};
  Image image(static_cast<int>(width), static_cast<int>(rows), 3);
  fill_rectangle(image, 0, 0, image.width(), image.height(), background);
  const Plot plot{layout, image, height};
  const std::array<Panel, 2> panels = panels_of(layout);
  for (std::size_t k = 0; k < 2; ++k) {
    const int x = margin + static_cast<int>(k) * step_x, y = margin + static_cast<int>(k) * step_y;
    for (int face = 0; face < layout.face_count(); ++face) {
      const Cell& cell = shape.cells[static_cast<std::size_t>(face)];
      plot.heat(panels[k], cell, face, x, y);
      plot.indicatrices(cell, face, x, y);
    }
    plot.scale(panels[k], x, y + shape.size.height + text_height(letter), std::min(shape.size.width, 60 * 6 * letter),
               letter);
  }
  return image;
}

}  // namespace envconv
