// SPDX-License-Identifier: Apache-2.0
#include "pixels.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

namespace envconv::tool {
namespace {

constexpr float largest_half = 65504.0f;

struct Position {
  int x, y, channel;
};

std::vector<Position> nonfinite_positions(const Image& image) {
  std::vector<Position> found;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      for (int c = 0; c < image.channels(); ++c) {
        if (!std::isfinite(image.at(x, y)[c])) found.push_back({x, y, c});
      }
    }
  }
  return found;
}

}  // namespace

void add_statistics(const Image& image, std::vector<ChannelStatistics>& totals) {
  totals.resize(static_cast<std::size_t>(image.channels()));
  for (int y = 0; y < image.height(); ++y) {
    const float* p = image.row(y);
    for (int x = 0; x < image.width(); ++x) {
      for (ChannelStatistics& s : totals) {
        const float value = *p++;
        if (std::isnan(value)) {
          ++s.nan;
          continue;
        }
        if (value < 0) ++s.negative;
        if (std::isinf(value)) {
          ++s.infinite;
          continue;
        }
        s.min = s.finite ? std::min(s.min, value) : value;
        s.max = s.finite ? std::max(s.max, value) : value;
        ++s.finite;
      }
    }
  }
}

namespace {

// f(values of a row), for all rows.
template <class AnyImage, class F>
void for_each_row(AnyImage& image, F f) {
  const std::size_t values = static_cast<std::size_t>(image.width()) * static_cast<std::size_t>(image.channels());
  for (int y = 0; y < image.height(); ++y) f(std::span(image.row(y), values));
}

}  // namespace

float largest_color(const EnvImage& image) {
  float largest = 0;
  for (const Image& face : image.faces) {
    for_each_row(face, [&](std::span<const float> row) {
      for (std::size_t i = 0; i < row.size();) {
        for (int c = 0; c < face.channels(); ++c, ++i) {
          if (c != image.channels.alpha && row[i] > largest && std::isfinite(row[i])) largest = row[i];
        }
      }
    });
  }
  return largest;
}

std::int64_t count_nonfinite(const Image& image) {
  std::int64_t count = 0;
  for_each_row(image, [&](std::span<const float> row) {
    for (const float v : row) count += !std::isfinite(v);
  });
  return count;
}

void clamp_nonfinite(Image& image) {
  float largest = largest_half;
  for_each_row(image, [&](std::span<const float> row) {
    for (const float v : row) {
      if (std::isfinite(v)) largest = std::max(largest, std::abs(v));
    }
  });
  for_each_row(image, [&](std::span<float> row) {
    for (float& v : row) {
      if (std::isnan(v)) v = 0;
      if (std::isinf(v)) v = std::copysign(largest, v);
    }
  });
}

void zero_nonfinite(Image& image) {
  for_each_row(image, [&](std::span<float> row) {
    for (float& v : row) {
      if (!std::isfinite(v)) v = 0;
    }
  });
}

void repair_nonfinite(Image& image) {
  std::vector<Position> holes = nonfinite_positions(image);
  while (!holes.empty()) {
    // All of a round are computed before any is stored, so that the result does not depend on the order.
    std::vector<std::pair<Position, float>> filled;
    std::vector<Position> left;
    for (const Position& hole : holes) {
      double sum = 0;
      int count = 0;
      for (int y = std::max(0, hole.y - 1); y <= std::min(image.height() - 1, hole.y + 1); ++y) {
        for (int x = std::max(0, hole.x - 1); x <= std::min(image.width() - 1, hole.x + 1); ++x) {
          const float value = image.at(x, y)[hole.channel];
          if (!std::isfinite(value)) continue;
          sum += value;
          ++count;
        }
      }
      if (count > 0) {
        filled.emplace_back(hole, static_cast<float>(sum / count));
      } else {
        left.push_back(hole);
      }
    }
    if (filled.empty()) break;
    for (const auto& [hole, value] : filled) image.at(hole.x, hole.y)[hole.channel] = value;
    holes = std::move(left);
  }
  for (const Position& hole : holes) image.at(hole.x, hole.y)[hole.channel] = 0;
}

void scale_color(Image& image, int alpha, float factor) {
  for_each_row(image, [&](std::span<float> row) {
    for (std::size_t i = 0; i < row.size();) {
      for (int c = 0; c < image.channels(); ++c, ++i) {
        if (c != alpha) row[i] *= factor;
      }
    }
  });
}

}  // namespace envconv::tool
