// SPDX-License-Identifier: Apache-2.0
// The area of a texel at a disc's rim.  There the sphere is stretched outwards without bound (as the root of the
// distance from the rim), and hardly along the rim: nodes on a grid of rows and columns would be many where they stand
// askew.
#pragma once

#include <utility>

namespace envconv {

/// A square of side 1, cut off at a circle about the disc's middle, by chords at right angles to the way outwards.
/// Pieces lie between the distances at which the chords' length has a kink.
class RimTexel {
 public:
  static constexpr int most_pieces = 3;
  /// x, y: its centre, from the disc's middle, and the radius, in texels.
  RimTexel(double x, double y, double radius);

  int pieces() const { return pieces_; }  ///< none: nothing of it is inside
  /// Distance outwards from the centre at which piece i begins, and piece i - 1 ends.
  double bound(int i) const { return bound_[i]; }
  /// From the centre: so far outwards, and aside.
  std::pair<double, double> place(double outwards, double aside) const {
    return {outwards * x_ - aside * y_, outwards * y_ + aside * x_};
  }
  struct Chord {
    double begin, end;  ///< aside; none where not begin < end
  };
  Chord chord(double outwards) const;
  struct Node {
    double outwards, weight;
  };
  /// t, weight: of a quadrature on [-1/2, 1/2].  Its nodes lie in equal measure of the root of the distance from the
  /// rim, so that what is smooth on the sphere is smooth for it.
  Node node(int piece, double t, double weight) const;

 private:
  double x_, y_;  // unit vector outwards
  double rim_;    // outwards from the centre; of the circle's mean over the texel
  int pieces_ = 0;
  double bound_[most_pieces + 1];
};

}  // namespace envconv
