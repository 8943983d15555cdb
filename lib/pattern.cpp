// SPDX-License-Identifier: Apache-2.0
// Integration over texels.  Over a small texel the direction and its density are nearly polynomials: they are found at
// three by three points and interpolated between them, however many points the pattern itself asks for.
#include "pattern.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <numbers>
#include <string>
#include <vector>

#include "pattern_kinds.h"
#include "quadrature.h"

namespace envconv {
namespace {

constexpr int edge_samples = 4, finer_edge_samples = 16;  // a side
constexpr int most_nodes = 24;

// Points over [0,1] with weights that add up to 1, and the quadratics through three Gauss-Legendre points there.
struct Nodes {
  std::vector<double> at, weight;
  std::vector<std::array<double, 3>> basis;
};

const std::array<double, 3>& map_points() {
  static const std::array<double, 3> points{0.5 - std::sqrt(0.15), 0.5, 0.5 + std::sqrt(0.15)};
  return points;
}
std::array<double, 3> quadratics(double t) {
  const auto& p = map_points();
  return {(t - p[1]) * (t - p[2]) / ((p[0] - p[1]) * (p[0] - p[2])),
          (t - p[0]) * (t - p[2]) / ((p[1] - p[0]) * (p[1] - p[2])),
          (t - p[0]) * (t - p[1]) / ((p[2] - p[0]) * (p[2] - p[1]))};
}
// Gauss-Legendre points for smooth patterns; for those with edges equal steps, which meet an edge anywhere.
Nodes nodes_of(int n, bool equal_steps) {
  Nodes nodes;
  const Quadrature gauss = box_quadrature(n);
  for (int k = 0; k < n; ++k) {
    const auto i = static_cast<std::size_t>(k);
    nodes.at.push_back(equal_steps ? (k + 0.5) / n : 0.5 + gauss.offset[i]);
    nodes.weight.push_back(equal_steps ? 1.0 / n : gauss.weight[i]);
    nodes.basis.push_back(quadratics(nodes.at.back()));
  }
  return nodes;
}

// Part of a face.
struct Box {
  double u0, v0, width, height;
};

class Integrator {
 public:
  Integrator(const PatternOptions& options, const EnvImage& image)
      : layout_(*options.layout),
        formula_(pattern_formula(options)),
        to_pattern_(transpose(rotation_matrix(options.rotation)) * transpose(layout_from_world(image))) {
    for (int n = 1; n <= most_nodes; ++n) smooth_.push_back(nodes_of(n, false));
    edges_ = nodes_of(edge_samples, true);
    finer_edges_ = nodes_of(finer_edge_samples, true);
  }

  Radiance texel(int face, int i, int j, Size size, Placement placement) const;

 private:
  // The direction, in the pattern's axes, and the density, at 3x3 points of a box.
  struct Map {
    std::array<Vec3, 9> d;
    std::array<double, 9> density;
    double side;  // the longer of the box's two extents, in radians
    bool smooth;  // the quadratics agree with the truth
    bool bent;    // they don't at all: a crease or a pole
  };
  Map map_of(int face, const Box& box) const;
  Radiance mean(int face, const Box& box, const Map& map, const Nodes& nodes, bool* varies) const;
  Radiance exact_mean(int face, const Box& box, const Nodes& nodes, bool* found) const;
  Radiance rim(int face, const Box& box) const;
  Vec3 look(int face, double u, double v) const { return to_pattern_ * layout_.direction(face, u, v); }

  const Layout& layout_;
  PatternFormula formula_;
  Mat3 to_pattern_;
  std::vector<Nodes> smooth_;
  Nodes edges_, finer_edges_;
};

Integrator::Map Integrator::map_of(int face, const Box& box) const {
  Map map;
  double most_u = 0, most_v = 0;
  for (std::size_t k = 0; k < 9; ++k) {
    const double u = box.u0 + box.width * map_points()[k % 3], v = box.v0 + box.height * map_points()[k / 3];
    const DirectionJet jet = layout_.direction_jet(face, u, v);
    map.d[k] = to_pattern_ * jet.d;
    map.density[k] = length(cross(jet.du, jet.dv));
    most_u = std::max(most_u, length(jet.du));
    most_v = std::max(most_v, length(jet.dv));
  }
  map.side = std::max(most_u * box.width, most_v * box.height);
  map.smooth = std::isfinite(map.side) && map.side < 0.1;
  map.bent = !std::isfinite(map.side) || map.side > 0.5;
  for (const auto& [s, t] : {std::pair{0.04, 0.07}, {0.95, 0.03}, {0.06, 0.94}, {0.97, 0.96}}) {
    if (map.bent) break;
    const auto a = quadratics(s), b = quadratics(t);
    Vec3 d{0, 0, 0};
    for (std::size_t k = 0; k < 9; ++k) d = d + (a[k % 3] * b[k / 3]) * map.d[k];
    const Vec3 truth = look(face, box.u0 + box.width * s, box.v0 + box.height * t);
    map.smooth = map.smooth && length(d - truth) <= 2e-4 * map.side;
    map.bent = length(d - truth) > 1e-2 * map.side;
  }
  return map;
}

// The mean by the map's quadratics.  Tells whether any two samples differ.
Radiance Integrator::mean(int face, const Box& box, const Map& map, const Nodes& nodes, bool* varies) const {
  Radiance sum{}, first{};
  double total = 0;
  bool differs = false;
  for (std::size_t j = 0; j < nodes.at.size(); ++j) {
    std::array<Vec3, 3> d{Vec3{0, 0, 0}, Vec3{0, 0, 0}, Vec3{0, 0, 0}};
    std::array<double, 3> density{};
    for (std::size_t k = 0; k < 9; ++k) {
      d[k % 3] = d[k % 3] + nodes.basis[j][k / 3] * map.d[k];
      density[k % 3] += nodes.basis[j][k / 3] * map.density[k];
    }
    for (std::size_t i = 0; i < nodes.at.size(); ++i) {
      const auto& b = nodes.basis[i];
      const Vec3 at = b[0] * d[0] + b[1] * d[1] + b[2] * d[2];
      const double weight =
          nodes.weight[i] * nodes.weight[j] * std::max(0.0, b[0] * density[0] + b[1] * density[1] + b[2] * density[2]);
      const Radiance r =
          formula_.radiance({normalize(at), face, box.u0 + box.width * nodes.at[i], box.v0 + box.height * nodes.at[j]});
      if (i + j == 0) first = r;
      differs = differs || r != first;
      for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * r[c];
      total += weight;
    }
  }
  if (varies) *varies = differs;
  if (!differs) return first;
  for (double& c : sum) c /= total;
  return sum;
}

// The mean over what the layout owns of a disc, or over all of the box elsewhere, without any interpolation.
Radiance Integrator::exact_mean(int face, const Box& box, const Nodes& nodes, bool* found) const {
  const bool disc = layout_.info().domain == Domain::disc;
  Radiance sum{};
  double total = 0;
  for (std::size_t j = 0; j < nodes.at.size(); ++j)
    for (std::size_t i = 0; i < nodes.at.size(); ++i) {
      const double u = box.u0 + box.width * nodes.at[i], v = box.v0 + box.height * nodes.at[j];
      if (disc && !layout_.owns(face, u, v)) continue;
      const DirectionJet jet = layout_.direction_jet(face, u, v);
      const double weight = nodes.weight[i] * nodes.weight[j] * length(cross(jet.du, jet.dv));
      if (!std::isfinite(weight)) continue;
      const Radiance r = formula_.radiance({to_pattern_ * jet.d, face, u, v});
      for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * r[c];
      total += weight;
    }
  *found = total > 0;
  for (double& c : sum) c /= total > 0 ? total : 1;
  return sum;
}

// Beyond a disc: what its rim shows nearest.
Radiance Integrator::rim(int face, const Box& box) const {
  double a = 2 * (box.u0 + 0.5 * box.width) - 1, b = 2 * (box.v0 + 0.5 * box.height) - 1;
  const double r = std::max(1.0, std::hypot(a, b)) * (1 + 1e-9);
  a /= r, b /= r;
  const double u = 0.5 * (1 + a), v = 0.5 * (1 + b);
  return formula_.radiance({look(face, u, v), face, u, v});
}

Radiance Integrator::texel(int face, int i, int j, Size size, Placement placement) const {
  // Texels centred on an edge end there.
  const double u0 = std::max(0.0, u_from_texel(i - 0.5, size.width, placement)),
               u1 = std::min(1.0, u_from_texel(i + 0.5, size.width, placement)),
               v0 = std::max(0.0, u_from_texel(j - 0.5, size.height, placement)),
               v1 = std::min(1.0, u_from_texel(j + 0.5, size.height, placement));
  const Box box{u0, v0, u1 - u0, v1 - v0};
  bool cut = false;  // by a disc's rim
  if (layout_.info().domain == Domain::disc)
    for (int k = 0; k < 4; ++k) cut = cut || !layout_.owns(face, k % 2 ? u1 : u0, k / 2 ? v1 : v0);
  const Map map = map_of(face, box);
  const bool crease = formula_.crease_near && formula_.crease_near(map.d[4], map.side);
  if (map.smooth && !cut && !crease) {
    bool varies = false;
    if (formula_.has_edges) {
      const Radiance coarse = mean(face, box, map, edges_, &varies);
      return varies ? mean(face, box, map, finer_edges_, nullptr) : coarse;
    }
    const int n = 2 + static_cast<int>(std::ceil(0.5 * formula_.bandwidth * map.side));
    return mean(face, box, map, smooth_[static_cast<std::size_t>(std::min(n, most_nodes)) - 1], nullptr);
  }
  // Where something bends or the texel is large: pieces, and each by its own points.
  const double phase = std::isfinite(map.side) ? formula_.bandwidth * map.side : 0;
  const bool whole = !map.bent && !cut && !crease && !formula_.has_edges;
  const int pieces = whole ? 1 : map.side > 0.1 || !std::isfinite(map.side) ? 8 : 4;
  const int n = std::clamp(3 + static_cast<int>(std::ceil(0.5 * phase / pieces)), 3, most_nodes);
  const Nodes& nodes = formula_.has_edges ? edges_ : smooth_[static_cast<std::size_t>(n) - 1];
  Nodes all;
  for (int k = 0; k < pieces; ++k)
    for (std::size_t at = 0; at < nodes.at.size(); ++at) {
      all.at.push_back((k + nodes.at[at]) / pieces);
      all.weight.push_back(nodes.weight[at] / pieces);
    }
  bool found = false;
  const Radiance sum = exact_mean(face, box, all, &found);
  return found ? sum : rim(face, box);
}

Result<Ok> check(const PatternOptions& o) {
  const auto wrong = [](const std::string& text) { return Error{ErrorCode::usage, text}; };
  if (!o.layout || o.height < 1) return wrong("a pattern needs a layout and a height of at least 1");
  for (const double value : o.value)
    if (!std::isfinite(value)) return wrong("a radiance is not a finite number");
  if (o.kind == PatternKind::noise && (o.degree < 1 || o.degree > 4096))
    return wrong("the degree of noise is not from 1 to 4096");
  if (o.kind == PatternKind::sun) {
    if (!(o.diameter > 0 && o.diameter <= 360)) return wrong("the sun's diameter is not from 0 to 360 degrees");
    if (!(length(o.direction) > 0) || !std::isfinite(length(o.direction)))
      return wrong("the sun's direction has no length");
  }
  return Ok{};
}

void draw(const PatternOptions& options, EnvImage& image) {
  const Integrator integrator(options, image);
  for (int f = 0; f < options.layout->face_count(); ++f) {
    Image& face = image.faces[static_cast<std::size_t>(f)];
    const Size size{face.width(), face.height()};
    tbb::parallel_for(0, size.height, [&](int j) {
      for (int i = 0; i < size.width; ++i) {
        const Radiance r = integrator.texel(f, i, j, size, options.placement);
        std::ranges::transform(r, face.at(i, j), [](double value) { return static_cast<float>(value); });
      }
    });
  }
}

}  // namespace

std::span<const PatternInfo> all_patterns() {
  static constexpr std::array<PatternInfo, 7> patterns{{
      {"directions", PatternKind::directions, "red, green, blue are the direction's x, y, z"},
      {"labels", PatternKind::labels, "names of faces and axes, with arrows for u, v and up"},
      {"grid", PatternKind::grid, "a graticule of 10 degrees; a disc marks +x, +y, +z, a ring -x, -y, -z"},
      {"zoneplate", PatternKind::zoneplate,
       "rings around the six axes, at the Nyquist limit of the output 30 degrees from each and past it farther out"},
      {"noise", PatternKind::noise, "band-limited and isotropic; mean 0.5, standard deviation 0.1"},
      {"constant", PatternKind::constant, "the same radiance everywhere"},
      {"sun", PatternKind::sun, "a disc on black, whose energy is exact"},
  }};
  return patterns;
}

const PatternInfo* find_pattern(std::string_view name) {
  for (const PatternInfo& pattern : all_patterns())
    if (pattern.name == name) return &pattern;
  return nullptr;
}

Result<EnvImage> make_pattern(const PatternOptions& options) {
  ENVCONV_CHECK(check(options));
  try {
    EnvImage image;
    image.layout = options.layout;
    image.placement = options.placement;
    image.consumer_from_world = options.consumer_from_world;
    image.channels = Channels::standard(3);
    for (int face = 0; face < options.layout->face_count(); ++face) {
      const Size size = face_size(*options.layout, face, options.height);
      image.faces.emplace_back(size.width, size.height, 3);
    }
    if (options.kind == PatternKind::sun) {
      const Mat3 world_from_layout = transpose(layout_from_world(image));
      draw_sun(options, world_from_layout, image);
    } else {
      draw(options, image);
    }
    return image;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory for the pattern"};
  }
}

}  // namespace envconv
