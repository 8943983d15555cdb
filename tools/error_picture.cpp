// SPDX-License-Identifier: Apache-2.0
#include "error_picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "colormap.h"
#include "draw.h"
#include "text.h"

namespace envconv::tool {
namespace {

using Color = std::array<float, 3>;
constexpr Color white{0.9f, 0.9f, 0.9f}, black{0.01f, 0.01f, 0.01f}, grey{0.2f, 0.2f, 0.2f}, red{0.8f, 0.0f, 0.0f};
constexpr int narrowest = 360;  // pixels that the scale's numbers need

Color color_of(float error, const ErrorScale& scale) {
  if (std::isnan(error)) return red;
  if (error < 0) return grey;
  const Rgb color = scale_color(std::log10(static_cast<double>(error) / scale.low) / ErrorScale::decades);
  return {static_cast<float>(color[0]), static_cast<float>(color[1]), static_cast<float>(color[2])};
}

// The strip [top, image.height()) of the picture: caption, bar, numbers.
void draw_scale(Image& image, int top, int unit, const ErrorScale& scale, const std::string& caption) {
  fill_rectangle(image, 0, top, image.width(), image.height() - top, black);
  draw_text(image, 4 * unit, top + 4 * unit, caption, white, unit);
  const int left = 24 * unit, width = image.width() - 2 * left, bar = top + 15 * unit, bar_height = 8 * unit;
  for (int x = 0; x < width; ++x) {
    const Rgb c = scale_color((x + 0.5) / width);
    const Color color{static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
    fill_rectangle(image, left + x, bar, 1, bar_height, color);
  }
  const auto first = static_cast<int>(std::ceil(std::log10(scale.low) - 1e-9));
  const auto last = static_cast<int>(std::floor(std::log10(scale.high) + 1e-9));
  for (int k = first; k <= last; ++k) {
    const double share = (k - std::log10(scale.low)) / ErrorScale::decades;
    const int x = left + static_cast<int>(std::lround(share * width));
    const std::string label = number_text(std::pow(10, k), 3);
    draw_line(image, {static_cast<double>(x), static_cast<double>(bar)},
              {static_cast<double>(x), static_cast<double>(bar + bar_height + 2 * unit)}, unit, white);
    draw_text(image,
              std::clamp(x - text_width(label, unit) / 2, 0, std::max(0, image.width() - text_width(label, unit))),
              bar + bar_height + 4 * unit, label, white, unit);
  }
}

}  // namespace

ErrorScale error_scale(const EnvImage& errors) {
  float most = 0;
  for (const Image& face : errors.faces)
    for (std::size_t i = 0; i < face.pixel_count(); ++i) most = std::max(most, face.data()[i]);  // NaN never is
  if (!(most > 0)) return {};
  const double power = std::pow(10, std::floor(std::log10(static_cast<double>(most))));
  double high = 10 * power;
  for (const double m : {5.0, 2.0, 1.0})
    if (static_cast<double>(most) <= m * power * (1 + 1e-6)) high = m * power;
  return {high / std::pow(10, ErrorScale::decades), high};
}

Result<Image> error_picture(const EnvImage& errors, const Packing& packing, const ErrorScale& scale,
                            const std::string& caption) {
  std::vector<Image> faces;
  for (const Image& face : errors.faces) {
    Image& colored = faces.emplace_back(face.width(), face.height(), 3);
    for (std::size_t i = 0; i < face.pixel_count(); ++i) {
      const Color color = color_of(face.data()[i], scale);
      std::copy(color.begin(), color.end(), colored.data() + 3 * i);
    }
  }
  ENVCONV_TRY(const Image map, pack(*errors.layout, packing, std::move(faces)));
  const int width = std::max(map.width(), narrowest), unit = std::max(1, width / 700);
  constexpr int strip = 40;  // dots
  Image picture(width, map.height() + strip * unit, 3);
  fill_rectangle(picture, 0, 0, width, picture.height(), black);
  const int left = (width - map.width()) / 2;
  for (int y = 0; y < map.height(); ++y) std::copy_n(map.row(y), 3 * map.width(), picture.at(left, y));
  draw_scale(picture, map.height(), unit, scale, caption);
  return picture;
}

}  // namespace envconv::tool
