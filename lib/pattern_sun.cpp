// SPDX-License-Identifier: Apache-2.0
// A disc of constant radiance.  Each texel's share of it is found by halving the texel until pieces lie inside,
// outside, or across a rim that is nearly straight; what the pieces across the rim then lack or have too much of the
// disc's known solid angle is made up in proportion, so that the energy is exact.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "analyze.h"
#include "pattern_kinds.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr int least_halvings = 6;   // of a texel that the rim crosses
constexpr int most_halvings = 48;   // for a disc far smaller than a texel
constexpr int owner_halvings = 12;  // of a texel that a seam crosses

// Of one texel: around a singular point, such as a sphere map's rim, a small sun's own rim is long and thin.
constexpr int most_pieces = 8192;

struct Box {
  double u0, v0, width, height;
};

// Coverage of boxes of one face.
class SunCover {
 public:
  SunCover(const Layout& layout, int face, Vec3 centre, double radius)
      : layout_(layout), face_(face), centre_(centre), radius_(radius) {}

  // Solid angles of a box: what the layout owns of it, or all of it when `owned` is false; and how much the sun covers.
  struct Cover {
    double all = 0, covered = 0;
  };
  Cover cover(const Box& box, bool owned, int depth, int& budget) const;
  // A quick look: the sun is farther away than the box reaches.
  bool misses(const Box& box) const { return look(box).least > radius_; }

 private:
  struct Look {
    double least, most;   // bounds of the angle from the sun's centre
    double mean, spread;  // angle in the box's centre, and difference over the box
    double reach;         // from the box's centre to its corners
    int owned;            // of nine points
    bool wide;            // it is longer along u than along v
  };
  Look look(const Box& box) const;
  double solid_angle(const Box& box) const;

  const Layout& layout_;
  int face_;
  Vec3 centre_;
  double radius_;
};

SunCover::Look SunCover::look(const Box& box) const {
  Look look{};
  const Vec3 middle = layout_.direction(face_, box.u0 + 0.5 * box.width, box.v0 + 0.5 * box.height);
  look.mean = angle_between(middle, centre_);
  double low = look.mean, high = look.mean;
  const bool square = layout_.info().domain == Domain::square;
  for (int k = 0; k < 9; ++k) {
    const double u = box.u0 + 0.5 * (k % 3) * box.width, v = box.v0 + 0.5 * (k / 3) * box.height;
    look.owned += square || layout_.owns(face_, u, v) ? 1 : 0;
    const Vec3 d = layout_.direction(face_, u, v);
    look.reach = std::max(look.reach, angle_between(d, middle));
    const double angle = angle_between(d, centre_);
    low = std::min(low, angle);
    high = std::max(high, angle);
  }
  // Sides of a box may bulge a little beyond its corners.
  const double reach = 1.15 * look.reach + 1e-12;
  look.least = look.mean - reach;
  look.most = look.mean + reach;
  look.spread = high - low;
  const auto at = [&](double s, double t) {
    return layout_.direction(face_, box.u0 + s * box.width, box.v0 + t * box.height);
  };
  look.wide = angle_between(at(0.25, 0.5), at(0.75, 0.5)) > angle_between(at(0.5, 0.25), at(0.5, 0.75));
  return look;
}

double SunCover::solid_angle(const Box& box) const {
  constexpr double t = 0.28867513459481287;  // two Gauss-Legendre points a side
  double sum = 0;
  for (int k = 0; k < 4; ++k)
    sum += layout_.density(face_, box.u0 + box.width * (0.5 + (k % 2 ? t : -t)),
                           box.v0 + box.height * (0.5 + (k / 2 ? t : -t)));
  return 0.25 * sum * box.width * box.height;
}

SunCover::Cover SunCover::cover(const Box& box, bool owned, int depth, int& budget) const {
  const Look at = look(box);
  const bool across_seam = owned && at.owned < 9;
  if (across_seam && at.owned == 0 && depth > 0) return {};
  const bool inside = at.most<radius_, outside = at.least> radius_;
  const bool straight = at.reach < 0.05 * std::min(radius_, 1.0) && depth >= least_halvings;
  const bool done =
      across_seam ? depth >= owner_halvings && (inside || outside || straight) : inside || outside || straight;
  if (done || depth >= most_halvings || --budget < 0) {
    const double all = solid_angle(box) * (across_seam ? at.owned / 9.0 : 1.0);
    if (inside) return {all, all};
    if (outside) return {all, 0};
    const double share = at.spread > 0 ? 0.5 + (radius_ - at.mean) / at.spread : at.mean < radius_ ? 1 : 0;
    return {all, all * std::clamp(share, 0.0, 1.0)};
  }
  Cover sum;
  for (int k = 0; k < 2; ++k) {
    const Box half = at.wide ? Box{box.u0 + 0.5 * k * box.width, box.v0, 0.5 * box.width, box.height}
                             : Box{box.u0, box.v0 + 0.5 * k * box.height, box.width, 0.5 * box.height};
    const Cover part = cover(half, owned, depth + 1, budget);
    sum.all += part.all;
    sum.covered += part.covered;
  }
  return sum;
}

// The share of each texel of a face that the sun covers, and the texels' owned solid angles; [height][width].
struct FaceCover {
  Size size;
  std::vector<double> share, omega;
};

FaceCover cover_face(const Layout& layout, int face, Size size, Placement placement, const SunCover& sun) {
  const std::size_t count = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
  FaceCover out{size, std::vector<double>(count), std::vector<double>(count)};
  tbb::parallel_for(0, size.height, [&](int j) {
    const std::size_t row = static_cast<std::size_t>(j) * static_cast<std::size_t>(size.width);
    texel_solid_angles(layout, face, size, placement, 0, j, size.width, 1, &out.omega[row]);
    const double v0 = std::max(0.0, u_from_texel(j - 0.5, size.height, placement)),
                 v1 = std::min(1.0, u_from_texel(j + 0.5, size.height, placement));
    for (int i = 0; i < size.width; ++i) {
      const double u0 = std::max(0.0, u_from_texel(i - 0.5, size.width, placement)),
                   u1 = std::min(1.0, u_from_texel(i + 0.5, size.width, placement));
      const Box box{u0, v0, u1 - u0, v1 - v0};
      if (sun.misses(box)) continue;
      const std::size_t at = row + static_cast<std::size_t>(i);
      int budget = most_pieces;
      const SunCover::Cover cover = sun.cover(box, out.omega[at] > 0, 0, budget);
      out.share[at] = cover.all > 0 ? cover.covered / cover.all : 0;
    }
  });
  return out;
}

}  // namespace

void draw_sun(const PatternOptions& o, const Mat3& world_from_layout, EnvImage& image) {
  const Mat3 layout_from_pattern = transpose(world_from_layout) * rotation_matrix(o.rotation);
  const Vec3 centre = layout_from_pattern * (transpose(o.consumer_from_world) * normalize(o.direction));
  const double radius = 0.5 * o.diameter * std::numbers::pi / 180;
  std::vector<FaceCover> faces;
  for (int f = 0; f < o.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    faces.push_back(cover_face(*o.layout, f, {face.width(), face.height()}, image.placement,
                               SunCover(*o.layout, f, centre, radius)));
  }
  double whole = 0, partial = 0, sphere = 0;
  for (const FaceCover& face : faces)
    for (std::size_t k = 0; k < face.share.size(); ++k) {
      (face.share[k] >= 1 ? whole : partial) += face.share[k] * face.omega[k];
      sphere += face.omega[k];
    }
  const double half = std::sin(0.5 * radius), disc = sphere * half * half;  // sphere: 4 pi, to within what seams cost
  if (whole + partial <= 0) {  // it slipped through: all of it to the texel that owns its centre
    const Location at = o.layout->locate(centre);
    FaceCover& face = faces[static_cast<std::size_t>(at.face)];
    const auto index = [&](double place, int n) {
      return std::clamp(static_cast<int>(std::lround(texel_from_u(place, n, image.placement))), 0, n - 1);
    };
    const std::size_t k =
        static_cast<std::size_t>(index(at.v, face.size.height)) * static_cast<std::size_t>(face.size.width) +
        static_cast<std::size_t>(index(at.u, face.size.width));
    face.share[k] = 0.5;
    partial = 0.5 * face.omega[k];
  }
  const double factor = partial > 0 ? (disc - whole) / partial : 1;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    Image& face = image.faces[f];
    for (std::size_t k = 0; k < faces[f].share.size(); ++k) {
      const double share = faces[f].share[k], value = share >= 1 ? 1 : factor * share;
      for (std::size_t c = 0; c < 3; ++c) face.data()[3 * k + c] = static_cast<float>(value * o.value[c]);
    }
  }
}

}  // namespace envconv
