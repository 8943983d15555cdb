// SPDX-License-Identifier: Apache-2.0
#include "creases.h"

#include <algorithm>
#include <cmath>

#include "assertion.h"

namespace envconv {
namespace {

constexpr int reach = static_cast<int>(grid_reach);
constexpr int fine = 2, coarse = 8;  // texels from point to point
constexpr int beyond = 5;            // points before and after that a jump is judged by
constexpr int most_points = (largest_tile + 2 * reach) / fine + 1 + 2 * beyond;  // a side
constexpr int room = most_points * most_points + static_cast<int>(batch_padding);

// Directions at a lattice of points, `step` texels apart, over the tile, what a grid's weights reach and some points
// more.
class Lattice {
 public:
  Lattice(const EnvImage& out, const Tile& tile, int step) {
    const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const auto points = [&](int texels) { return (texels + 2 * reach + step - 1) / step + 1 + 2 * beyond; };
    across_ = points(tile.width), down_ = points(tile.height);
    ENVCONV_ASSERT(across_ <= most_points && down_ <= most_points);
    const int n = across_ * down_, padded = (n + 15) / 16 * 16;
    const auto place = [&](int k) { return -0.5 - reach + (k - beyond) * step; };  // from the tile's first texel
    for (int j = 0, at = 0; j < down_; ++j)
      for (int i = 0; i < across_; ++i, ++at) {
        u_[at] = static_cast<float>(u_from_texel(tile.x0 + place(i), face.width(), out.placement));
        v_[at] = static_cast<float>(u_from_texel(tile.y0 + place(j), face.height(), out.placement));
      }
    std::fill(u_ + n, u_ + padded, u_[0]), std::fill(v_ + n, v_ + padded, v_[0]);
    out.layout->directions(tile.face, static_cast<std::size_t>(padded), u_, v_, x_, y_, z_);
  }

  // Calls visit(i, j) at points about which derivatives jump along a row or a column: the step from point to point
  // changes there by something that it does not change by two points before and after.  What smooth maps change by
  // cancels to fourth order.
  template <class Visit>
  void for_each_jump(const Visit& visit) const {
    constexpr float share = 0.01f;     // of a step
    constexpr float rounding = 1e-6f;  // of directions, so often added up
    float cx[most_points], cy[most_points], cz[most_points], jump[most_points];
    const auto line = [&](int first, int stride, int n, const auto& report) {
      float longest = 0;
      for (int k = 1; k + 1 < n; ++k) {
        const int at = first + k * stride, before = at - stride, after = at + stride;
        const float ax = x_[at] - x_[before], ay = y_[at] - y_[before], az = z_[at] - z_[before];
        cx[k] = x_[after] - x_[at] - ax, cy[k] = y_[after] - y_[at] - ay, cz[k] = z_[after] - z_[at] - az;
        longest = std::max(longest, ax * ax + ay * ay + az * az);
      }
      for (int k = 3; k + 3 < n; ++k) {
        const float x = cx[k] - 0.5f * (cx[k - 2] + cx[k + 2]), y = cy[k] - 0.5f * (cy[k - 2] + cy[k + 2]),
                    z = cz[k] - 0.5f * (cz[k - 2] + cz[k + 2]);
        jump[k] = std::sqrt(x * x + y * y + z * z);
      }
      const float limit = share * std::sqrt(longest) + rounding;
      // Half of a jump is also seen two points from it.
      for (int k = beyond; k + beyond < n; ++k)
        if (!(jump[k] <= std::max(limit, 0.6f * std::max(jump[k - 2], jump[k + 2])))) report(k);
    };
    for (int j = beyond; j + beyond < down_; ++j) line(j * across_, 1, across_, [&](int k) { visit(k, j); });
    for (int i = beyond; i + beyond < across_; ++i) line(i, across_, down_, [&](int k) { visit(i, k); });
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

Creases find_creases(const EnvImage& out, const Tile& tile) {
  Creases creases;
  if (!Lattice(out, tile, std::min(coarse, std::max(fine, tile.width / 4))).any()) return creases;
  Lattice(out, tile, fine).for_each_jump([&](int i, int j) {
    // The crease passes within half a step of the point, or between it and the next one, which is visited too.
    const int x = (i - beyond) * fine - reach, y = (j - beyond) * fine - reach;
    const auto add = [&](int around, TexelMask& mask) {
      mask.add(x - around, y - around, x + around, y + around, tile);
    };
    add(fine / 2, creases.across), add(fine + reach, creases.near);
  });
  return creases;
}

}  // namespace envconv
