// SPDX-License-Identifier: Apache-2.0
#include "tile_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envconv {
namespace {

constexpr int nodes = 5;
static_assert(TilePlan::nodes_x == nodes && TilePlan::nodes_y == nodes);

// Lagrange's polynomials through -2, -1, 0, 1, 2: [node][power].
constexpr double lagrange[nodes][nodes] = {{0, 2.0 / 24, -1.0 / 24, -2.0 / 24, 1.0 / 24},
                                           {0, -4.0 / 6, 4.0 / 6, 1.0 / 6, -1.0 / 6},
                                           {1, 0, -5.0 / 4, 0, 1.0 / 4},
                                           {0, 4.0 / 6, 4.0 / 6, -1.0 / 6, -1.0 / 6},
                                           {0, -2.0 / 24, -1.0 / 24, 2.0 / 24, 1.0 / 24}};

constexpr double tolerance = 2e-4;  // texels of the source

// How far curves through the nodes may bulge between them, in both directions: from second differences.
double bulge(const double (&node)[nodes][nodes]) {
  double most = 0;
  for (int j = 0; j < nodes; ++j)
    for (int i = 1; i + 1 < nodes; ++i) {
      most = std::max(most, std::abs(node[j][i - 1] - 2 * node[j][i] + node[j][i + 1]));
      most = std::max(most, std::abs(node[i - 1][j] - 2 * node[i][j] + node[i + 1][j]));
    }
  return most;
}

}  // namespace

TilePolynomial::TilePolynomial(const double (&node)[nodes][nodes]) {
  double rows[nodes][nodes] = {};  // [node along y][power of s]
  for (int j = 0; j < nodes; ++j)
    for (int i = 0; i < nodes; ++i)
      for (int m = 0; m < nodes; ++m) rows[j][m] += lagrange[i][m] * node[j][i];
  for (int j = 0; j < nodes; ++j)
    for (int k = 0; k < nodes; ++k)
      for (int m = 0; m < nodes; ++m) c_[k][m] += lagrange[j][k] * rows[j][m];
}

void TilePolynomial::row(double t, float (&out)[5]) const {
  for (int m = 0; m < nodes; ++m)
    out[m] = static_cast<float>((((c_[4][m] * t + c_[3][m]) * t + c_[2][m]) * t + c_[1][m]) * t + c_[0][m]);
}

double TilePolynomial::at(double s, double t) const {
  double sum = 0;
  for (int k = nodes; k-- > 0;)
    sum = sum * t + ((((c_[k][4] * s + c_[k][3]) * s + c_[k][2]) * s + c_[k][1]) * s + c_[k][0]);
  return sum;
}

std::optional<TileMap> TileMap::find(const Source& source, const EnvImage& out, const Mat3& source_from_out,
                                     const Tile& tile, const TilePlan& plan, double reach) {
  if (plan.view.face < 0 || !plan.inside) return std::nullopt;
  TileMap map;
  map.face_ = plan.view.face;
  const SourceFace& face = source.faces()[static_cast<std::size_t>(map.face_)];
  // In padded texels; false in another face.
  const auto place = [&](const Vec3& d, double& x, double& y) {
    const Location at = source.layout().locate(d);
    x = texel_from_u(at.u, face.size.width, source.placement()) + source.apron();
    y = texel_from_u(at.v, face.size.height, source.placement()) + source.apron();
    return at.face == map.face_ && std::isfinite(x) && std::isfinite(y);
  };
  double x[nodes][nodes], y[nodes][nodes];
  for (int j = 0; j < nodes; ++j)
    for (int i = 0; i < nodes; ++i)
      if (!place(plan.to[j][i], x[j][i], y[j][i])) return std::nullopt;
  map.x_ = static_cast<int>(std::lround(x[2][2])), map.y_ = static_cast<int>(std::lround(y[2][2]));
  // The curves between are inside of the face too.
  const double around = 1 + std::max(bulge(x), bulge(y));
  const auto edge = [&](int size, int from, float& low, float& high) {
    low = static_cast<float>(texel_from_u(0, size, source.placement()) + source.apron() - from);
    high = static_cast<float>(texel_from_u(1, size, source.placement()) + source.apron() - from);
  };
  edge(face.size.width, map.x_, map.left_, map.right_), edge(face.size.height, map.y_, map.top_, map.bottom_);
  const auto inside = [&](double px, double py) {
    return px - around > static_cast<double>(map.left_) && px + around < static_cast<double>(map.right_) &&
           py - around > static_cast<double>(map.top_) && py + around < static_cast<double>(map.bottom_);
  };
  for (int j = 0; j < nodes; ++j)
    for (int i = 0; i < nodes; ++i) {
      x[j][i] -= map.x_, y[j][i] -= map.y_;
      if (!inside(x[j][i], y[j][i])) return std::nullopt;
    }
  map.to_x_ = TilePolynomial(x), map.to_y_ = TilePolynomial(y);
  // Tried at the corners and sides of what is reached, where it is worst, and near the corners inside.
  const Image& pixels = out.faces[static_cast<std::size_t>(tile.face)];
  const double wide = tile_variable(tile.width + reach, tile.width);
  const double high = tile_variable(tile.height + reach, tile.height);
  constexpr std::pair<double, double> tried[] = {{-1, -1},       {1, -1},       {-1, 1},       {1, 1},
                                                 {-0.75, -0.75}, {0.75, -0.75}, {-0.75, 0.75}, {0.75, 0.75},
                                                 {-0.25, -1},    {0.25, 1},     {-1, 0.25},    {1, -0.25}};
  for (const auto& [a, b] : tried) {
    const double s = a * wide, t = b * high;
    const double u = u_from_texel(tile.x0 - 0.5 + 0.25 * (s + 2) * tile.width, pixels.width(), out.placement);
    const double v = u_from_texel(tile.y0 - 0.5 + 0.25 * (t + 2) * tile.height, pixels.height(), out.placement);
    double px, py;
    if (!place(source_from_out * out.layout->direction(tile.face, u, v), px, py)) return std::nullopt;
    px -= map.x_, py -= map.y_;
    if (!inside(px, py) || !(std::abs(map.to_x_.at(s, t) - px) <= tolerance) ||
        !(std::abs(map.to_y_.at(s, t) - py) <= tolerance))
      return std::nullopt;
  }
  return map;
}

RowMap TileMap::row(double t) const {
  RowMap row{x_, y_, left_, right_, top_, bottom_, {}, {}};
  to_x_.row(t, row.to_x), to_y_.row(t, row.to_y);
  return row;
}

}  // namespace envconv
