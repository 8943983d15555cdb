// SPDX-License-Identifier: Apache-2.0
#include "map_reader.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "sum_kernels.h"

namespace envconv {
namespace {

static_assert(PointSquare::side * PointSquare::side == PointBatch::most);

void to_floats(const Mat3& m, float* out) {
  for (std::size_t i = 0; i < 9; ++i) out[i] = static_cast<float>(m.m[i]);
}

std::size_t padded(int n) { return (static_cast<std::size_t>(n) + batch_padding - 1) / batch_padding * batch_padding; }

constexpr int run = 64;  // points that are summed at a time

struct ReadBuffers {
  Windows windows;
  PointBatch local;  // in the layout's axes
  alignas(64) float face[PointBatch::most + batch_padding], u[PointBatch::most + batch_padding],
      v[PointBatch::most + batch_padding];
  alignas(64) float ones[run + batch_padding];
  ReadBuffers() { std::ranges::fill(ones, 1.0f); }
};

ReadBuffers& buffers() {
  thread_local std::unique_ptr<ReadBuffers> b;
  if (!b) b = std::make_unique<ReadBuffers>();
  return *b;
}

// The buffers of this thread, with the places of the points: face, u, v.
ReadBuffers& located(const Layout& layout, const float layout_from_world[9], const PointBatch& points) {
  ReadBuffers& b = buffers();
  const std::size_t n = padded(points.count);
  const auto count = static_cast<std::size_t>(points.count);
  const auto copy = [&](const float* from, float* to) {
    std::copy_n(from, count, to);
    std::fill(to + count, to + n, from[0]);
  };
  copy(points.x, b.local.x), copy(points.y, b.local.y), copy(points.z, b.local.z);
  rotate_directions(layout_from_world, n, b.local.x, b.local.y, b.local.z);
  layout.locations(n, b.local.x, b.local.y, b.local.z, b.face, b.u, b.v);
  return b;
}

}  // namespace

MapReader::MapReader(const EnvImage& image) : layout_(image.layout), channels_(image.channels.count()) {
  to_floats(layout_from_world(image), layout_from_world_);
  for (int first = 0; first < channels_; first += 4)
    groups_.emplace_back(image, nullptr, first, *find_filter("bilinear"));
}

void MapReader::read(const PointBatch& points, float* out) const {
  ReadBuffers& b = located(*layout_, layout_from_world_, points);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const int channels = std::min(4, channels_ - 4 * static_cast<int>(g));
    for (int first = 0; first < points.count; first += run) {
      const int n = std::min(run, points.count - first);
      make_windows(groups_[g].maps(), Kernel::bilinear, n, b.face + first, b.u + first, b.v + first, b.ones, b.windows);
      groups_[g].point(Kernel::bilinear, n, b.face + first, b.windows);
      float values[run * 4];
      sum_windows(Kernel::bilinear, groups_[g].channels(), n, b.windows, b.ones, values);
      for (int i = 0; i < n; ++i)
        std::copy_n(values + 4 * i, channels,
                    out + static_cast<std::size_t>(first + i) * static_cast<std::size_t>(channels_) + 4 * g);
    }
  }
}

void lay_points(const PointSquare& square, PointBatch& points) {
  // Angles without a simple ratio to a turn or to each other.
  static const Mat3 turn = rotation_matrix({.yaw = 33.7213, .pitch = 21.2917, .roll = 47.1373});
  static const Layout* healpix = find_layout("healpix");
  float matrix[9];
  to_floats(turn, matrix);
  alignas(64) float u[PointBatch::most], v[PointBatch::most];
  for (int j = 0, n = 0; j < PointSquare::side; ++j)
    for (int i = 0; i < PointSquare::side; ++i, ++n) {
      u[n] = static_cast<float>((square.x + i + 0.5) / square.grid);
      v[n] = static_cast<float>((square.y + j + 0.5) / square.grid);
    }
  points.count = PointBatch::most;
  healpix->directions(square.face, PointBatch::most, u, v, points.x, points.y, points.z);
  rotate_directions(matrix, PointBatch::most, points.x, points.y, points.z);
}

std::vector<PointSquare> point_squares(int grid) {
  ENVCONV_ASSERT(grid > 0 && grid % PointSquare::side == 0);
  std::vector<PointSquare> squares;
  for (int face = 0; face < 12; ++face)
    for (int y = 0; y < grid; y += PointSquare::side)
      for (int x = 0; x < grid; x += PointSquare::side) squares.push_back({face, grid, x, y});
  return squares;
}

void nearest_texels(const EnvImage& image, const PointBatch& points, TexelPlace* out) {
  float matrix[9];
  to_floats(layout_from_world(image), matrix);
  const ReadBuffers& b = located(*image.layout, matrix, points);
  const auto texel = [&](float u, int n) {
    return std::clamp(static_cast<int>(std::floor(texel_from_u(static_cast<double>(u), n, image.placement) + 0.5)), 0,
                      n - 1);
  };
  for (int i = 0; i < points.count; ++i) {
    const int face = static_cast<int>(b.face[i]);
    const Image& pixels = image.faces[static_cast<std::size_t>(face)];
    out[i] = {face, texel(b.u[i], pixels.width()), texel(b.v[i], pixels.height())};
  }
}

}  // namespace envconv
