// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "face_reader.h"
#include "seam.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr int points_per_texel = 3;  // along an edge; one of them is a texel's centre
constexpr int most_lines = 1024;     // of texels in which a seam inside a face is looked for, along each axis
constexpr double step_over = 1e-6;   // how far beyond a seam its other side is asked for, in u

// A difference among channels of radiance, and its tally.
struct Tally {
  double largest = 0, squares = 0;
  std::int64_t count = 0;
  void add(double difference) {
    largest = std::max(largest, difference);
    squares += difference * difference;
    ++count;
  }
  double rms() const { return count ? std::sqrt(squares / static_cast<double>(count)) : 0; }
};

class Measure {
 public:
  Measure(const EnvImage& image, const std::vector<Image>& grown, int gutter)
      : image_(image),
        layout_(*image.layout),
        faces_(grown.empty() ? image.faces : grown),
        gutter_(grown.empty() ? 0 : gutter) {}

  SeamError run() {
    for (int f = 0; f < layout_.face_count(); ++f) {
      for (int side = 0; side < 4; ++side) add_edge(f, side);
      if (layout_.info().domain != Domain::square) add_curves(f);
    }
    const SphereMean mean = sphere_mean(image_);
    double brightness = 0;
    int colours = 0;
    for (int c = 0; c < image_.channels.count(); ++c)
      if (c != image_.channels.alpha) brightness += mean.magnitude[static_cast<std::size_t>(c)], ++colours;
    const double unit = brightness > 0 ? colours / brightness : 0;
    return {seams_.largest * unit, seams_.rms() * unit, inside_.largest * unit, inside_.rms() * unit, seams_.count};
  }

 private:
  Size size_of(int f) const {
    const Image& face = image_.faces[static_cast<std::size_t>(f)];
    return {face.width(), face.height()};
  }

  // Places are rounded to 2^-32 of a texel: otherwise a sun's texel beside a seam tells by which last bits the two
  // sides' places differ, and what is equal on both is not found to be.
  void read(const Location& at, double* value) const {
    const Size size = size_of(at.face);
    const auto place = [&](double u, int n) {
      return std::nearbyint((texel_from_u(u, n, image_.placement) + gutter_) * 0x1p32) * 0x1p-32;
    };
    read_clamped(faces_[static_cast<std::size_t>(at.face)], place(at.u, size.width), place(at.v, size.height), value);
  }

  double difference(const double* a, const double* b) const {
    double largest = 0;
    for (int c = 0; c < image_.channels.count(); ++c)
      if (c != image_.channels.alpha) largest = std::max(largest, std::abs(a[c] - b[c]));
    return largest;
  }

  // The point of a face that looks along d, near a guess: Newton's method on the sphere's tangents.
  Location refined(Location at, Vec3 d) const {
    const Location guess = at;
    for (int step = 0; step < 4; ++step) {
      const DirectionJet jet = layout_.direction_jet(at.face, at.u, at.v);
      const double aa = dot(jet.du, jet.du), ab = dot(jet.du, jet.dv), bb = dot(jet.dv, jet.dv),
                   det = aa * bb - ab * ab;
      if (!(det > 1e-9 * aa * bb)) return guess;  // a singular point
      const Vec3 rest = d - jet.d;
      const double pa = dot(rest, jet.du), pb = dot(rest, jet.dv);
      at.u += (bb * pa - ab * pb) / det, at.v += (aa * pb - ab * pa) / det;
      if (!(std::abs(at.u - guess.u) + std::abs(at.v - guess.v) < 100 * step_over)) return guess;
    }
    return at;
  }

  struct Texel {
    int face, x, y;
  };

  // Where a texel's middle looks: of those that are centred on an edge (Placement::inclusive) the middle of the half
  // that there is, else neighbours over a seam would be nowhere apart.
  Vec3 direction(const Texel& t) const {
    const Size size = size_of(t.face);
    const auto middle = [&](int i, int n) {
      const double u = u_from_texel(i, n, image_.placement), half = texel_extent(n, image_.placement) / 2;
      return (std::max(u - half, 0.0) + std::min(u + half, 1.0)) / 2;
    };
    return layout_.direction(t.face, middle(t.x, size.width), middle(t.y, size.height));
  }

  // The texel that is nearest to a point of a seam, of those whose centres the layout owns.
  std::optional<Texel> nearest_texel(const Location& at) const {
    const Size size = size_of(at.face);
    const double x = texel_from_u(at.u, size.width, image_.placement),
                 y = texel_from_u(at.v, size.height, image_.placement);
    const int i = static_cast<int>(std::lround(x)), j = static_cast<int>(std::lround(y));
    std::optional<Texel> nearest;
    double least = HUGE_VAL;
    for (int b = std::max(0, j - 1); b <= std::min(size.height - 1, j + 1); ++b)
      for (int a = std::max(0, i - 1); a <= std::min(size.width - 1, i + 1); ++a) {
        const double distance = (a - x) * (a - x) + (b - y) * (b - y);
        if (distance < least && layout_.owns(at.face, u_from_texel(a, size.width, image_.placement),
                                             u_from_texel(b, size.height, image_.placement)))
          least = distance, nearest = {at.face, a, b};
      }
    return nearest;
  }

  // Both sides' reconstructions at a point of a face's edge of ownership; `out`: a point just beyond it.
  void add_point(const Location& on, Vec3 out) {
    const Vec3 d = layout_.direction(on.face, on.u, on.v);
    const Location other = refined(layout_.locate(out), d);
    if (other.face == on.face && std::abs(other.u - on.u) + std::abs(other.v - on.v) < 1e-4) return;  // no seam
    const auto channels = static_cast<std::size_t>(image_.channels.count());
    a_.resize(channels), b_.resize(channels);
    read(on, a_.data());
    read(other, b_.data());
    seams_.add(difference(a_.data(), b_.data()));
    const std::optional<Texel> here = nearest_texel(on), there = nearest_texel(other);
    const Vec3 step = (here ? direction(*here) : d) - (there ? direction(*there) : d);
    const double length = std::sqrt(dot(step, step));
    if (here) add_inside(*here, length);
    if (there) add_inside(*there, length);
  }

  void add_edge(int f, int side) {
    const Size size = size_of(f);
    const int n = points_per_texel * (side < 2 ? size.height : size.width);
    for (int k = 0; k < n; ++k) {
      const double along = (k + 0.5) / n, edge = side % 2, in = edge > 0 ? 1 - step_over : step_over;
      const auto at = [&](double across) { return side < 2 ? Location{f, across, along} : Location{f, along, across}; };
      const Location inner = at(in), on = at(edge);
      if (!layout_.owns(f, inner.u, inner.v)) continue;
      const Vec3 d = layout_.direction(f, on.u, on.v), before = layout_.direction(f, inner.u, inner.v);
      add_point(on, d + (d - before));
    }
  }

  // Where ownership changes along lines of texels.
  void add_curves(int f) {
    const Size size = size_of(f);
    for (const bool down : {false, true}) {
      const int lines = down ? size.width : size.height, steps = 2 * (down ? size.height : size.width);
      const int n = std::min(lines, most_lines) * points_per_texel;
      for (int k = 0; k < n; ++k) {
        const double along = (k + 0.5) / n;
        const auto at = [&](double t) { return down ? Location{f, along, t} : Location{f, t, along}; };
        const auto owns = [&](double t) { return layout_.owns(f, at(t).u, at(t).v); };
        bool last = owns(step_over);
        for (int s = 1; s <= steps; ++s) {
          const double begin = std::max(step_over, (s - 1.0) / steps),
                       end = std::min(1 - step_over, static_cast<double>(s) / steps);
          const bool here = owns(end);
          if (here != last) add_crossing(f, at, owns, last ? begin : end, last ? end : begin);
          last = here;
        }
      }
    }
  }

  template <class At, class Owns>
  void add_crossing(int f, const At& at, const Owns& owns, double in, double out) {
    for (int step = 0; step < 45; ++step) {
      const double middle = 0.5 * (in + out);
      (owns(middle) ? in : out) = middle;
    }
    const Location on = at(in), beyond = at(in + (out > in ? 1 : -1) * step_over);
    add_point(on, layout_.direction(f, beyond.u, beyond.v));
  }

  // True when the layout owns some of a texel.  What a face shows of a light on a seam may be in a texel that is
  // centred beyond it.
  bool holds_radiance(int f, int x, int y) const {
    const Size size = size_of(f);
    const auto owns = [&](double i, double j) {
      const double u = u_from_texel(i, size.width, image_.placement),
                   v = u_from_texel(j, size.height, image_.placement);
      return layout_.owns(f, std::clamp(u, 0.0, 1.0), std::clamp(v, 0.0, 1.0));
    };
    constexpr double corner = 0.49;
    return owns(x, y) || owns(x - corner, y - corner) || owns(x + corner, y - corner) || owns(x - corner, y + corner) ||
           owns(x + corner, y + corner);
  }

  // A texel that the layout owns some of.
  bool has(const Texel& t) const {
    const Size size = size_of(t.face);
    return t.x >= 0 && t.y >= 0 && t.x < size.width && t.y < size.height &&
           (layout_.info().domain == Domain::square || holds_radiance(t.face, t.x, t.y));
  }

  // The texel at about a distance from another along its row or column, the next at least; none if the face ends
  // before.
  std::optional<Texel> texel_apart(const Texel& from, int right, int down, double distance) const {
    const Vec3 d = direction(from);
    constexpr double much_shorter = 0.5;
    std::optional<Texel> best;
    double least = HUGE_VAL;
    // Rows bend and texels differ in size, so it is measured again where the first guess leads to.
    constexpr int guesses = 4;
    for (int guess = 0, n = 1; guess <= guesses; ++guess) {
      const Texel to{from.face, from.x + n * right, from.y + n * down};
      if (!has(to)) break;
      const Vec3 step = direction(to) - d;
      const double far = std::sqrt(dot(step, step)), miss = std::abs(far - distance);
      if (miss < least && far >= much_shorter * distance) least = miss, best = to;
      const Size size = size_of(from.face);
      const double farthest = size.width + size.height;
      const int next = far > 0 ? static_cast<int>(std::lround(std::clamp(n * distance / far, 1.0, farthest))) : n;
      if (next == n) break;
      n = next;
    }
    return best;
  }

  // Steps along a texel's row and column, each way, as long as one between the two sides: those that begin within one
  // step of the texel, since what lies there is what sides that differ have to show.
  void add_inside(const Texel& beside, double length) {
    const Image& face = image_.faces[static_cast<std::size_t>(beside.face)];
    for (const auto& [right, down] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      std::optional<Texel> to = texel_apart(beside, right, down, length);
      const int texels = to ? std::abs(to->x - beside.x + to->y - beside.y) : 0;
      for (int k = 0; to && k <= texels; ++k) {
        const Texel from{beside.face, beside.x + k * right, beside.y + k * down};
        if (k > 0) to = texel_apart(from, right, down, length);
        if (!to) break;
        std::copy_n(face.at(from.x, from.y), a_.size(), a_.begin());
        std::copy_n(face.at(to->x, to->y), b_.size(), b_.begin());
        inside_.add(difference(a_.data(), b_.data()));
      }
    }
  }

  const EnvImage& image_;
  const Layout& layout_;
  const std::vector<Image>& faces_;
  int gutter_;
  Tally seams_, inside_;
  std::vector<double> a_, b_;  // channels of the two that are compared
};

}  // namespace

SeamError seam_error(const EnvImage& image, const std::vector<Image>& grown, int gutter) {
  return Measure(image, grown, gutter).run();
}

}  // namespace envconv
