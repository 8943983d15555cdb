// SPDX-License-Identifier: Apache-2.0
// Bilinear reads of single faces: what hardware without seamless filtering shows, and what texels beyond a seam are
// filled with.  Internal: not installed.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "assertion.h"
#include "image.h"

namespace envconv {

/// The four texels around a point of a face, clamped at the face's edges, and their weights, which add up to 1.
struct BilinearTaps {
  int x[2], y[2];
  double wx[2], wy[2];

  /// x, y in texels, centres at whole numbers.
  BilinearTaps(double px, double py, int width, int height) {
    px = std::clamp(px, 0.0, width - 1.0);
    py = std::clamp(py, 0.0, height - 1.0);
    x[0] = std::min(static_cast<int>(px), width - 1), y[0] = std::min(static_cast<int>(py), height - 1);
    x[1] = std::min(x[0] + 1, width - 1), y[1] = std::min(y[0] + 1, height - 1);
    wx[1] = px - x[0], wy[1] = py - y[0];
    wx[0] = 1 - wx[1], wy[0] = 1 - wy[1];
  }
};

/// out[c] = the reconstruction of all channels at texel coordinates (x, y).  A weight of 0 hides whatever stands there.
inline void read_clamped(const Image& face, double x, double y, double* out) {
  const BilinearTaps taps(x, y, face.width(), face.height());
  std::fill_n(out, face.channels(), 0.0);
  for (int b = 0; b < 2; ++b)
    for (int a = 0; a < 2; ++a) {
      const double weight = taps.wx[a] * taps.wy[b];
      if (weight == 0) continue;
      const float* texel = face.at(taps.x[a], taps.y[b]);
      for (int c = 0; c < face.channels(); ++c) out[c] += weight * static_cast<double>(texel[c]);
    }
}

/// The same at a face point of an environment.
inline void read_clamped(const EnvImage& image, const Location& at, double* out) {
  const Image& face = image.faces[static_cast<std::size_t>(at.face)];
  read_clamped(face, texel_from_u(at.u, face.width(), image.placement),
               texel_from_u(at.v, face.height(), image.placement), out);
}

/// Taking only texels whose solid angle is not 0, of the four or, when none of them has one, the nearest ring that has
/// one.  omega: the face's, [height][width].
inline void read_owned(const Image& face, std::span<const double> omega, double x, double y, double* out) {
  const int w = face.width(), h = face.height();
  const BilinearTaps taps(x, y, w, h);
  double total = 0;
  std::fill_n(out, face.channels(), 0.0);
  const auto add = [&](int i, int j, double weight) {
    if (!(weight > 0) ||
        !(omega[static_cast<std::size_t>(j) * static_cast<std::size_t>(w) + static_cast<std::size_t>(i)] > 0))
      return;
    const float* texel = face.at(i, j);
    for (int c = 0; c < face.channels(); ++c) out[c] += weight * static_cast<double>(texel[c]);
    total += weight;
  };
  for (int b = 0; b < 2; ++b)
    for (int a = 0; a < 2; ++a) add(taps.x[a], taps.y[b], taps.wx[a] * taps.wy[b]);
  for (int r = 1; !(total > 1e-9) && r < std::max(w, h); ++r) {
    std::fill_n(out, face.channels(), 0.0);
    total = 0;
    for (int j = std::max(taps.y[0] - r, 0); j <= std::min(taps.y[0] + r, h - 1); ++j)
      for (int i = std::max(taps.x[0] - r, 0); i <= std::min(taps.x[0] + r, w - 1); ++i)
        add(i, j, 1 / (0.1 + (i - x) * (i - x) + (j - y) * (j - y)));
  }
  for (int c = 0; c < face.channels(); ++c) out[c] = total > 0 ? out[c] / total : 0;
}

}  // namespace envconv
