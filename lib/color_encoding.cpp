// SPDX-License-Identifier: Apache-2.0
#include "color_encoding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "assertion.h"

namespace envconv {
namespace {

// Rec. ITU-R BT.709-6; BT.2020-2; SMPTE RP 431-2 with the white of BT.709; SMPTE ST 2065-1; S-2014-004 (ACEScg).
constexpr std::array<Primaries, 5> kPrimaries{{
    {"rec709", kLinearSpace, {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}, 1, 1},
    {"rec2020", "Linear Rec.2020", {0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}, 9, 4},
    {"p3-d65", "Linear P3-D65", {0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290}, 12, 10},
    {"aces-ap0", "ACES2065-1", {0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767}, 0, 6},
    {"aces-ap1", "ACEScg", {0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767}, 0, 7},
}};

// XYZ of a chromaticity at Y = 1 times y, so that y = 0 is no special case.
Vec3 direction_of(double x, double y) { return {x, y, 1 - x - y}; }

Mat3 columns(Vec3 a, Vec3 b, Vec3 c) { return {{a.x, b.x, c.x, a.y, b.y, c.y, a.z, b.z, c.z}}; }

std::optional<Mat3> inverse(const Mat3& a) {
  const Vec3 p{a.m[0], a.m[3], a.m[6]}, q{a.m[1], a.m[4], a.m[7]}, r{a.m[2], a.m[5], a.m[8]};  // columns
  const double determinant = dot(p, cross(q, r));
  if (!std::isfinite(determinant) || std::abs(determinant) < 1e-9) return {};
  const double s = 1 / determinant;
  return transpose(columns(s * cross(q, r), s * cross(r, p), s * cross(p, q)));
}

// Bradford's cone responses.
constexpr Mat3 kBradford{{0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296}};

bool near_identity(const Mat3& a) {
  for (std::size_t i = 0; i < 9; ++i) {
    if (std::abs(a.m[i] - (i % 4 == 0 ? 1 : 0)) > 1e-3) return false;
  }
  return true;
}

Vec3 white_of(const Chromaticities& c) { return (1 / c.white_y) * direction_of(c.white_x, c.white_y); }

Mat3 adaptation(Vec3 to, Vec3 from) {
  const Vec3 a = kBradford * to, b = kBradford * from;
  const Mat3 scale{{a.x / b.x, 0, 0, 0, a.y / b.y, 0, 0, 0, a.z / b.z}};
  return *inverse(kBradford) * (scale * kBradford);
}

}  // namespace

std::array<double, 8> chromaticity_values(const Chromaticities& c) {
  return {c.red_x, c.red_y, c.green_x, c.green_y, c.blue_x, c.blue_y, c.white_x, c.white_y};
}

std::optional<Chromaticities> usable_primaries(const std::array<double, 8>& v) {
  const Chromaticities xy{v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]};
  const std::optional<Mat3> matrix = xyz_from_rgb(xy);
  if (!matrix || !rgb_from_rgb(xy, rec709())) return {};
  // A white that its cones see as nothing could not be adapted to another.
  const Vec3 cones = kBradford * white_of(xy);
  if (!(cones.x > 0.01 && cones.y > 0.01 && cones.z > 0.01)) return {};
  if (const Primaries* named = find_primaries(xy)) return named->xy;
  for (const Primaries& primaries : kPrimaries) {
    if (near_identity(*rgb_from_rgb(primaries.xy, xy))) return primaries.xy;
  }
  return xy;
}

std::span<const Primaries> all_primaries() { return kPrimaries; }

const Primaries& find_named_primaries(std::string_view name) {
  const auto at =
      std::find_if(kPrimaries.begin(), kPrimaries.end(), [&](const Primaries& p) { return p.name == name; });
  ENVCONV_ASSERT(at != kPrimaries.end());
  return *at;
}

const Chromaticities& rec709() { return kPrimaries.front().xy; }

const Primaries* find_primaries(const Chromaticities& xy, double tolerance) {
  const Primaries* best = nullptr;
  const std::array<double, 8> wanted = chromaticity_values(xy);
  for (const Primaries& primaries : kPrimaries) {
    const std::array<double, 8> here = chromaticity_values(primaries.xy);
    double worst = 0;
    for (std::size_t i = 0; i < here.size(); ++i) worst = std::max(worst, std::abs(here[i] - wanted[i]));
    if (worst <= tolerance) best = &primaries, tolerance = worst;
  }
  return best;
}

std::optional<Mat3> xyz_from_rgb(const Chromaticities& c) {
  for (const double value : chromaticity_values(c)) {
    if (!std::isfinite(value) || std::abs(value) > 10) return {};
  }
  if (!(c.white_y > 1e-6)) return {};
  const Mat3 directions =
      columns(direction_of(c.red_x, c.red_y), direction_of(c.green_x, c.green_y), direction_of(c.blue_x, c.blue_y));
  const std::optional<Mat3> back = inverse(directions);
  if (!back) return {};
  const Vec3 scale = *back * white_of(c);
  return directions * Mat3{{scale.x, 0, 0, 0, scale.y, 0, 0, 0, scale.z}};
}

std::optional<Mat3> rgb_from_rgb(const Chromaticities& to, const Chromaticities& from) {
  const std::optional<Mat3> a = xyz_from_rgb(from), b = xyz_from_rgb(to);
  if (!a || !b) return {};
  const std::optional<Mat3> back = inverse(*b);
  if (!back) return {};
  return *back * (adaptation(white_of(to), white_of(from)) * *a);
}

Vec3 luminance_weights(const Chromaticities& xy) {
  std::optional<Mat3> matrix = xyz_from_rgb(xy);
  if (!matrix) matrix = xyz_from_rgb(rec709());
  return {matrix->m[3], matrix->m[4], matrix->m[5]};
}

std::string transfer_text(Transfer transfer, double gamma) {
  switch (transfer) {
    case Transfer::linear: return "linear";
    case Transfer::srgb: return "sRGB";
    case Transfer::unknown: return "unknown curve";
    case Transfer::gamma: break;
  }
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", gamma);
  std::replace(text, text + sizeof text, ',', '.');  // whatever the host's locale
  return std::string("gamma ") + text;
}

std::string_view space_of(const ColorEncoding& encoding) {
  const Primaries* primaries = find_primaries(encoding.primaries.value_or(rec709()));
  if (!primaries) return "";
  if (encoding.transfer == Transfer::linear) return primaries->space;
  return encoding.transfer == Transfer::srgb && primaries->name == "rec709" ? kSrgbSpace : "";
}

}  // namespace envconv
