// SPDX-License-Identifier: Apache-2.0
#include "colormap.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "io_shared.h"

namespace envconv {
namespace {

using Lab = std::array<double, 3>;

Lab from_polar(double lightness, double chroma, double degrees) {
  const double angle = degrees * std::numbers::pi / 180;
  return {lightness, chroma * std::cos(angle), chroma * std::sin(angle)};
}

bool is_shown(const Rgb& linear) {
  return std::ranges::all_of(linear, [](double v) { return v >= 0 && v <= 1; });
}

// The curve that scale_color() runs along, at its own pace: the lightness is linear, the hue turns from violet over
// blue and green to yellow, and the chroma stays just inside what sRGB can show (least at cyan).
Lab curve(double s) { return from_polar(0.2 + 0.74 * s, 0.088 + 0.08 * s * s * s * s, 305 - 200 * s); }

double distance(const Lab& a, const Lab& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

constexpr int scale_steps = 1024;
using Pace = std::array<double, scale_steps + 1>;

// The parameter of the curve at equal shares of its length: by bisection of the summed lengths of small chords.
Pace equal_pace() {
  Pace along;
  along[0] = 0;
  for (std::size_t i = 1; i <= scale_steps; ++i)
    along[i] = along[i - 1] +
               distance(curve(static_cast<double>(i) / scale_steps), curve((static_cast<double>(i) - 1) / scale_steps));
  Pace pace;
  std::size_t k = 0;
  for (std::size_t i = 0; i <= scale_steps; ++i) {
    const double wanted = along[scale_steps] * static_cast<double>(i) / scale_steps;
    while (k + 1 < scale_steps && along[k + 1] < wanted) ++k;
    const double share = (wanted - along[k]) / (along[k + 1] - along[k]);
    pace[i] = (static_cast<double>(k) + share) / scale_steps;
  }
  return pace;
}

}  // namespace

Rgb linear_from_oklab(double lightness, double a, double b) {
  const auto cube = [](double x) { return x * x * x; };
  const double l = cube(lightness + 0.3963377774 * a + 0.2158037573 * b);
  const double m = cube(lightness - 0.1055613458 * a - 0.0638541728 * b);
  const double s = cube(lightness - 0.0894841775 * a - 1.2914855480 * b);
  return {4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
          -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
          -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s};
}

Rgb srgb_from_oklch(double lightness, double chroma, double degrees) {
  const auto linear = [&](double c) {
    const Lab lab = from_polar(lightness, c, degrees);
    return linear_from_oklab(lab[0], lab[1], lab[2]);
  };
  if (!is_shown(linear(chroma))) {
    double shown = 0;
    for (double step = chroma / 2; step > 1e-4; step /= 2)
      if (is_shown(linear(shown + step))) shown += step;
    chroma = shown;
  }
  Rgb color = linear(chroma);
  for (double& v : color) v = linear_to_srgb(std::clamp(v, 0.0, 1.0));
  return color;
}

Rgb scale_color(double t) {
  static const Pace pace = equal_pace();
  const double at = t > 0 ? std::min(t, 1.0) * scale_steps : 0;
  const auto i = std::min(static_cast<std::size_t>(at), static_cast<std::size_t>(scale_steps - 1));
  const Lab lab = curve(pace[i] + (at - static_cast<double>(i)) * (pace[i + 1] - pace[i]));
  Rgb color = linear_from_oklab(lab[0], lab[1], lab[2]);
  for (double& v : color) v = std::clamp(v, 0.0, 1.0);
  return color;
}

}  // namespace envconv
