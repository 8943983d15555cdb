// SPDX-License-Identifier: Apache-2.0
// Gutters: on, and off again.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <span>

#include "assertion.h"
#include "face_reader.h"
#include "seam.h"
#include "solid_angle.h"

namespace envconv {
namespace {

// One mark a texel of a face.
class Marks {
 public:
  explicit Marks(Size size)
      : size_(size), marks_(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height)) {}
  char& at(int x, int y) {
    return marks_[static_cast<std::size_t>(y) * static_cast<std::size_t>(size_.width) + static_cast<std::size_t>(x)];
  }

 private:
  Size size_;
  std::vector<char> marks_;
};

// A map but for its pixels.
struct Shape {
  const Layout& layout;
  Placement placement;
  std::vector<Size> sizes;  // of faces without gutters
};

// Marks the texels of a face near the curve where what it owns ends: next to it inside, as far as they may be cut, and
// so many beyond.
Marks near_curve(const Shape& shape, int f, int distance) {
  const int w = shape.sizes[static_cast<std::size_t>(f)].width, h = shape.sizes[static_cast<std::size_t>(f)].height;
  Marks inside({w, h}), near({w, h});
  tbb::parallel_for(0, h, [&](int y) {
    for (int x = 0; x < w; ++x)
      inside.at(x, y) = shape.layout.owns(f, u_from_texel(x, w, shape.placement), u_from_texel(y, h, shape.placement));
  });
  const auto each_around = [&](int x, int y, int reach, auto&& visit) {
    for (int j = std::max(0, y - reach); j <= std::min(h - 1, y + reach); ++j)
      for (int i = std::max(0, x - reach); i <= std::min(w - 1, x + reach); ++i) visit(i, j);
  };
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      if (!inside.at(x, y)) continue;
      // At the rectangle's own edge as well, which a curve may touch.
      bool last = x == 0 || y == 0 || x == w - 1 || y == h - 1;
      each_around(x, y, 1, [&](int i, int j) { last = last || !inside.at(i, j); });
      if (!last) continue;
      near.at(x, y) = 1;
      each_around(x, y, distance, [&](int i, int j) {
        if (!inside.at(i, j)) near.at(i, j) = 1;
      });
    }
  return near;
}

// A place on a face: texel coordinates with gutters.
struct Place {
  int face;
  double x, y;
};

// A texel that the face has only a part of, or none.
struct Cut {
  int face, x, y;
  double own;    // the part that the face has
  Place beyond;  // where the rest is read from
};

// What a face does not own of a texel: its middle, and its mean direction.
struct Rest {
  double u = 0, v = 0;
  Vec3 direction{0, 0, 0};
};

// Finds where to read what lies beyond a curve.  The middle of the rest of a texel is the right point as long as
// directions change evenly from texel to texel.  At the rim of a sphere map they do not, so that point is looked for
// where interpolation between texels gives the right mean direction.
class PlaceFinder {
 public:
  PlaceFinder(const Shape& shape, int gutter) : shape_(shape), gutter_(gutter) {}

  // None: the face owns all of the texel.
  std::optional<Place> find(int f, int x, int y) {
    const std::optional<Rest> rest = rest_of(f, x, y);
    if (!rest) return {};
    const Size size = size_of(f);
    const double du = texel_extent(size.width, shape_.placement), dv = texel_extent(size.height, shape_.placement);
    constexpr double smallest = 1.0 / 128, farthest = 2, better = 0.999;  // texels, but for the last
    double u = rest->u, v = rest->v, least = miss(place(f, u, v), rest->direction);
    for (double step = 0.25; step >= smallest; step /= 2)
      for (bool moved = true; moved;) {
        moved = false;
        for (const auto& [i, j] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const double nu = u + i * step * du, nv = v + j * step * dv;
          if (std::abs(nu - rest->u) > farthest * du || std::abs(nv - rest->v) > farthest * dv) continue;
          if (shape_.layout.owns(f, nu, nv)) continue;
          const double error = miss(place(f, nu, nv), rest->direction);
          if (error < better * least) least = error, u = nu, v = nv, moved = true;
        }
      }
    return place(f, u, v);
  }

 private:
  Size size_of(int f) const { return shape_.sizes[static_cast<std::size_t>(f)]; }

  // Calls visit(u, v) for points spread over a texel.
  template <class F>
  void each_point(int f, int x, int y, int a_side, F&& visit) const {
    const Size size = size_of(f);
    for (int j = 0; j < a_side; ++j)
      for (int i = 0; i < a_side; ++i)
        visit(u_from_texel(x - 0.5 + (i + 0.5) / a_side, size.width, shape_.placement),
              u_from_texel(y - 0.5 + (j + 0.5) / a_side, size.height, shape_.placement));
  }

  std::optional<Rest> rest_of(int f, int x, int y) const {
    Rest rest;
    int count = 0;
    each_point(f, x, y, 8, [&](double u, double v) {
      if (shape_.layout.owns(f, u, v)) return;
      rest.u += u, rest.v += v;
      rest.direction = rest.direction + shape_.layout.direction(f, u, v);
      ++count;
    });
    if (count == 0) return {};
    rest.u /= count, rest.v /= count;
    rest.direction = (1.0 / count) * rest.direction;
    return rest;
  }

  // Of a point beyond a face's curve, on the face that owns it.
  Place place(int f, double u, double v) const {
    const Location at = shape_.layout.locate(shape_.layout.direction(f, u, v));
    const Size size = size_of(at.face);
    return {at.face, texel_from_u(at.u, size.width, shape_.placement) + gutter_,
            texel_from_u(at.v, size.height, shape_.placement) + gutter_};
  }

  // How far the direction that is read at a place is from the one that is wanted, squared.
  double miss(const Place& at, Vec3 wanted) {
    const Size size = size_of(at.face);
    const BilinearTaps taps(at.x, at.y, size.width + 2 * gutter_, size.height + 2 * gutter_);
    Vec3 d{0, 0, 0};
    for (int b = 0; b < 2; ++b)
      for (int a = 0; a < 2; ++a)
        d = d + (taps.wx[a] * taps.wy[b]) * mean_direction(at.face, taps.x[a] - gutter_, taps.y[b] - gutter_);
    return dot(d - wanted, d - wanted);
  }

  Vec3 mean_direction(int f, int x, int y) {
    constexpr int a_side = 4;
    const auto [at, is_new] = known_.try_emplace({f, x, y});
    Vec3& mean = at->second;
    if (is_new) {
      each_point(f, x, y, a_side, [&](double u, double v) { mean = mean + shape_.layout.direction(f, u, v); });
      mean = (1.0 / (a_side * a_side)) * mean;
    }
    return mean;
  }

  const Shape& shape_;
  int gutter_;
  std::map<std::array<int, 3>, Vec3> known_;  // mean directions
};

// Those of one row; us, vs: the texels' bounds.
std::vector<Cut> cut_texels_of_row(const Shape& shape, int gutter, int f, int y, const char* near,
                                   std::span<const double> us, std::span<const double> vs) {
  std::vector<Cut> cuts;
  PlaceFinder finder(shape, gutter);
  const int w = shape.sizes[static_cast<std::size_t>(f)].width;
  std::vector<double> whole(static_cast<std::size_t>(w)), owned(static_cast<std::size_t>(w));
  for (int begin = 0, end; begin < w; begin = end) {
    for (end = begin + 1; end < w && near[end] == near[begin];) ++end;
    if (!near[begin]) continue;
    const auto u = us.subspan(static_cast<std::size_t>(begin), static_cast<std::size_t>(end - begin) + 1);
    const auto v = vs.subspan(static_cast<std::size_t>(y), 2);
    cell_solid_angles(shape.layout, f, u, v, false, whole.data());
    cell_solid_angles(shape.layout, f, u, v, true, owned.data());
    for (int x = begin; x < end; ++x) {
      const auto k = static_cast<std::size_t>(x - begin);
      const std::optional<Place> at = finder.find(f, x, y);
      if (at) cuts.push_back({f, x, y, whole[k] > 0 ? std::clamp(owned[k] / whole[k], 0.0, 1.0) : 0.0, *at});
    }
  }
  return cuts;
}

std::vector<Cut> cut_texels(const Shape& shape, int gutter) {
  std::vector<Cut> cuts;
  if (shape.layout.info().domain == Domain::square) return cuts;
  for (int f = 0; f < shape.layout.face_count(); ++f) {
    const auto [w, h] = shape.sizes[static_cast<std::size_t>(f)];
    const std::vector<double> us = texel_bounds(w, shape.placement), vs = texel_bounds(h, shape.placement);
    Marks near = near_curve(shape, f, gutter + 1);
    std::vector<std::vector<Cut>> rows(static_cast<std::size_t>(h));
    tbb::parallel_for(0, h, [&](int y) {
      rows[static_cast<std::size_t>(y)] = cut_texels_of_row(shape, gutter, f, y, &near.at(0, y), us, vs);
    });
    for (const std::vector<Cut>& row : rows) cuts.insert(cuts.end(), row.begin(), row.end());
  }
  return cuts;
}

// What lies beyond the curve in each of the texels: [cut][channel].
void read_beyond(const std::vector<Cut>& cuts, const std::vector<Image>& grown, std::vector<double>& values) {
  const auto channels = static_cast<std::size_t>(grown.front().channels());
  values.resize(cuts.size() * channels);
  for (std::size_t k = 0; k < cuts.size(); ++k)
    read_clamped(grown[static_cast<std::size_t>(cuts[k].beyond.face)], cuts[k].beyond.x, cuts[k].beyond.y,
                 &values[k * channels]);
}

// Where a face's edge is a curve inside its rectangle, the texels that it cuts, and gutters beyond it, become whole:
// the face's own radiance as far as it has a part of the texel, and the rest from beyond.  What that is read from lies
// between such texels itself, so it is done again until nothing changes; then it can be undone.
//
// Two sides agree then to within what lies between texels.  They do so least at the rim of sphere-map and mirror-ball,
// r = 1, which is one direction: what is at an angle e from it has 1 - r = e^2/8.  Of N texels across, the one whose
// centre the rim passes owns what is up to e = sqrt(8/N) away, 2/3 of that on average, and reconstruction shows there
// this texel and no other; its opposite does the same on the other side.  Left alone, the two sides would differ by
// radiance (4/3) sqrt(8/N) apart, 27 degrees for N = 64; made whole, each holds half of the other.  What is left still
// falls as the root of N only, as steps so long do inside the face, while steps of one texel fall as N.
void complete_cut_texels(const std::vector<Image>& faces, const std::vector<Cut>& cuts, int texels,
                         std::vector<Image>& grown) {
  constexpr int most_passes = 64;
  constexpr double enough = 0x1p-22;
  std::vector<double> beyond;
  bool changed = true;
  for (int pass = 0; changed && pass < most_passes; ++pass) {
    read_beyond(cuts, grown, beyond);
    changed = false;
    std::size_t at = 0;
    for (const Cut& cut : cuts) {
      const float* own = faces[static_cast<std::size_t>(cut.face)].at(cut.x, cut.y);
      Image& face = grown[static_cast<std::size_t>(cut.face)];
      float* to = face.at(cut.x + texels, cut.y + texels);
      for (int c = 0; c < face.channels(); ++c, ++at) {
        const double value = std::lerp(beyond[at], static_cast<double>(own[c]), cut.own);
        changed = changed || std::abs(value - static_cast<double>(to[c])) > enough * std::abs(value);
        to[c] = static_cast<float>(value);
      }
    }
  }
}

// The faces' own parts of cut texels again.
void take_own_parts(const std::vector<Cut>& cuts, const std::vector<Image>& grown, std::vector<Image>& faces) {
  // Of a part so small the difference may be no more than what was rounded.
  constexpr double small = 0x1p-10;
  std::vector<double> beyond;
  read_beyond(cuts, grown, beyond);
  std::size_t at = 0;
  for (const Cut& cut : cuts) {
    Image& face = faces[static_cast<std::size_t>(cut.face)];
    float* to = face.at(cut.x, cut.y);
    for (int c = 0; c < face.channels(); ++c, ++at) {
      const auto whole = static_cast<double>(to[c]);
      const double part = whole - (1 - cut.own) * beyond[at];
      if (!(cut.own > 0) || (cut.own < small && std::abs(part) < small * std::abs(whole))) continue;
      // Nothing falls below zero that was not.
      const double value = whole >= 0 && beyond[at] >= 0 ? std::max(part, 0.0) / cut.own : part / cut.own;
      if (std::isfinite(value)) to[c] = static_cast<float>(value);
    }
  }
}

std::vector<Size> sizes_of(const std::vector<Image>& faces, int gutter) {
  std::vector<Size> sizes;
  for (const Image& face : faces) sizes.push_back({face.width() - 2 * gutter, face.height() - 2 * gutter});
  return sizes;
}

}  // namespace

std::vector<Image> with_gutters(const EnvImage& image, int texels) {
  const Layout& layout = *image.layout;
  std::vector<Image> grown;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    const int w = face.width(), h = face.height(), channels = face.channels();
    Image& out = grown.emplace_back(face.sibling(w + 2 * texels, h + 2 * texels, channels));
    tbb::parallel_for(0, out.height(), [&](int y) {
      std::vector<double> value(static_cast<std::size_t>(channels));
      const int j = y - texels;
      const bool in_row = j >= 0 && j < h;
      if (in_row)
        std::memcpy(out.at(texels, y), face.row(j),
                    static_cast<std::size_t>(w) * static_cast<std::size_t>(channels) * sizeof(float));
      for (int x = 0; x < out.width(); ++x) {
        if (in_row && x == texels) x += w;
        if (x >= out.width()) break;
        const Vec3 d =
            layout.direction(f, u_from_texel(x - texels, w, image.placement), u_from_texel(j, h, image.placement));
        read_clamped(image, layout.locate(d), value.data());
        std::transform(value.begin(), value.end(), out.at(x, y), [](double v) { return static_cast<float>(v); });
      }
    });
  }
  if (texels > 0) {
    const Shape shape{layout, image.placement, sizes_of(image.faces, 0)};
    complete_cut_texels(image.faces, cut_texels(shape, texels), texels, grown);
  }
  return grown;
}

std::vector<Image> without_gutters(const Layout& layout, Placement placement, const std::vector<Image>& grown,
                                   int texels) {
  std::vector<Image> faces;
  for (const Image& face : grown) {
    ENVCONV_ASSERT(face.width() > 2 * texels && face.height() > 2 * texels);
    Image& out =
        faces.emplace_back(face.sibling(face.width() - 2 * texels, face.height() - 2 * texels, face.channels()));
    for (int y = 0; y < out.height(); ++y)
      std::memcpy(out.row(y), face.at(texels, y + texels),
                  static_cast<std::size_t>(out.width()) * static_cast<std::size_t>(out.channels()) * sizeof(float));
  }
  if (texels > 0) take_own_parts(cut_texels({layout, placement, sizes_of(faces, 0)}, texels), grown, faces);
  return faces;
}

}  // namespace envconv
