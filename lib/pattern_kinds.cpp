// SPDX-License-Identifier: Apache-2.0
#include "pattern_kinds.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "analyze.h"
#include "draw.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double degree = pi / 180;

// --- zone plate
// ---------------------------------------------------------------------------------------------------------

// Rings around the nearest axis, whose frequency grows with the sine of the angle from it: with the phase
// A (1 - cos angle) it is A sin(angle), and reaches the Nyquist limit of a mean texel, pi per side, at 30 degrees.
PatternFormula zoneplate(const PatternOptions& o) {
  const double A = 2 * pi / mean_texel_side(*o.layout, o.height);
  PatternFormula formula;
  formula.radiance = [A](const PatternPoint& p) {
    const double nearest = std::max({std::abs(p.d.x), std::abs(p.d.y), std::abs(p.d.z)});
    const double value = 0.5 + 0.5 * std::cos(A * (1 - nearest));
    return Radiance{value, value, value};
  };
  formula.bandwidth = A * std::sqrt(2.0 / 3);  // farthest from all axes, at a cube's corner
  formula.crease_near = [](Vec3 d, double angle) {
    const double x = std::abs(d.x), y = std::abs(d.y), z = std::abs(d.z), most = std::max({x, y, z});
    const double second = x + y + z - most - std::min({x, y, z});
    return most - second < 2 * angle;
  };
  return formula;
}

// --- noise
// --------------------------------------------------------------------------------------------------------------

// cos(l angle(d, axis)) is Chebyshev's polynomial T_l of a dot product, and so has no harmonics above l: a sum of these
// around axes that are uniform on the sphere is isotropic in law and exactly band-limited.
struct RingWave {
  Vec3 axis;
  std::array<int, 3> l;
  std::array<double, 3> amplitude;
};

std::vector<RingWave> ring_waves(const PatternOptions& o) {
  constexpr int count = 48;
  constexpr double deviation = 0.1;
  std::mt19937_64 engine(o.seed);
  const auto uniform = [&] { return static_cast<double>(engine() >> 11) * 0x1p-53; };
  std::vector<RingWave> waves(count);
  for (RingWave& wave : waves) {
    const double y = 2 * uniform() - 1, longitude = 2 * pi * uniform(), r = std::sqrt(1 - y * y);
    wave.axis = {r * std::sin(longitude), y, r * std::cos(longitude)};
    for (std::size_t c = 0; c < 3; ++c) {
      // As many waves of a degree as it has harmonics: nearly a flat spectrum.
      const double L = o.degree + 1.0;
      wave.l[c] = std::clamp(static_cast<int>(std::sqrt(1 + uniform() * (L * L - 1))), 1, o.degree);
      wave.amplitude[c] = deviation * std::sqrt(2.0 / count) * (uniform() < 0.5 ? -1 : 1);
    }
  }
  return waves;
}

PatternFormula noise(const PatternOptions& o) {
  const auto waves = std::make_shared<const std::vector<RingWave>>(ring_waves(o));
  // The mean of T_l over the sphere, which is taken off: 0 for odd l, 1 / (1 - l^2) for even.
  Radiance offset{0.5, 0.5, 0.5};
  for (const RingWave& wave : *waves)
    for (std::size_t c = 0; c < 3; ++c)
      if (wave.l[c] % 2 == 0) offset[c] -= wave.amplitude[c] / (1.0 - double{1} * wave.l[c] * wave.l[c]);
  PatternFormula formula;
  formula.radiance = [waves, offset](const PatternPoint& p) {
    Radiance sum = offset;
    for (const RingWave& wave : *waves) {
      const double angle = std::acos(std::clamp(dot(wave.axis, p.d), -1.0, 1.0));
      for (std::size_t c = 0; c < 3; ++c) sum[c] += wave.amplitude[c] * std::cos(wave.l[c] * angle);
    }
    return sum;
  };
  formula.bandwidth = o.degree;
  return formula;
}

// --- grid
// ---------------------------------------------------------------------------------------------------------------

constexpr std::array<Radiance, 3> axis_colors{{{0.9, 0.12, 0.08}, {0.12, 0.7, 0.1}, {0.12, 0.3, 1.0}}};  // x, y, z

// An axis of the consumer's as the pattern has it: which one a direction of the world is, and its sign.
struct NamedAxis {
  Vec3 d;
  std::size_t letter;
  bool positive;
};
std::array<NamedAxis, 6> named_axes(const Mat3& consumer_from_world) {
  std::array<NamedAxis, 6> axes;
  for (std::size_t k = 0; k < 6; ++k) {
    const std::size_t c = k / 2;
    const double sign = k % 2 == 0 ? 1 : -1;
    const auto& m = consumer_from_world.m;
    axes[k] = {{sign * m[3 * c], sign * m[3 * c + 1], sign * m[3 * c + 2]}, c, k % 2 == 0};
  }
  return axes;
}

PatternFormula grid(const PatternOptions& o) {
  const double width = std::max(0.4 * degree, 1.5 * mean_texel_side(*o.layout, o.height));
  const double outer = std::cos(std::min(0.5, std::max(3 * degree, 3 * width))),
               inner = std::cos(std::min(0.25, std::max(1.5 * degree, 1.5 * width)));
  const std::array<NamedAxis, 6> axes = named_axes(o.consumer_from_world);
  PatternFormula formula;
  formula.has_edges = true;
  formula.radiance = [=](const PatternPoint& p) {
    // Axes: a disc for the positive end, a ring for the negative.
    for (const NamedAxis& axis : axes) {
      const double cosine = dot(p.d, axis.d);
      if (cosine > outer && (axis.positive || cosine < inner)) return axis_colors[axis.letter];
    }
    const double latitude = std::asin(std::clamp(p.d.y, -1.0, 1.0)), longitude = std::atan2(p.d.x, p.d.z);
    const double parallel = std::round(latitude / (10 * degree));
    // Fewer meridians next to the poles, where they crowd.
    const double step = std::abs(latitude) > 80 * degree ? 30 * degree : 10 * degree;
    const double meridian = std::round(longitude / step) * step / degree;
    const double off_parallel = std::abs(latitude - parallel * 10 * degree);
    const double off_meridian = std::abs(std::asin(std::cos(latitude) * std::sin(longitude - meridian * degree)));
    if (parallel == 0 && off_parallel < width) return Radiance{0.95, 0.75, 0.1};
    if (std::lround(std::abs(meridian)) % 90 == 0 && off_meridian < width)
      return std::lround(meridian) == 0 ? Radiance{0.95, 0.75, 0.1} : Radiance{0.8, 0.8, 0.8};
    if (off_parallel < 0.5 * width && std::abs(parallel) < 9) return Radiance{0.5, 0.5, 0.5};
    if (off_meridian < 0.5 * width) return Radiance{0.5, 0.5, 0.5};
    return Radiance{0.03, 0.03, 0.035};
  };
  return formula;
}

// --- labels
// -------------------------------------------------------------------------------------------------------------

// Whether a text, centred at 0 and `height` high, covers the point; x to the right, y up, in the same measure.
bool in_text(std::string_view text, double x, double y, double height) {
  const double dot = height / glyph_height;
  const int column = static_cast<int>(std::floor(x / dot + 0.5 * text_width(text)));
  const int row = static_cast<int>(std::floor(0.5 * glyph_height - y / dot));
  if (column < 0 || row < 0 || row >= glyph_height + glyph_descent) return false;
  const auto letter = static_cast<std::size_t>(column / glyph_advance);
  return letter < text.size() && glyph_dot(text[letter], column % glyph_advance, row);
}

// Whether an arrow of length 1 from 0 along x covers the point.
bool in_arrow(double x, double y) {
  if (x < 0 || x > 1) return false;
  return x < 0.7 ? std::abs(y) < 0.05 : std::abs(y) < 0.17 * (1 - x) / 0.3;
}

// A place on the sphere with right and up, as seen from the centre.
struct Place {
  Vec3 d, right, up;
};
Place place_at(Vec3 d) {
  // Looking straight up, the picture's top is behind; looking straight down, it is in front.
  const Vec3 up = std::abs(d.y) > 0.999 ? Vec3{0, 0, d.y > 0 ? -1.0 : 1.0} : Vec3{0, 1, 0};
  const Vec3 tangent = normalize(up - dot(up, d) * d);
  return {d, cross(tangent, d), tangent};
}
// x to the right and y up of a direction, in degrees (azimuthal equidistant); false when it is far away.
bool coordinates(const Place& place, Vec3 d, double& x, double& y) {
  const double cosine = dot(place.d, d);
  if (cosine < 0.8) return false;
  const double angle = angle_between(place.d, d), scale = angle > 1e-9 ? angle / std::sin(angle) / degree : 1 / degree;
  x = scale * dot(place.right, d);
  y = scale * dot(place.up, d);
  return true;
}

constexpr Radiance white{0.9, 0.9, 0.9}, yellow{0.95, 0.75, 0.1}, cyan{0.1, 0.75, 0.85};

struct AxisLabel {
  Place place;
  std::string name;
  std::string_view word;
  Radiance color;
};

// What is written on a face itself, in its own axes.
struct FaceLabel {
  std::string name;
  double aspect;
  Radiance tint;
  Place up;  // where the arrow that points up stands
};

struct Card {
  std::vector<AxisLabel> axes;
  std::vector<FaceLabel> faces;
  bool inset;  // corners are not the layout's own

  Radiance radiance(const PatternPoint& p) const;

 private:
  bool on_axis(const PatternPoint& p, Radiance& color) const;
  bool on_face(const PatternPoint& p, Radiance& color) const;
};

bool Card::on_axis(const PatternPoint& p, Radiance& color) const {
  double x, y;
  for (const AxisLabel& label : axes) {
    if (!coordinates(label.place, p.d, x, y)) continue;
    if (!in_text(label.name, x, y - 4, 14) && !in_text(label.word, x, y + 10, 5.5)) continue;
    color = label.color;
    return true;
  }
  return false;
}

bool Card::on_face(const PatternPoint& p, Radiance& color) const {
  const FaceLabel& face = faces[static_cast<std::size_t>(p.face)];
  // In units of the face's height, from its top left corner; y downwards.
  const double x = p.u * face.aspect, y = p.v, corner = inset ? 0.2 : 0.05;
  if (in_text(face.name, x - 0.5 * face.aspect, (inset ? 0.1 : 0.12) - y, 0.075)) {
    color = white;
    return true;
  }
  // In a wide face away from its ends, which a seam may cut off, and from the axis there.
  const double left = x - (inset && face.aspect > 1 ? 0.3 * face.aspect : corner), top = y - corner;
  if (in_arrow(left / 0.16, top / 0.16) || in_arrow(top / 0.16, left / 0.16) || in_text("u", left - 0.2, -top, 0.06) ||
      in_text("v", left, 0.2 - top, 0.06)) {
    color = yellow;
    return true;
  }
  double east, north;
  if (coordinates(face.up, p.d, east, north) &&
      (in_arrow((north + 2) / 9, east / 9) || in_text("up", east, north + 5, 4))) {
    color = cyan;
    return true;
  }
  return false;
}

Radiance Card::radiance(const PatternPoint& p) const {
  Radiance color;
  if (on_face(p, color) || on_axis(p, color)) return color;
  const FaceLabel& face = faces[static_cast<std::size_t>(p.face)];
  const double edge = std::min({p.u * face.aspect, (1 - p.u) * face.aspect, p.v, 1 - p.v});
  const double share = edge < 0.01 ? 3 : 1;  // a frame around each face
  return {share * face.tint[0], share * face.tint[1], share * face.tint[2]};
}

std::string_view word_of(Vec3 d) {
  if (std::abs(d.x) > 0.5) return d.x > 0 ? "right" : "left";
  if (std::abs(d.y) > 0.5) return d.y > 0 ? "top" : "bottom";
  return d.z > 0 ? "front" : "back";
}

PatternFormula labels(const PatternOptions& o) {
  Card card;
  for (const NamedAxis& axis : named_axes(o.consumer_from_world)) {
    const std::string name = std::string(axis.positive ? "+" : "-") + "XYZ"[axis.letter];
    Radiance color = axis_colors[axis.letter];
    for (double& c : color) c = 0.15 + 0.85 * c;
    card.axes.push_back({place_at(axis.d), name, word_of(axis.d), color});
  }
  const LayoutInfo& info = o.layout->info();
  card.inset = info.domain != Domain::square;
  const Mat3 world_from_layout = transpose(layout_from_world(*o.layout, o.consumer_from_world)),
             back = transpose(rotation_matrix(o.rotation));
  for (int f = 0; f < o.layout->face_count(); ++f) {
    const Face& face = info.faces[static_cast<std::size_t>(f)];
    const std::string name = o.layout->face_count() == 1 ? std::string(o.layout->name()) : std::string(face.name);
    // Dark tints, around the circle of hues by the golden angle.
    const double hue = 2.399963 * f;
    const Radiance tint{0.045 + 0.03 * std::cos(hue), 0.045 + 0.03 * std::cos(hue - 2.1),
                        0.055 + 0.03 * std::cos(hue + 2.1)};
    const double at = 0.5 + 0.32 / std::max(1.0, face.aspect);
    const Vec3 d = normalize(back * (world_from_layout * o.layout->direction(f, at, 0.5 + 0.02)));
    card.faces.push_back({name, face.aspect, tint, place_at(d)});
  }
  PatternFormula formula;
  formula.has_edges = true;
  formula.radiance = [card = std::make_shared<const Card>(std::move(card))](const PatternPoint& p) {
    return card->radiance(p);
  };
  return formula;
}

}  // namespace

double mean_texel_side(const Layout& layout, int height) {
  return std::sqrt(4 * pi / static_cast<double>(texel_count(layout, height)));
}

PatternFormula pattern_formula(const PatternOptions& o) {
  PatternFormula formula;
  switch (o.kind) {
    case PatternKind::directions:
      formula.radiance = [m = o.consumer_from_world](const PatternPoint& p) {
        const Vec3 d = m * p.d;
        return Radiance{d.x, d.y, d.z};
      };
      formula.bandwidth = 1;
      break;
    case PatternKind::labels: return labels(o);
    case PatternKind::grid: return grid(o);
    case PatternKind::zoneplate: return zoneplate(o);
    case PatternKind::noise: return noise(o);
    case PatternKind::constant:
    case PatternKind::sun: formula.radiance = [v = o.value](const PatternPoint&) { return v; }; break;
  }
  return formula;
}

}  // namespace envconv
