// SPDX-License-Identifier: Apache-2.0
// The double sum by a tree of cells.  A cell is a square, in longitude and latitude, of one of six frames whose
// equators and central meridians cross where a cube's faces have their centres.  Two cells that are far apart for their
// size see each other through tensor products of Chebyshev polynomials in these coordinates; the rest is summed
// directly.
//
// The bound.  Let f = ln(1 + |x(s) - y| / 2), where s is one of a cell's coordinates, the other is fixed, h is half the
// cell's side in radians, and d is a lower bound of the angle from the cell to y.  For complex s = a + it, with
// w = x(s) - y, the square w.w has a positive real part as long as sinh(|t|/2) < sin(d(a)/2), d(a) being the angle from
// x(a) to y: on a parallel at latitude b, Re w.w = 4 sin^2(d(a)/2) - 4 cos b (...) sinh^2(t/2), where what stands for
// the dots is at most 1; on a meridian b is 0.  There the root and the logarithm are analytic, and |f| <= |w| / 2.
// Since d(a) falls by no more than a moves, that holds within the Bernstein ellipse of parameter rho = B + sqrt(1 +
// B^2) for B = min(g, sqrt(g (g + 2) / 2)), g = 2 asinh(sin(d/2)) / h.  Interpolation in p Chebyshev points is then
// wrong by at most 4 max|f| rho^(1-p) / (rho - 1), and in four coordinates by sums of this with products of Lebesgue's
// constants, which are below 1 + 2/pi ln p (Trefethen, Approximation Theory and Approximation Practice, chapters 8,
// 15).
#include "discrepancy.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "discrepancy_kernels.h"
#include "image.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi;
constexpr int most_order = 24;  // Chebyshev points a side
constexpr int least_order = 3;
constexpr std::size_t leaf = 1000;  // points that are not split further: what direct sums and interpolation cost alike
constexpr int most_depth = 12;      // points may coincide
constexpr double log_cost = 2;      // of a weighted pair, in pairs of a direct sum

// Moments of a cell's points: sums of T_k(s) T_l(t), in [k][l].
using Moments = std::array<double, static_cast<std::size_t>(most_order* most_order)>;

constexpr int parts = 3;  // a side of a cell: what its distance to others is measured by

struct Node {
  int frame = 0;
  double longitude = 0, latitude = 0, half = 0;  // the square
  std::array<Vec3, parts * parts> caps;          // centres of caps that together hold the square
  double radius = 0;                             // of the caps, in radians
  std::size_t begin = 0, end = 0;
  int children = -1, child_count = 0;  // nodes in a row
  std::size_t count() const { return end - begin; }
};

// Frame k: centre, east and pole are signed axes.
Vec3 axis(int k, double sign) { return {k % 3 == 0 ? sign : 0.0, k % 3 == 1 ? sign : 0.0, k % 3 == 2 ? sign : 0.0}; }
struct Axes {
  Vec3 centre, east, pole;
};
Axes axes_of(int frame) {
  return {axis(frame / 2, frame % 2 ? -1.0 : 1.0), axis(frame / 2 + 1, 1), axis(frame / 2 + 2, 1)};
}

// The frame whose centre is nearest, of which a direction is within 45 degrees both ways.
int frame_of(Vec3 d) {
  const double x = std::abs(d.x), y = std::abs(d.y), z = std::abs(d.z);
  const int k = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  return 2 * k + ((k == 0 ? d.x : k == 1 ? d.y : d.z) < 0 ? 1 : 0);
}

struct Coordinates {
  double longitude, latitude;
};
Coordinates coordinates(const Axes& axes, Vec3 d) {
  return {std::atan2(dot(d, axes.east), dot(d, axes.centre)), std::asin(std::clamp(dot(d, axes.pole), -1.0, 1.0))};
}
Vec3 direction(const Axes& axes, Coordinates at) {
  return std::cos(at.latitude) * (std::cos(at.longitude) * axes.centre + std::sin(at.longitude) * axes.east) +
         std::sin(at.latitude) * axes.pole;
}

// T_k of the p Chebyshev points and what depends on them.
struct Chebyshev {
  std::vector<double> point;   // [p]
  std::vector<double> weight;  // [k][point]: the Lagrange polynomials' coefficients
  explicit Chebyshev(int p) {
    for (int a = 0; a < p; ++a) point.push_back(std::cos(pi * (a + 0.5) / p));
    for (int k = 0; k < p; ++k)
      for (int a = 0; a < p; ++a) weight.push_back((k ? 2.0 : 1.0) / p * std::cos(k * pi * (a + 0.5) / p));
  }
};
const Chebyshev& chebyshev(int p) {
  static const std::vector<Chebyshev> all = [] {
    std::vector<Chebyshev> list;
    for (int n = 0; n <= most_order; ++n) list.emplace_back(n);
    return list;
  }();
  return all[static_cast<std::size_t>(p)];
}

// T_k at t for all k.
std::array<double, most_order> polynomials(double t) {
  std::array<double, most_order> T;
  T[0] = 1, T[1] = t;
  for (std::size_t k = 2; k < most_order; ++k) T[k] = 2 * t * T[k - 1] - T[k - 2];
  return T;
}

// T_k((t + side) / 2) in terms of T_j(t), in [k][j]: what a half of a cell passes on to the whole.
using Shift = std::array<std::array<double, most_order>, most_order>;
Shift shift_of(double side) {
  Shift shift{};
  const Chebyshev& c = chebyshev(most_order);
  for (std::size_t a = 0; a < most_order; ++a) {
    const auto T = polynomials(0.5 * (c.point[a] + side));
    for (std::size_t k = 0; k < most_order; ++k)
      for (std::size_t j = 0; j <= k; ++j) shift[k][j] += T[k] * c.weight[j * most_order + a];
  }
  return shift;
}

// How two cells meet.
struct Meeting {
  int a, b;
  int order_a = 0, order_b = 0;  // 0: directly
};

class Tree {
 public:
  explicit Tree(std::span<const Vec3> points);
  Discrepancy discrepancy(double mean_error);

 private:
  std::size_t size() const { return x_.size(); }
  void place(Node& node) const;
  void split(int index, int depth);
  void fill_moments();
  void leaf_moments(std::size_t index);
  void meet(int a, int b, double mean_error);
  double sum_of(const Meeting& m) const;

  std::vector<double> x_, y_, z_, longitude_, latitude_;  // points in the order of the leaves
  std::vector<Node> nodes_;
  std::vector<Moments> moments_;
  std::vector<Meeting> meetings_;
  double bound_ = 0;  // of the error of the double sum over all ordered pairs
};

void Tree::place(Node& node) const {
  const double part = node.half / parts;
  for (int k = 0; k < parts * parts; ++k) {
    const double longitude = node.longitude + (2 * (k % parts) + 1 - parts) * part;
    const double latitude = node.latitude + (2 * (k / parts) + 1 - parts) * part;
    node.caps[static_cast<std::size_t>(k)] = direction(axes_of(node.frame), {longitude, latitude});
  }
  // The way to any point of a part, straight in both coordinates, is longest where parallels are.
  const double nearest = std::max(0.0, std::abs(node.latitude) - node.half);
  node.radius = part * std::hypot(1.0, std::cos(nearest));
}

Tree::Tree(std::span<const Vec3> points) {
  std::array<std::vector<std::size_t>, 6> members;
  for (std::size_t i = 0; i < points.size(); ++i) members[static_cast<std::size_t>(frame_of(points[i]))].push_back(i);
  for (int frame = 0; frame < 6; ++frame) {
    Node root;
    root.frame = frame;
    root.half = pi / 4;
    root.begin = size();
    for (const std::size_t i : members[static_cast<std::size_t>(frame)]) {
      const Coordinates at = coordinates(axes_of(frame), points[i]);
      x_.push_back(points[i].x), y_.push_back(points[i].y), z_.push_back(points[i].z);
      longitude_.push_back(at.longitude), latitude_.push_back(at.latitude);
    }
    root.end = size();
    place(root);
    nodes_.push_back(root);
  }
  for (int frame = 0; frame < 6; ++frame) split(frame, 0);
}

// Quarters, those without points left out.
void Tree::split(int index, int depth) {
  const Node node = nodes_[static_cast<std::size_t>(index)];
  if (node.count() <= leaf || depth == most_depth) return;
  std::array<std::vector<std::array<double, 5>>, 4> quarters;
  for (std::size_t i = node.begin; i < node.end; ++i) {
    const std::size_t part = (longitude_[i] >= node.longitude ? 1u : 0u) + (latitude_[i] >= node.latitude ? 2u : 0u);
    quarters[part].push_back({x_[i], y_[i], z_[i], longitude_[i], latitude_[i]});
  }
  const int first = static_cast<int>(nodes_.size());
  std::size_t at = node.begin;
  for (std::size_t part = 0; part < 4; ++part) {
    if (quarters[part].empty()) continue;
    Node child;
    child.frame = node.frame;
    child.half = 0.5 * node.half;
    child.longitude = node.longitude + (part % 2 ? child.half : -child.half);
    child.latitude = node.latitude + (part / 2 ? child.half : -child.half);
    child.begin = at;
    for (const auto& p : quarters[part]) {
      x_[at] = p[0], y_[at] = p[1], z_[at] = p[2], longitude_[at] = p[3], latitude_[at] = p[4];
      ++at;
    }
    child.end = at;
    place(child);
    nodes_.push_back(child);
  }
  const int count = static_cast<int>(nodes_.size()) - first;
  nodes_[static_cast<std::size_t>(index)].children = first;
  nodes_[static_cast<std::size_t>(index)].child_count = count;
  quarters = {};
  for (int k = 0; k < count; ++k) split(first + k, depth + 1);
}

void Tree::leaf_moments(std::size_t index) {
  const Node& node = nodes_[index];
  Moments& moments = moments_[index];
  for (std::size_t i = node.begin; i < node.end; ++i) {
    const auto S = polynomials((longitude_[i] - node.longitude) / node.half);
    const auto T = polynomials((latitude_[i] - node.latitude) / node.half);
    for (std::size_t k = 0; k < most_order; ++k)
      for (std::size_t l = 0; l < most_order; ++l) moments[k * most_order + l] += S[k] * T[l];
  }
}

void Tree::fill_moments() {
  moments_.assign(nodes_.size(), Moments{});
  tbb::parallel_for(std::size_t{0}, nodes_.size(), [&](std::size_t i) {
    if (nodes_[i].children < 0) leaf_moments(i);
  });
  const std::array<Shift, 2> shifts{shift_of(-1), shift_of(1)};
  for (std::size_t i = nodes_.size(); i-- > 0;) {  // children come after their parents
    const Node& node = nodes_[i];
    for (int c = node.children; c >= 0 && c < node.children + node.child_count; ++c) {
      const Node& child = nodes_[static_cast<std::size_t>(c)];
      const Moments& from = moments_[static_cast<std::size_t>(c)];
      const Shift& su = shifts[child.longitude > node.longitude ? 1 : 0];
      const Shift& sv = shifts[child.latitude > node.latitude ? 1 : 0];
      Moments half{};
      for (std::size_t k = 0; k < most_order; ++k)
        for (std::size_t j = 0; j <= k; ++j)
          for (std::size_t l = 0; l < most_order; ++l) half[k * most_order + l] += su[k][j] * from[j * most_order + l];
      for (std::size_t k = 0; k < most_order; ++k)
        for (std::size_t l = 0; l < most_order; ++l)
          for (std::size_t j = 0; j <= l; ++j) moments_[i][k * most_order + l] += sv[l][j] * half[k * most_order + j];
    }
  }
}

// Bound of the error of interpolating in one coordinate of a cell with p points; see above.
class EllipseBound {
 public:
  // Of a cell with half side h, seen from an angle of at least d and at most `farthest`.
  EllipseBound(double h, double d, double farthest) {
    const double g = 2 * std::asinh(std::sin(0.5 * d)) / h;
    const double B = std::min(g, std::sqrt(0.5 * g * (g + 2))), A = std::sqrt(1 + B * B);
    rho_ = A + B;
    const double chord = 2 * std::sin(0.5 * std::min(pi, farthest));
    const double stretch = h * (A - 1) + 2 * std::sinh(0.5 * h * B) * std::sqrt(std::cosh(h * B));
    factor_ = 2 * (chord + stretch) / (rho_ - 1);
  }
  double operator()(int p) const { return factor_ * std::pow(rho_, 1 - p); }

 private:
  double rho_, factor_;
};
double lebesgue(int p) { return 1 + 2 / pi * std::log(p); }

// Bounds of the angles between the points of two cells.
struct Angles {
  double least, most;
};
Angles angles_between(const Node& a, const Node& b) {
  double nearest = 4, farthest = 0;  // squares of chords
  for (const Vec3& p : a.caps)
    for (const Vec3& q : b.caps) {
      const Vec3 chord = p - q;
      nearest = std::min(nearest, dot(chord, chord));
      farthest = std::max(farthest, dot(chord, chord));
    }
  const auto angle = [](double square) { return 2 * std::asin(std::min(1.0, 0.5 * std::sqrt(square))); };
  return {angle(nearest) - a.radius - b.radius, angle(farthest) + a.radius + b.radius};
}

// Decides how all points of a meet all points of b, b being a or a cell that comes later.
void Tree::meet(int ia, int ib, double mean_error) {
  const Node &a = nodes_[static_cast<std::size_t>(ia)], &b = nodes_[static_cast<std::size_t>(ib)];
  if (a.count() == 0 || b.count() == 0) return;
  const double pairs = static_cast<double>(a.count()) * static_cast<double>(b.count());
  if (ia == ib) {
    if (a.children < 0) {
      meetings_.push_back({ia, ib});
      return;
    }
    for (int i = a.children; i < a.children + a.child_count; ++i)
      for (int j = i; j < a.children + a.child_count; ++j) meet(i, j, mean_error);
    return;
  }
  const Angles angles = angles_between(a, b);
  if (angles.least > 0.5 * std::max(a.half, b.half)) {
    // Small cells have few partners at their distance, so they may be wrong by more.
    const double h = std::max(a.half, b.half), share = std::min(1.0, 5 * 17.5 * h * h);
    const double target = 0.5 * mean_error / share;
    const EllipseBound bound_a(a.half, angles.least, angles.most), bound_b(b.half, angles.least, angles.most);
    int p = least_order, q = least_order;
    while (p < most_order && bound_a(p) * (1 + lebesgue(p)) > 0.5 * target) ++p;
    const double amplification = lebesgue(p) * lebesgue(p);
    while (q < most_order && bound_b(q) * (1 + lebesgue(q)) * amplification > 0.5 * target) ++q;
    const double bound = bound_a(p) * (1 + lebesgue(p)) + bound_b(q) * (1 + lebesgue(q)) * amplification;
    if (bound <= target && log_cost * p * p * q * q < pairs) {
      meetings_.push_back({ia, ib, p, q});
      bound_ += 4 * pairs * bound;  // in both orders, and the kernel is twice the logarithm
      return;
    }
  }
  const bool small = pairs <= 4096.0;  // not worth a look at their quarters
  if ((a.children < 0 && b.children < 0) || small) {
    meetings_.push_back({ia, ib});
    return;
  }
  if (b.children < 0 || (a.children >= 0 && a.half >= b.half)) {
    for (int i = a.children; i < a.children + a.child_count; ++i) meet(i, ib, mean_error);
  } else {
    for (int j = b.children; j < b.children + b.child_count; ++j) meet(ia, j, mean_error);
  }
}

// A cell's Chebyshev points and the weights that stand for its points: B^T moments B.
struct Expansion {
  std::array<double, static_cast<std::size_t>(most_order*most_order)> x, y, z, weight;
  std::size_t count;
  PointArrays arrays() const { return {x.data(), y.data(), z.data(), weight.data(), count}; }
};
void expand(const Node& node, const Moments& moments, int order, Expansion& out) {
  const auto p = static_cast<std::size_t>(order);
  const Chebyshev& c = chebyshev(order);
  const Axes axes = axes_of(node.frame);
  std::array<double, static_cast<std::size_t>(most_order * most_order)> half{};  // [a][l]
  for (std::size_t k = 0; k < p; ++k)
    for (std::size_t a = 0; a < p; ++a)
      for (std::size_t l = 0; l < p; ++l) half[a * p + l] += c.weight[k * p + a] * moments[k * most_order + l];
  for (std::size_t a = 0; a < p; ++a)
    for (std::size_t b = 0; b < p; ++b) {
      double weight = 0;
      for (std::size_t l = 0; l < p; ++l) weight += half[a * p + l] * c.weight[l * p + b];
      const Vec3 d = direction(axes, {node.longitude + node.half * c.point[a], node.latitude + node.half * c.point[b]});
      const std::size_t at = a * p + b;
      out.x[at] = d.x, out.y[at] = d.y, out.z[at] = d.z, out.weight[at] = weight;
    }
  out.count = p * p;
}

// Of ln(1 + distance / 2) over the ordered pairs of a meeting.
double Tree::sum_of(const Meeting& m) const {
  const Node &a = nodes_[static_cast<std::size_t>(m.a)], &b = nodes_[static_cast<std::size_t>(m.b)];
  if (m.order_a > 0) {
    Expansion at_a, at_b;
    expand(a, moments_[static_cast<std::size_t>(m.a)], m.order_a, at_a);
    expand(b, moments_[static_cast<std::size_t>(m.b)], m.order_b, at_b);
    return 2 * weighted_log_distance_sum(at_a.arrays(), at_b.arrays());
  }
  const auto points = [&](const Node& n) {
    return PointArrays{&x_[n.begin], &y_[n.begin], &z_[n.begin], nullptr, n.count()};
  };
  return (m.a == m.b ? 1 : 2) * log_distance_sum(points(a), points(b));
}

Discrepancy Tree::discrepancy(double mean_error) {
  for (int a = 0; a < 6; ++a)
    for (int b = a; b < 6; ++b) meet(a, b, mean_error);
  if (std::ranges::any_of(meetings_, [](const Meeting& m) { return m.order_a > 0; })) fill_moments();
  std::vector<double> sums(meetings_.size());
  tbb::parallel_for(std::size_t{0}, meetings_.size(), [&](std::size_t i) { sums[i] = sum_of(meetings_[i]); });
  // The mean of the logarithms is nearly 1/2: what is left after N^(3/2) digits' worth have cancelled is wanted, so the
  // sum is compensated (Neumaier), in an order of its own.
  double total = 0, lost = 0;
  for (const double s : sums) {
    const double next = total + s;
    lost += std::abs(total) >= std::abs(s) ? (total - next) + s : (s - next) + total;
    total = next;
  }
  const double n = static_cast<double>(size());
  const double mean = std::max(0.0, ((n * n - 2 * total) - 2 * lost) / (n * n)), error = bound_ / (n * n);
  const double scale = 1 / (2 * std::sqrt(pi)), value = scale * std::sqrt(mean);
  // The root's slope is steepest on the near side; where the error reaches 0, so does the discrepancy.
  return {value,
          std::max(value - scale * std::sqrt(std::max(0.0, mean - error)), scale * std::sqrt(mean + error) - value)};
}

}  // namespace

Discrepancy generalised_discrepancy(std::span<const Vec3> points, double tolerance) {
  if (points.empty()) return {};
  const double n = static_cast<double>(points.size());
  // D^2 = mean / 4 pi, and D is about N^(-3/4) / 4 at best: so wide may the mean's error be for D's to be `tolerance`.
  const double best = 4 * pi * 0.0625 * std::pow(n, -1.5);
  return Tree(points).discrepancy(2 * tolerance * best);
}

std::vector<Vec3> texel_centres(const Layout& layout, int height) {
  std::vector<Vec3> centres;
  centres.reserve(static_cast<std::size_t>(texel_count(layout, height)));
  for (int face = 0; face < layout.face_count(); ++face) {
    const Size size = face_size(layout, face, height);
    const Placement placement = layout.info().placement;
    for (int j = 0; j < size.height; ++j)
      for (int i = 0; i < size.width; ++i) {
        const double u = u_from_texel(i, size.width, placement), v = u_from_texel(j, size.height, placement);
        if (layout.owns(face, u, v)) centres.push_back(layout.direction(face, u, v));
      }
  }
  return centres;
}

}  // namespace envconv
