// SPDX-License-Identifier: Apache-2.0
// Analytic panoramas, and the quality of pictures that were made from them.
//
// Three signals are painted into a source, point by point at its texels' centres:
//   R  plane waves cos(k.d + p) with |k| up to the target's Nyquist limit,
//   G  the same up to half of it,
//   B  zone plates about the six axes, whose frequency grows from 0 to a share of the source's Nyquist limit.
// The truth for an output texel is the signal's mean over the texel's footprint, by Gauss-Legendre quadrature weighted
// with solid angle, in triangles between which a layout may have a crease.  PSNR is 10 log10(1 / mean squared error),
// the mean taken over the sphere.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "envconv.h"
#include "quadrature.h"

namespace envconv::bench {

using Rgb = std::array<double, 3>;

/// Highest angular frequency, in radians per radian, that a layout holds everywhere: two texels of the widest kind a
/// wave.
inline double nyquist(const Layout& layout, int height) {
  const double requirement = figures(layout).sampling_requirement;
  const double texels = static_cast<double>(texel_count(layout, height));
  return std::isfinite(requirement) ? M_PI * std::sqrt(texels / requirement) : M_PI * std::sqrt(texels / (4 * M_PI));
}

/// The height of face 0, a multiple of 4 as sizes mostly are, at which a layout has about so many texels.
inline int height_of(const Layout& layout, double texels) {
  constexpr int large = 4096;
  const double quarters = large / 4 * std::sqrt(texels / static_cast<double>(texel_count(layout, large)));
  return 4 * std::max(1, static_cast<int>(std::lround(quarters)));
}

class Signal {
 public:
  /// target_nyquist: of R's waves; highest: of the zone plates, at the corners of a cube's faces.
  Signal(double target_nyquist, double highest, unsigned seed = 20260921)
      : chirp_(highest / (2 * std::acos(1 / std::sqrt(3.0)))) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0, 1);
    for (const double limit : {target_nyquist, 0.5 * target_nyquist})
      for (int i = 0; i < 24; ++i) {
        const Vec3 d = normalize({normal(random), normal(random), normal(random)});
        waves_[limit < target_nyquist].push_back(
            {(limit * (0.3 + 0.7 * uniform(random))) * d, 0.03, 2 * M_PI * uniform(random)});
      }
  }
  Rgb operator()(Vec3 d) const {
    Rgb rgb;
    for (std::size_t c = 0; c < 2; ++c) {
      rgb[c] = 0.5;
      for (const Wave& w : waves_[c]) rgb[c] += w.amplitude * std::cos(dot(w.k, d) + w.phase);
    }
    const double angle = std::acos(std::min(1.0, std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)})));
    rgb[2] = 0.5 + 0.5 * std::cos(chirp_ * angle * angle);
    return rgb;
  }

 private:
  struct Wave {
    Vec3 k;
    double amplitude, phase;
  };
  std::vector<Wave> waves_[2];
  double chirp_;  // the zone plates' phase is chirp * angle^2
};

/// A picture of value(d), which several threads call.
template <class Value>
EnvImage paint(const Layout& layout, int height, const Value& value) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = Channels::standard(3);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    Image face(size.width, size.height, 3);
    tbb::parallel_for(0, size.height, [&](int y) {
      for (int x = 0; x < size.width; ++x) {
        const Rgb rgb = value(layout.direction(f, u_from_texel(x, size.width, image.placement),
                                               u_from_texel(y, size.height, image.placement)));
        for (std::size_t c = 0; c < 3; ++c) face.at(x, y)[c] = static_cast<float>(rgb[c]);
      }
    });
    image.faces.push_back(std::move(face));
  }
  return image;
}

/// A point of a texel, from its centre in texels, and the share of the area that it stands for.
struct FootprintNode {
  double x, y, weight;
};

/// n x n Gauss-Legendre nodes in each of the triangles into which its diagonals part a texel: octahedra and isocubes
/// bend along them.
inline std::vector<FootprintNode> footprint_nodes(int n) {
  const Quadrature q = box_quadrature(n);
  std::vector<FootprintNode> nodes;
  for (std::size_t j = 0; j < q.offset.size(); ++j)
    for (std::size_t i = 0; i < q.offset.size(); ++i) {
      const double out = q.offset[j] + 0.5, far = 0.5 * out, aside = out * q.offset[i];
      const double weight = 0.5 * out * q.weight[i] * q.weight[j];
      nodes.push_back({far, aside, weight}), nodes.push_back({-far, aside, weight});
      nodes.push_back({aside, far, weight}), nodes.push_back({aside, -far, weight});
    }
  return nodes;
}

/// The mean of value(d) over a texel's footprint.
template <class Value>
Rgb footprint_mean(const Layout& layout, int face, int x, int y, Size size, Placement placement,
                   std::span<const FootprintNode> nodes, const Value& value, double* solid_angle = nullptr) {
  Rgb sum{};
  double weight = 0;
  for (const FootprintNode& node : nodes) {
    const DirectionJet jet = layout.direction_jet(face, u_from_texel(x + node.x, size.width, placement),
                                                  u_from_texel(y + node.y, size.height, placement));
    const double w = node.weight * length(cross(jet.du, jet.dv));
    const Rgb rgb = value(jet.d);
    for (std::size_t c = 0; c < 3; ++c) sum[c] += w * rgb[c];
    weight += w;
  }
  for (double& v : sum) v /= weight;
  if (solid_angle) *solid_angle = weight;
  return sum;
}

/// A picture's texel, from a picture or anything else; called from several threads.
using Estimate = std::function<Rgb(int face, int x, int y)>;
inline Estimate estimate_of(const EnvImage& image) {
  return [&](int face, int x, int y) {
    const float* p = image.faces[static_cast<std::size_t>(face)].at(x, y);
    return Rgb{p[0], p[1], p[2]};
  };
}

/// True for directions within `texels` of a face's edge, a seam or a pole of a picture: where a step of so many to any
/// side leads to another face, or out of the face.
inline bool near_seam(const Layout& layout, int height, Vec3 d, double texels) {
  const Location at = layout.locate(d);
  const Size size = face_size(layout, at.face, height);
  const double du = texels / size.width, dv = texels / size.height;
  for (const double a : {-1.0, 0.0, 1.0})
    for (const double b : {-1.0, 0.0, 1.0}) {
      const double u = at.u + a * du, v = at.v + b * dv;
      if (u < 0 || u > 1 || v < 0 || v > 1 || !layout.owns(at.face, u, v)) return true;
    }
  return false;
}

/// Which texels are judged, by their directions.
using Chosen = std::function<bool(Vec3)>;

/// PSNR in dB of each estimate of a picture with these faces: of its owned texels all of whose footprint has
/// directions of its own, evenly strewn so that there are about `most` of them, chosen or not.
inline std::vector<Rgb> quality(const Layout& layout, int height, const Signal& signal,
                                std::span<const Estimate> estimates, double most = 3e4, const Chosen& chosen = {}) {
  const Placement placement = layout.info().placement;
  const std::vector<FootprintNode> nodes = footprint_nodes(6);
  const int step =
      std::max(1, static_cast<int>(std::lround(std::sqrt(static_cast<double>(texel_count(layout, height)) / most))));
  std::vector<Rgb> error(estimates.size());
  double total = 0;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    struct Row {
      std::vector<Rgb> error;
      double weight = 0;
    };
    std::vector<Row> rows(static_cast<std::size_t>(size.height));
    const auto counts = [&](int x, int y) {
      const auto owns = [&](double dx, double dy) {
        return layout.owns(f, u_from_texel(x + dx, size.width, placement),
                           u_from_texel(y + dy, size.height, placement));
      };
      if (layout.info().domain != Domain::disc) return owns(0, 0);
      return owns(-0.5, -0.5) && owns(0.5, -0.5) && owns(-0.5, 0.5) && owns(0.5, 0.5);
    };
    tbb::parallel_for(0, size.height, [&](int y) {
      if (y % step) return;
      Row& row = rows[static_cast<std::size_t>(y)];
      row.error.resize(estimates.size());
      for (int x = (y / step) % step; x < size.width; x += step) {
        if (!counts(x, y)) continue;
        if (chosen && !chosen(layout.direction(f, u_from_texel(x, size.width, placement),
                                               u_from_texel(y, size.height, placement))))
          continue;
        double weight;
        const Rgb truth = footprint_mean(layout, f, x, y, size, placement, nodes, signal, &weight);
        for (std::size_t k = 0; k < estimates.size(); ++k) {
          const Rgb value = estimates[k](f, x, y);
          for (std::size_t c = 0; c < 3; ++c) row.error[k][c] += weight * (value[c] - truth[c]) * (value[c] - truth[c]);
        }
        row.weight += weight;
      }
    });
    for (const Row& row : rows) {
      if (row.error.empty()) continue;
      for (std::size_t k = 0; k < error.size(); ++k)
        for (std::size_t c = 0; c < 3; ++c) error[k][c] += row.error[k][c];
      total += row.weight;
    }
  }
  for (Rgb& e : error)
    for (double& v : e) v = 10 * std::log10(total / v);
  return error;
}

/// Seconds of the wall's clock and of the processor's that f() takes.
struct Seconds {
  double wall, cpu;
};
template <class F>
Seconds timed(const F& f) {
  const auto now = [](clockid_t clock) {
    timespec t{};
    clock_gettime(clock, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  };
  const double wall = now(CLOCK_MONOTONIC), cpu = now(CLOCK_PROCESS_CPUTIME_ID);
  f();
  return {now(CLOCK_MONOTONIC) - wall, now(CLOCK_PROCESS_CPUTIME_ID) - cpu};
}

inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

}  // namespace envconv::bench
