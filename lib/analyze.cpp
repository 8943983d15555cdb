// SPDX-License-Identifier: Apache-2.0
// Figures are suprema over a layout's own points, and many are reached only in the limit: at an edge, at a crease, at a
// pole.  So every face is sampled on a grid, and from the grid's best points a pattern search climbs on with ever
// smaller steps, always staying a step away from the edge.  A value that still grows as steps shrink is infinite.
//
// Source: Snyder & Mitchell 2001 and Herron, section 4.1, equations 5 and 6.
#include "analyze.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <string_view>
#include <vector>

#include "image.h"

namespace envconv {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

Stretch stretch_of(const DirectionJet& jet, double aspect) {
  const Vec3 du = (1.0 / aspect) * jet.du, dv = jet.dv;
  // Herron's equation 5; the smaller value as area / larger, where the equation's difference would cancel.
  const double a = dot(du, du), b = dot(du, dv), c = dot(dv, dv);
  const double largest = std::sqrt(0.5 * (a + c + std::sqrt((a - c) * (a - c) + 4 * b * b)));
  const double area = length(cross(du, dv));
  return {largest, largest > 0 ? area / largest : 0.0};
}

// What is maximised.
enum Quantity { stretch_quantity, anisotropy_quantity, density_quantity, inverse_density_quantity, quantity_count };

// All quantities at a face point, per unit of face 0's height: an area of one texel measure for all faces.
std::array<double, quantity_count> measure(const Layout& layout, int face, double u, double v) {
  const Face& f = layout.info().faces[static_cast<std::size_t>(face)];
  const Stretch s = stretch_of(layout.direction_jet(face, u, v), f.aspect);
  const double density = s.largest * s.smallest / (f.scale * f.scale);
  std::array<double, quantity_count> values{s.largest / f.scale, s.largest / s.smallest, density, 1.0 / density};
  for (double& value : values)
    if (std::isnan(value)) value = -infinity;
  return values;
}

// Moves a point into the closed set of points a margin inside its face; false where another face owns it.
bool settle(const Layout& layout, int face, double margin, double& u, double& v) {
  if (layout.info().domain == Domain::disc) {
    const double r = 2.0 * std::hypot(u - 0.5, v - 0.5), most = 1.0 - 2.0 * margin;
    if (r > most) u = 0.5 + (u - 0.5) * most / r, v = 0.5 + (v - 0.5) * most / r;
    return true;
  }
  u = std::clamp(u, margin, 1.0 - margin);
  v = std::clamp(v, margin, 1.0 - margin);
  return layout.info().domain == Domain::square || layout.owns(face, u, v);
}

struct Candidate {
  int face = 0;
  double u = 0.5, v = 0.5;
  double value = -infinity;
};

constexpr double longest_step = 0.05;
constexpr double coarse_step = 1e-4;
constexpr double fine_step = 1e-11;

// Climbs from `best` with steps that shrink from `from` to `to`: along axes and diagonals, where creases run, and along
// directions that turn by the golden angle each time, so that none is out of reach along a curved seam.  Steps that
// succeed are doubled, so that a crease's narrow ridge can be followed.
void climb(const Layout& layout, Quantity quantity, double from, double to, Candidate& best) {
  const auto try_step = [&](double du, double dv, double margin) {
    Candidate next{best.face, best.u + du, best.v + dv};
    if (!settle(layout, next.face, margin, next.u, next.v)) return false;
    next.value = measure(layout, next.face, next.u, next.v)[quantity];
    if (!(next.value > best.value + 1e-13 * std::abs(best.value))) return false;
    best = next;
    return true;
  };
  double turn = 0.7;
  for (double step = from; step >= to; step *= 0.5, turn += 2.399963229728653) {
    bool moved = true;
    for (int tries = 0; moved && tries < 8; ++tries) {
      moved = false;
      for (int k = 0; k < 12; ++k) {
        const double angle = k < 8 ? 0.25 * std::numbers::pi * k : turn + 0.5 * std::numbers::pi * k;
        double length = step;
        while (length <= longest_step &&
               try_step(length * std::cos(angle), length * std::sin(angle), std::min(step, 1e-3)))
          moved = true, length *= 2;
      }
    }
  }
}

// The best grid points of all faces.
using Candidates = std::array<std::vector<Candidate>, quantity_count>;

Candidates sample(const Layout& layout) {
  // Odd offsets keep the grid off creases and centres, where derivatives are one-sided or missing.
  const int n = layout.face_count() > 8 ? 10 : 16;
  constexpr int blocks = 3;  // keep the best point of each of 3x3 blocks of a face: maxima lie far apart
  Candidates candidates;
  for (int face = 0; face < layout.face_count(); ++face) {
    std::array<std::array<Candidate, blocks * blocks + 1>, quantity_count> best;
    const auto visit = [&](double u, double v, int block) {
      if (!settle(layout, face, 1e-3, u, v)) return;
      const std::array<double, quantity_count> values = measure(layout, face, u, v);
      for (std::size_t q = 0; q < quantity_count; ++q)
        if (Candidate& c = best[q][static_cast<std::size_t>(block)]; values[q] > c.value) c = {face, u, v, values[q]};
    };
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        visit((i + 0.0137) / (n - 1), (j - 0.0271) / (n - 1), j * blocks / n * blocks + i * blocks / n);
    // Creases may meet in the centre (isocube's pole), where the limit depends on where one comes from.
    for (int k = 0; k < 16; ++k) {
      const double angle = (k + 0.037) / 16 * 2 * std::numbers::pi;
      visit(0.5 + 1e-3 * std::cos(angle), 0.5 + 1e-3 * std::sin(angle), blocks * blocks);
    }
    for (std::size_t q = 0; q < quantity_count; ++q)
      for (const Candidate& c : best[q])
        if (c.value > -infinity) candidates[q].push_back(c);
  }
  return candidates;
}

// The least upper bound of a quantity.
double supremum(const Layout& layout, Quantity quantity, std::vector<Candidate> candidates) {
  std::ranges::sort(candidates, [](const Candidate& a, const Candidate& b) { return a.value > b.value; });
  // Congruent faces and symmetric points give the same values again and again: one climb for each value.
  std::vector<Candidate> distinct;
  for (const Candidate& c : candidates)
    if (distinct.size() < 8 && (distinct.empty() || c.value < distinct.back().value * (1 - 1e-9)))
      distinct.push_back(c);
  for (Candidate& c : distinct) climb(layout, quantity, longest_step, coarse_step, c);
  std::ranges::sort(distinct, [](const Candidate& a, const Candidate& b) { return a.value > b.value; });
  if (distinct.size() > 2) distinct.resize(2);
  double best = 0;
  for (Candidate& c : distinct) {
    const double coarse = c.value;
    climb(layout, quantity, 0.5 * coarse_step, fine_step, c);
    // Towards a singular point a quantity grows as a power of the distance, here ten million times smaller.
    best = std::max(best, c.value > 2 * coarse ? infinity : c.value);
  }
  return best;
}

// Area of all faces in units of face 0's height, and texels in proportion.  It counts whole rectangles, for those are
// stored; the stretch counts only where a layout owns its points.
double face_area(const Layout& layout) {
  double area = 0;
  for (const Face& face : layout.info().faces) area += face.aspect * face.scale * face.scale;
  return area;
}

LayoutFigures measure_figures(const Layout& layout) {
  Candidates candidates = sample(layout);
  const auto sup = [&](Quantity q) { return supremum(layout, q, std::move(candidates[q])); };
  const double largest = sup(stretch_quantity);
  LayoutFigures figures;
  figures.sampling_requirement = face_area(layout) * largest * largest;
  figures.anisotropy = sup(anisotropy_quantity);
  const double densest = sup(density_quantity), thinnest = sup(inverse_density_quantity);
  figures.texel_ratio = densest * thinnest;
  figures.largest_texel = face_area(layout) * densest;
  figures.smallest_texel = face_area(layout) / thinnest;
  return figures;
}

}  // namespace

Stretch stretch(const Layout& layout, int face, double u, double v) {
  return stretch_of(layout.direction_jet(face, u, v), layout.info().faces[static_cast<std::size_t>(face)].aspect);
}

const LayoutFigures& figures(const Layout& layout) {
  static std::mutex mutex;
  static std::map<std::string_view, LayoutFigures> cache;  // a map's entries stay where they are
  const std::lock_guard lock(mutex);
  const auto [entry, is_new] = cache.try_emplace(layout.name());
  if (is_new) entry->second = measure_figures(layout);
  return entry->second;
}

int matching_height(const Layout& source, int source_height, const Layout& target) {
  if (source.name() == target.name()) return source_height;
  const double source_requirement = figures(source).sampling_requirement;
  const double target_requirement = figures(target).sampling_requirement;
  double ratio;
  if (std::isfinite(source_requirement) && std::isfinite(target_requirement)) {
    // Texels in proportion to requirements: heights in proportion to the largest stretches.
    ratio = std::sqrt(target_requirement / face_area(target) / (source_requirement / face_area(source)));
  } else {
    // Not at the very centre, where a formula in polar coordinates may have no derivative.
    const auto central = [](const Layout& layout) { return stretch(layout, 0, 0.5 + 3e-7, 0.5 + 2e-7).largest; };
    ratio = central(target) / central(source);
  }
  // Inclusive placement has one step less than texels.
  const auto lost = [](const Layout& layout) { return layout.info().placement == Placement::inclusive ? 1 : 0; };
  const double steps = ratio * std::max(1, source_height - lost(source));
  // The ratio's own rounding must not cost a texel where it is whole in truth.
  const double height = std::ceil(steps * (1 - 1e-6)) + lost(target);
  return static_cast<int>(std::clamp(height, 1.0, static_cast<double>(std::numeric_limits<int>::max())));
}

int height_for_texels(const Layout& layout, std::int64_t texels) {
  int low = 1, high = 1 << 26;  // more texels than any memory
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    (texel_count(layout, middle) <= texels ? low : high) = middle;
  }
  return low;
}

}  // namespace envconv
