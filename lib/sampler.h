// SPDX-License-Identifier: Apache-2.0
// Radiance of an environment for a direction and a footprint: for renderers, probes and tests.  Whole pictures go
// through resample(), which shares the machinery and is far faster per sample.
#pragma once

#include <memory>

#include "filter.h"
#include "geometry.h"
#include "image.h"
#include "result.h"

namespace envconv {

/// An environment prepared for reading.  Immutable once made, and safe to use from many threads.
class Sampler {
 public:
  /// Prepares all channels of `source`, which may be destroyed afterwards.  Holds about 16 bytes a texel per four
  /// channels. A limited filter's highlights are read where they are, without the correction of energy that resample()
  /// makes. Errors: unsupported (no pixels), limit (memory).
  static Result<Sampler> make(const EnvImage& source, const Filter& filter);

  /// Mean radiance over the parallelogram around world direction d that tangents du and dv span (its full sides, in
  /// radians; zero for a point).  out: one value per channel.
  void radiance(Vec3 d, Vec3 du, Vec3 dv, float* out) const;
  /// At a point.
  void radiance(Vec3 d, float* out) const { radiance(d, {}, {}, out); }

  int channels() const;

  Sampler(Sampler&&) noexcept;
  Sampler& operator=(Sampler&&) noexcept;
  ~Sampler();

 private:
  struct State;
  explicit Sampler(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace envconv
