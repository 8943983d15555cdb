// SPDX-License-Identifier: Apache-2.0
#include "map_pair.h"

#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>

#include "map_reader.h"

namespace envconv {
namespace {

constexpr int least_grid = 256;  // 786432 points: the figures of small maps are then good to about 1/1000

bool has_pixels(const EnvImage& image) {
  return image.layout && static_cast<int>(image.faces.size()) == image.layout->face_count() &&
         image.channels.count() > 0 && !image.faces.front().empty();
}

// The image with the channels of those indices only.
EnvImage with_channels(const EnvImage& image, const std::vector<int>& indices) {
  EnvImage out;
  out.layout = image.layout;
  out.placement = image.placement;
  out.consumer_from_world = image.consumer_from_world;
  for (std::size_t k = 0; k < indices.size(); ++k) {
    out.channels.names.push_back(image.channels.names[static_cast<std::size_t>(indices[k])]);
    if (indices[k] == image.channels.alpha) out.channels.alpha = static_cast<int>(k);
  }
  for (const Image& face : image.faces) {
    Image copy(face.width(), face.height(), out.channels.count());
    const float* from = face.data();
    float* to = copy.data();
    for (std::size_t i = 0; i < face.pixel_count(); ++i, from += face.channels())
      for (const int index : indices) *to++ = from[index];
    out.faces.push_back(std::move(copy));
  }
  return out;
}

bool is_same_grid(const EnvImage& a, const EnvImage& b) {
  if (a.layout != b.layout || a.placement != b.placement || !(a.consumer_from_world == b.consumer_from_world))
    return false;
  for (std::size_t f = 0; f < a.faces.size(); ++f)
    if (a.faces[f].width() != b.faces[f].width() || a.faces[f].height() != b.faces[f].height()) return false;
  return true;
}

int grid_for(std::size_t texels) {
  const double needed = std::sqrt(static_cast<double>(texels) / 12) / PointSquare::side;
  return std::max(least_grid, PointSquare::side * static_cast<int>(std::ceil(needed)));
}

}  // namespace

Result<MapPair> MapPair::make(const EnvImage& a, const EnvImage& b) {
  if (!has_pixels(a) || !has_pixels(b)) return Error{ErrorCode::unsupported, "a map without pixels cannot be compared"};
  MapPair pair;
  std::vector<int> in_a, in_b;
  for (int i = 0; i < a.channels.count(); ++i) {
    const std::string& name = a.channels.names[static_cast<std::size_t>(i)];
    const auto other = std::ranges::find(b.channels.names, name);
    if (other == b.channels.names.end()) {
      pair.only_in_a.push_back(name);
      continue;
    }
    pair.channels.push_back(name);
    pair.is_color.push_back(i != a.channels.alpha);
    in_a.push_back(i);
    in_b.push_back(static_cast<int>(other - b.channels.names.begin()));
  }
  for (const std::string& name : b.channels.names)
    if (std::ranges::find(pair.channels, name) == pair.channels.end()) pair.only_in_b.push_back(name);
  if (std::ranges::find(pair.is_color, true) == pair.is_color.end())
    return Error{ErrorCode::unsupported, "the maps have no colour channel in common"};
  pair.owned_.reserve(2);  // pointers into it stay
  const auto chosen = [&](const EnvImage& image, const std::vector<int>& indices) {
    if (static_cast<int>(indices.size()) == image.channels.count() && std::ranges::is_sorted(indices)) return &image;
    return static_cast<const EnvImage*>(&pair.owned_.emplace_back(with_channels(image, indices)));
  };
  pair.a = chosen(a, in_a);
  pair.b = chosen(b, in_b);
  pair.same_grid = is_same_grid(a, b);
  pair.grid = grid_for(std::max(a.texel_count(), b.texel_count()));
  return pair;
}

double MapPair::color_error(const float* at_a, const float* at_b) const {
  double sum = 0;
  int colors = 0;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    if (!is_color[c]) continue;
    const double error = static_cast<double>(at_a[c]) - static_cast<double>(at_b[c]);
    if (!std::isfinite(error)) return std::nan("");
    sum += error * error;
    ++colors;
  }
  return std::sqrt(sum / colors);
}

Result<Ok> run_in_arena(int threads, const std::function<void()>& work) {
  try {
    // More than there are cores gain nothing, and make TBB print.
    const int cores = tbb::info::default_concurrency();
    tbb::task_arena arena(threads > 0 ? std::min(threads, cores) : cores);
    arena.execute(work);
    return Ok{};
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to compare"};
  } catch (const std::length_error& error) {
    return Error{ErrorCode::limit, error.what()};
  }
}

}  // namespace envconv
