// SPDX-License-Identifier: Apache-2.0
#include "rim_texel.h"

#include <algorithm>
#include <cmath>

namespace envconv {
namespace {

constexpr double shortest = 1e-9;  // texels; of a piece

}  // namespace

RimTexel::RimTexel(double x, double y, double radius) {
  const double distance = std::hypot(x, y);
  x_ = distance > 0 ? x / distance : 1, y_ = distance > 0 ? y / distance : 0;
  const double most = 0.5 * (std::abs(x_) + std::abs(y_)), inner = 0.5 * std::abs(std::abs(x_) - std::abs(y_));
  rim_ = radius - distance;
  // A chord there bends away from the circle by so much, on average.
  if (rim_ < most) {
    const Chord last = chord(rim_);
    if (last.begin < last.end) rim_ -= (last.end - last.begin) * (last.end - last.begin) / (24 * radius);
  }
  bound_[0] = -most;
  for (const double end : {-inner, inner, most}) {
    const double until = std::min(end, rim_);
    if (until - bound_[pieces_] > shortest) bound_[++pieces_] = until;
  }
}

RimTexel::Chord RimTexel::chord(double outwards) const {
  Chord chord{-1, 1};
  const auto bounded = [&](double at, double step) {  // |at + aside * step| <= 1/2
    if (std::abs(step) < 1e-12) return;
    const double middle = -at / step, half = 0.5 / std::abs(step);
    chord.begin = std::max(chord.begin, middle - half), chord.end = std::min(chord.end, middle + half);
  };
  bounded(outwards * x_, -y_), bounded(outwards * y_, x_);
  return chord;
}

RimTexel::Node RimTexel::node(int piece, double t, double weight) const {
  const double far = std::sqrt(std::max(0.0, rim_ - bound_[piece]));
  const double near = std::sqrt(std::max(0.0, rim_ - bound_[piece + 1]));
  const double root = 0.5 * (far + near) + t * (far - near);
  return {rim_ - root * root, weight * (far - near) * 2 * root};
}

}  // namespace envconv
