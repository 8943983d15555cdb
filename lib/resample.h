// SPDX-License-Identifier: Apache-2.0
// From one environment to another: every output texel is the integral of the source over the texel's own footprint.
#pragma once

#include <functional>

#include "filter.h"
#include "image.h"
#include "layout.h"
#include "result.h"

namespace envconv {

/// What to make.
struct ResampleOptions {
  const Layout* layout = nullptr;  ///< the output's
  int height = 0;                  ///< of the output's face 0, in texels, >= 1
  Placement placement = Placement::centre;
  Mat3 consumer_from_world;        ///< the frame the output is for
  Rotation rotation;               ///< turn of the environment, before the frame
  const Filter* filter = nullptr;  ///< nullptr: auto
  int samples = 0;                 ///< sub-samples a side per output texel; 0: as the filter chooses
  int threads = 0;                 ///< worker threads; 0: all cores
  /// Called now and then from worker threads with the share done, 0 to 1; false stops the work.  May be empty.
  std::function<bool(double)> progress;
};

/// The environment in another layout, size, placement, frame or rotation.
/// Where nothing changes, the source's texels are copied bit for bit.  The result does not depend on the thread count.
/// `recycled` is a result that is no longer needed: where its faces have the right size, their memory is used again,
/// which the system then need not clear (a third of the time of a bilinear conversion).
/// Errors: unsupported (an empty source), limit (memory), internal; stopping by progress gives ErrorCode::output.
Result<EnvImage> resample(const EnvImage& source, const ResampleOptions& options, EnvImage recycled = {});

/// The same of a source that is needed no more: its texels that no face owns are overwritten, which saves a copy of
/// layouts that fill their faces in part, and where nothing changes its faces are moved into the result.
Result<EnvImage> resample(EnvImage&& source, const ResampleOptions& options, EnvImage recycled = {});

/// Bytes that resample() will hold besides its source, the result included.  used_up: when the source is moved.
std::size_t resample_bytes(const EnvImage& source, const ResampleOptions& options, bool used_up = false);

}  // namespace envconv
