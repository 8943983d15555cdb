// SPDX-License-Identifier: Apache-2.0
#include "sampler.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>
#include <utility>
#include <vector>

#include "quadrature.h"
#include "source.h"
#include "source_blocks.h"
#include "sum_kernels.h"

namespace envconv {

struct Sampler::State {
  Filter filter;
  Mat3 source_from_world;
  int channels = 0;
  EnvImage pixels;  // that the groups read, unless they are in blocks
  // Four channels each, which stay where they are: blocks point at their sources.
  struct Group {
    Group(const EnvImage& image, int first, const Filter& filter)
        : source(image, nullptr, first, filter), blocks(source, filter.kernel, 0) {
      if (is_prefiltered(filter.kernel)) blocks.make_all();
    }
    Source source;
    SourceBlocks blocks;
  };
  std::vector<std::unique_ptr<Group>> groups;
  double thinnest = 0;  // shortest side of the source's texels at its faces' centres, in radians
};

Sampler::Sampler(std::unique_ptr<State> state) : state_(std::move(state)) {}
Sampler::Sampler(Sampler&&) noexcept = default;
Sampler& Sampler::operator=(Sampler&&) noexcept = default;
Sampler::~Sampler() = default;

int Sampler::channels() const { return state_->channels; }

Result<Sampler> Sampler::make(const EnvImage& source, const Filter& filter) {
  if (!source.layout || source.faces.empty() || source.channels.count() == 0)
    return Error{ErrorCode::unsupported, "the source has no pixels"};
  try {
    auto state = std::make_unique<State>();
    state->filter = filter;
    state->source_from_world = layout_from_world(source);
    state->channels = source.channels.count();
    EnvImage& pixels = state->pixels;
    pixels.layout = source.layout;
    pixels.placement = source.placement;
    pixels.channels = source.channels;
    for (const Image& face : source.faces) pixels.faces.push_back(face.clone());
    for (int first = 0; first < state->channels; first += 4)
      state->groups.push_back(std::make_unique<State::Group>(pixels, first, filter));
    if (is_prefiltered(filter.kernel)) pixels.faces.clear();
    state->thinnest = 1e30;
    for (int f = 0; f < source.layout->face_count(); ++f) {
      const Image& face = source.faces[static_cast<std::size_t>(f)];
      const DirectionJet jet = source.layout->direction_jet(f, 0.5, 0.5);
      state->thinnest = std::min({state->thinnest, length(jet.du) * texel_extent(face.width(), source.placement),
                                  length(jet.dv) * texel_extent(face.height(), source.placement)});
    }
    return Sampler(std::move(state));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to prepare the environment"};
  } catch (const std::length_error& error) {
    return Error{ErrorCode::limit, error.what()};
  }
}

void Sampler::radiance(Vec3 d, Vec3 du, Vec3 dv, float* out) const {
  const State& state = *state_;
  const auto samples = [&](Vec3 side) {
    if (state.filter.spacing <= 0 || length(side) == 0) return 1;
    const double wanted = std::ceil(length(side) / (state.thinnest * state.filter.spacing));
    return std::max(state.filter.least_samples, static_cast<int>(std::min(wanted, 256.0)));
  };
  const Quadrature qu = quadrature(state.filter, samples(du)), qv = quadrature(state.filter, samples(dv));
  std::vector<double> sum(static_cast<std::size_t>(state.channels), 0.0);
  static thread_local Windows windows;
  for (int j = 0; j < qv.count(); ++j)
    for (int i = 0; i < qu.count(); ++i) {
      const double weight = qu.weight[static_cast<std::size_t>(i)] * qv.weight[static_cast<std::size_t>(j)];
      const Vec3 e = state.source_from_world *
                     (d + qu.offset[static_cast<std::size_t>(i)] * du + qv.offset[static_cast<std::size_t>(j)] * dv);
      for (std::size_t g = 0; g < state.groups.size(); ++g) {
        const Source& source = state.groups[g]->source;
        const Location at = source.layout().locate(e);
        float face[16], u[16], v[16], w[16] = {1};
        std::fill_n(face, 16, static_cast<float>(at.face));
        std::fill_n(u, 16, static_cast<float>(at.u));
        std::fill_n(v, 16, static_cast<float>(at.v));
        float value[4];
        make_windows(source.maps(), state.filter.kernel, 1, face, u, v, w, windows);
        if (is_prefiltered(state.filter.kernel))
          std::as_const(state.groups[g]->blocks).point(1, face, windows);
        else
          source.point(state.filter.kernel, 1, face, windows);
        sum_windows(state.filter.kernel, source.channels(), 1, windows, w, value);
        const Place place = place_of(windows, 0);
        source.add_highlights(at.face, place.x, place.y, place.fx, place.fy, value);
        for (std::size_t c = 0; c < 4 && 4 * g + c < sum.size(); ++c)
          sum[4 * g + c] += weight * static_cast<double>(value[c]);
      }
    }
  for (std::size_t c = 0; c < sum.size(); ++c) out[c] = static_cast<float>(sum[c]);
}

}  // namespace envconv
