// SPDX-License-Identifier: Apache-2.0
// MIP levels: every level's texel is the mean of level 0's radiance over the texel's own footprint, weighted by solid
// angle, so that every level has the same mean over the sphere.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "image.h"
#include "result.h"

namespace envconv {

/// A registered filter for levels.
struct MipFilter {
  std::string_view name;  ///< as on the command line
  std::string_view note;  ///< one line for listings
  double radius = 0.5;    ///< of the kernel's support, in texels of the level; 1/2: the texel's own footprint
  double (*kernel)(double t) = nullptr;  ///< weight at t texels from the centre, |t| < radius; null for box
};

/// "box" first.
std::span<const MipFilter> all_mip_filters();
/// The filter of that name, or nullptr.
const MipFilter* find_mip_filter(std::string_view name);

/// Size of a level: halved so many times, rounded down, at least 1 (the rule of OpenGL, Direct3D, Vulkan and OpenEXR).
Size level_size(Size level0, int level);
/// Levels of a chain down to one texel a face, level 0 included.  height >= 1.
int level_count(const Layout& layout, int height);

/// What to make.
struct MipOptions {
  const MipFilter* filter = nullptr;  ///< nullptr: box
  int levels = 0;                     ///< level 0 included; 0: down to one texel a face, and never more than that
  int threads = 0;                    ///< worker threads; 0: all cores
};

/// Levels 1 to n-1 of `level0`; empty when there is but one.
///
/// box: exact.  A texel is the mean over the part of its footprint that the layout owns, by true overlap of level 0's
/// texels where sizes don't divide, each piece weighted by its solid angle.
///
/// The other filters read wider than the texel, across faces' edges: to the box mean comes what the filter has over the
/// box, of radiance limited to a few times the mean.  So highlights neither ring nor lose energy, no value falls below
/// zero where level 0 has none below, and what the limited part's mean has lost is given back by a gain.
///
/// Texels that own nothing (beyond a disc, or a seam) get the radiance of the direction that they stand for; beyond a
/// disc, of the one point of the sphere that its rim is.
///
/// The result does not depend on the thread count.  Errors: usage (no pixels), limit (memory).
Result<std::vector<EnvImage>> make_mips(const EnvImage& level0, const MipOptions& options);

/// Bytes that make_mips() holds at one time besides level 0, the result included, for so many channels.
std::size_t mip_bytes(const Layout& layout, int height, int channels, const MipOptions& options);

}  // namespace envconv
