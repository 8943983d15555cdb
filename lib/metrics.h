// SPDX-License-Identifier: Apache-2.0
// Errors between two environments of any layouts, sizes, placements and frames, over the sphere.
//
// Where both maps have the same grid (layout, size, placement, frame) the points of comparison are its texels, each
// weighted with the solid angle that it owns.  Otherwise both maps are read bilinearly, as a renderer would, on points
// of equal area that lie on neither map's grid: centres of a HEALPix grid that is turned out of all symmetry, at least
// as many as the finer map has texels and at least
// 786432; where they are too few for the squared error (around a
// sun, say) more are laid, until its integral is known to about 1/1000.
//
// A point at which either map is NaN or infinite in a channel that is compared counts for neither: such values are
// counted and the share of the sphere that they spoil is told.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "geometry.h"
#include "image.h"
#include "result.h"

namespace envconv {

/// The figures of one channel, or of all together.  a and b are values of the two maps, E is the mean over the sphere.
/// Not a number where no point could be compared.
struct ErrorFigures {
  double mean_a = 0, mean_b = 0;      ///< E[a], E[b]
  double rmse = 0;                    ///< sqrt(E[(a-b)^2])
  double mae = 0;                     ///< E[|a-b|]
  double max_error = 0;               ///< largest |a-b| on the points, and on the centres of both maps' texels
  Vec3 max_error_direction{0, 0, 0};  ///< where that is: unit, world frame; zero when nothing differs
  double psnr = 0;                    ///< 10 log10(peak^2 / E[(a-b)^2]) dB; infinite when nothing differs
  double psnr_hdr = 0;                ///< the same of log_encoded() values, whose peak is log_encoded_range()
  double ws_psnr = 0;      ///< Sun, Lu & Yu 2017: on the texels of a's grid, weighted with their solid angles
  double s_psnr = 0;       ///< Yu, Lakshman & Girod 2015: nearest texels at 655362 points (S-PSNR-NN)
  double ssim_sphere = 0;  ///< Wang et al. 2004, of log-encoded values, in windows on tangent planes; at most 1
};

/// What compare_maps() found.
struct Comparison {
  std::vector<std::string> channels;  ///< those that both maps have, in a's order
  std::vector<ErrorFigures> figures;  ///< [channels]
  /// Of the colour channels (all but alpha): means of means and of squared errors, the largest error.
  ErrorFigures total;
  double peak = 1;                                ///< of psnr, ws_psnr and s_psnr
  std::int64_t nonfinite_a = 0, nonfinite_b = 0;  ///< values, in texels that the layouts own
  double excluded = 0;                            ///< share of the sphere that could not be compared
  std::vector<std::string> only_in_a, only_in_b;  ///< channels that were left out
  bool same_grid = false;
};

struct CompareOptions {
  double peak = 0;  ///< 0: the largest finite value of a's colour channels, or 1 when none is above 0
  int threads = 0;  ///< 0: all cores; the result does not depend on it
};

/// Compares b with a, the reference.  Errors: unsupported (no pixels, no channel in common), limit (memory).
Result<Comparison> compare_maps(const EnvImage& a, const EnvImage& b, const CompareOptions& options);

/// How errors lie on the sphere.  An error at a point is the root of the mean square over the colour channels.
struct ErrorProfile {
  static constexpr int bands = 90;       ///< of equal height in degrees, from +Y (latitude 90) down
  std::vector<double> rmse_by_latitude;  ///< [bands]; NaN where nothing could be compared
  std::vector<double> edges, share;      ///< share of the sphere with an error between two edges, which grow by
                                         ///< 10^(1/8); trimmed to where there is any
  double equal_share = 0;                ///< share of the sphere with no error
};
/// On 786432 points of equal area; both maps are read bilinearly.  Errors as for compare_maps().
Result<ErrorProfile> error_profile(const EnvImage& a, const EnvImage& b, int threads);

/// The error as an environment of one channel: over each texel's footprint, the root of the mean square of the errors
/// at points as dense as the finer map's texels.  NaN where nothing could be compared; -1 in texels whose centre the
/// layout does not own.  Errors as for compare_maps().
Result<EnvImage> error_map(const EnvImage& a, const EnvImage& b, const Layout& layout, int height, int threads);

/// log2(max(x, 0) + 1/1024): about equal steps look about equally different, over the whole range of radiance.
double log_encoded(double x);
/// log_encoded(peak) - log_encoded(0).
double log_encoded_range(double peak);

/// The 655362 directions of S-PSNR: an icosahedron's vertices after eight bisections of its edges, pushed out to the
/// sphere each time (10 * 4^8 + 2 of them).  Made by the first call; thread-safe.
const std::vector<Vec3>& s_psnr_points();

}  // namespace envconv
