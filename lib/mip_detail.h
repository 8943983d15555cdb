// SPDX-License-Identifier: Apache-2.0
// What a filter wider than the texel adds to the box means of MIP levels.  Internal: not installed.
#pragma once

#include <vector>

#include "image.h"
#include "mip.h"

namespace envconv {

/// Adds to a level's box means the difference between the filter and the box, both applied to limited radiance of level
/// 0, or, three levels and more up, of the exact means of the level three below: its texels are then an eighth of the
/// level's, fine enough to sample any of the kernels.
class MipDetail {
 public:
  /// levels: from 1 on, box means, altered by add_to(), the coarsest first; omega: their owned solid angles,
  /// [level - 1][face][texel].  All must outlive this.
  MipDetail(const EnvImage& level0, std::vector<EnvImage>& levels,
            const std::vector<std::vector<std::vector<double>>>& omega, const MipFilter& filter);
  void add_to(int level);

 private:
  struct Grown;   // a face with an apron
  struct Kernel;  // weights along one axis
  const EnvImage& level(int k) const { return k == 0 ? level0_ : levels_[static_cast<std::size_t>(k - 1)]; }
  void read(int k, const Location& at, double* value) const;
  double kernel_at(double t) const;
  float limit_factor(const float* texel) const;
  Grown grow(int k, int face, int apron_x, int apron_y) const;
  void add_to_face(int to, int from, int face);
  void add_on_sphere(int to, int from);
  void finish(int k);
  void add_difference(EnvImage& image, int face, int i, int j, const double* wide, double wide_weight,
                      const double* box, double box_weight) const;

  const EnvImage& level0_;
  std::vector<EnvImage>& levels_;
  const std::vector<std::vector<std::vector<double>>>& omega_;
  const MipFilter& filter_;
  // Of level 0, where seams or rims cross faces: 1 where a texel's centre is owned.  What stands in the others need not
  // be true.
  std::vector<std::vector<double>> owned_;
  std::vector<double> mean_;   // of level 0, by channel
  std::vector<float> lowest_;  // value of level 0 by channel
  double limit_ = 0;           // of brightness
  std::vector<double> table_;  // of the kernel, for t >= 0
};

}  // namespace envconv
