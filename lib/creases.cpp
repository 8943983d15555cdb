// SPDX-License-Identifier: Apache-2.0
#include "creases.h"

#include <algorithm>
#include <cmath>

#include "assertion.h"

namespace envconv {
namespace {

constexpr int reach = static_cast<int>(grid_reach);
constexpr int fine = 2, coarse = 8;                                     // texels from point to point
constexpr int most_points = (largest_tile + 2 * reach) / fine + 1 + 3;  // a side
constexpr int room = most_points * most_points + static_cast<int>(batch_padding);

// Directions at a lattice of points, `step` texels apart, over the tile, what a grid's weights reach and a point more.
class Lattice {
 public:
  Lattice(const EnvImage& out, const Tile& tile, int step) {
    const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    across_ = (tile.width + 2 * reach + step - 1) / step + 3, down_ = (tile.height + 2 * reach + step - 1) / step + 3;
    ENVCONV_ASSERT(across_ <= most_points && down_ <= most_points);
    const int n = across_ * down_, padded = (n + 15) / 16 * 16;
    const auto place = [&](int k) { return -0.5 - reach + (k - 1) * step; };  // from the tile's first texel
    for (int j = 0, at = 0; j < down_; ++j)
      for (int i = 0; i < across_; ++i, ++at) {
        u_[at] = static_cast<float>(u_from_texel(tile.x0 + place(i), face.width(), out.placement));
        v_[at] = static_cast<float>(u_from_texel(tile.y0 + place(j), face.height(), out.placement));
      }
    std::fill(u_ + n, u_ + padded, u_[0]), std::fill(v_ + n, v_ + padded, v_[0]);
    out.layout->directions(tile.face, static_cast<std::size_t>(padded), u_, v_, x_, y_, z_);
  }

  // Calls visit(i, j) at points about which derivatives jump along a row or a column: the change of the steps' length
  // and direction there is much larger than elsewhere in that line.
  template <class Visit>
  void for_each_jump(const Visit& visit) const {
    float change[most_points], sorted[most_points];
    const auto line = [&](int first, int stride, int n, const auto& report) {
      float longest = 0;
      for (int k = 1; k + 1 < n; ++k) {
        const int at = first + k * stride, before = at - stride, after = at + stride;
        const float ax = x_[at] - x_[before], ay = y_[at] - y_[before], az = z_[at] - z_[before];
        const float bx = x_[after] - x_[at], by = y_[after] - y_[at], bz = z_[after] - z_[at];
        const float cx = bx - ax, cy = by - ay, cz = bz - az;
        change[k] = std::sqrt(cx * cx + cy * cy + cz * cz);
        longest = std::max(longest, ax * ax + ay * ay + az * az);
      }
      std::copy(change + 1, change + n - 1, sorted);
      std::nth_element(sorted, sorted + (n - 2) / 2, sorted + n - 2);
      const float limit = 3 * sorted[(n - 2) / 2] + 0.05f * std::sqrt(longest);
      for (int k = 1; k + 1 < n; ++k)
        if (!(change[k] <= limit)) report(k);
    };
    for (int j = 1; j + 1 < down_; ++j) line(j * across_, 1, across_, [&](int k) { visit(k, j); });
    for (int i = 1; i + 1 < across_; ++i) line(i, across_, down_, [&](int k) { visit(i, k); });
  }

  bool any() const {
    bool found = false;
    for_each_jump([&](int, int) { found = true; });
    return found;
  }

 private:
  int across_ = 0, down_ = 0;
  alignas(64) float u_[room], v_[room], x_[room], y_[room], z_[room];
};

}  // namespace

TexelMask find_creases(const EnvImage& out, const Tile& tile) {
  TexelMask creased;
  if (!Lattice(out, tile, std::min(coarse, std::max(fine, tile.width / 4))).any()) return creased;
  Lattice(out, tile, fine).for_each_jump([&](int i, int j) {
    // The crease passes within a step of the point.
    const int x = (i - 1) * fine - reach, y = (j - 1) * fine - reach, around = fine + reach;
    creased.add(x - around, y - around, x + around, y + around, tile);
  });
  return creased;
}

}  // namespace envconv
