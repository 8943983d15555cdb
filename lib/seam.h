// SPDX-License-Identifier: Apache-2.0
// Seams: what is done at faces' edges for hardware that filters each face alone, and how much of a seam is left.
//
// No table of neighbours exists: what lies beyond an edge is found by stepping over it on the sphere and asking which
// face owns that point.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "image.h"
#include "result.h"

namespace envconv {

/// What is done at seams.
enum class SeamMethod {
  none,     ///< true integrals over each texel: for hardware with seamless filtering
  average,  ///< texels at an edge become the mean of those that meet there (after Isidoro, CubeMapGen, SIGGRAPH 2005)
  stretch,  ///< texel centres on the faces' edges (Placement::inclusive), equal wherever they meet
  gutter,   ///< faces grow by texels of what lies beyond their edges
};

/// A registered method.
struct SeamKind {
  std::string_view name;  ///< as on the command line and in the metadata
  SeamMethod method;
  std::string_view note;    ///< one line for listings
  std::string_view number;  ///< what follows a colon, or ""
  int least = 0, most = 0;  ///< of that number
  bool number_needed = false;
};
/// "none" first.
std::span<const SeamKind> all_seam_kinds();

/// A method and its number.
struct Seam {
  SeamMethod method = SeamMethod::none;
  int texels = 0;  ///< average: the width over which the correction fades; gutter: by how much each side grows
  friend bool operator==(const Seam&, const Seam&) = default;
  /// Texels by which a stored face is larger on every side.
  int gutter() const { return method == SeamMethod::gutter ? texels : 0; }
};
/// "none", "average:2", "stretch", "gutter:4".  Errors: usage.
Result<Seam> parse_seam(std::string_view text);
std::string text_of(const Seam& seam);

/// The placement of texels that a seam method asks for in a layout.
Placement placement_for(const Layout& layout, const Seam& seam);

/// Changes the texels at the edges of one level: `average`, `stretch` (whose placement the image must have already),
/// and `gutter` of layouts whose texels are centred on the edges: these are read alone there, so they become whole, the
/// same on both sides, as `stretch` makes them.  The mean over the sphere is kept.  Else nothing changes.
void fix_seams(EnvImage& image, const Seam& seam);

/// The faces of one level grown by `texels` on every side, filled with radiance from beyond the edges.  Where an edge
/// is a curve inside the face, the rectangle's texels beyond it are gutter too, and those that it cuts become whole:
/// the face's own radiance in the part that it owns, and in the rest what lies beyond.  All other texels are unchanged.
/// texels >= 0.
std::vector<Image> with_gutters(const EnvImage& image, int texels);
/// The inverse: the middle of each face, and of texels that a curve cuts the face's own part, to within what the
/// values' rounding is of it.
std::vector<Image> without_gutters(const Layout& layout, Placement placement, const std::vector<Image>& grown,
                                   int texels);

/// How a face is looked up: texture coordinate = u * scale + offset along one axis of n texels (those of gutters
/// included), so that clamped bilinear filtering meets the texels at their places.
struct LookupScale {
  double scale = 1, offset = 0;
};
LookupScale lookup_scale(int n, Placement placement, int gutter);

/// Seam errors, relative to the map's mean radiance.
struct SeamError {
  double largest = 0, rms = 0;                ///< between both sides' reconstructions, over points along all seams
  double inside_largest = 0, inside_rms = 0;  ///< over steps as long inside faces, from the texels beside the seams
  std::int64_t points = 0;                    ///< along seams
};
/// Compares, at points along every seam, the clamped bilinear reconstructions of its two sides (the largest difference
/// among channels of radiance), beside steps of equal length inside faces.  The length is what the two sides' texels
/// nearest to the point are apart; steps begin at these, or up to one step from them, and go along rows and columns,
/// each way, by as many texels as come nearest to the length, one at least.  For most layouts that is a texel; at the
/// rim of sphere maps, which is one direction, it is many.  Where a step ends is every texel of which the layout owns a
/// part.  So both figures look at the same lights, one at a seam included.  Seams are the edges of faces, as far as the
/// layout owns what is there, and the curves on which ownership changes inside them. `grown`: the faces with gutters of
/// so many texels, or empty.
SeamError seam_error(const EnvImage& image, const std::vector<Image>& grown = {}, int gutter = 0);

}  // namespace envconv
