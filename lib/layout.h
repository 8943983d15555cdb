// SPDX-License-Identifier: Apache-2.0
// A layout: faces, and a pair of maps between their points and directions.  It knows nothing of pixels, files or
// frames.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "assertion.h"
#include "geometry.h"

namespace envconv {

/// One rectangle of a layout.
struct Face {
  std::string_view name;  ///< "px", "front", "d0" ...: {face} in templates, part names, metadata
  double aspect = 1.0;    ///< width / height at which texels are square in the face's own metric
  double scale = 1.0;     ///< height relative to face 0's at which texels agree at the faces' centres
};

/// Which points of a face the layout owns, that is, where locate(direction(p)) == p.
enum class Domain {
  square,   ///< all of every face
  disc,     ///< the inscribed disc; beyond it there is no direction of its own (the rim is one point of the sphere)
  overlap,  ///< up to a seam inside the face; texels beyond it have a direction that another face owns
};

/// Facts about a layout: the source of every listing, table and manual page.
struct LayoutInfo {
  std::string_view title;   ///< one line for listings
  std::string_view source;  ///< paper, section, equation
  std::string_view notes;   ///< a paragraph for the manual page: orientation, errata, what it is good for
  std::span<const Face> faces;
  Domain domain = Domain::square;
  bool equal_area = false;  ///< every texel of every face spans the same solid angle (a law checks the claim)
  bool zonal = false;       ///< all texels of a row span the same solid angle (a law checks the claim)
  bool congruent = false;   ///< the same part of every face is owned and spans the same solid angle (a law checks it)
  bool conformal = false;   ///< locally free of anisotropy (a law checks the claim)
  Placement placement = Placement::centre;
  /// The frame that the name implies, applied after the user's: "world" for all but mirror-ball, whose picture is, as a
  /// photograph of a mirror is, a mirrored one.
  std::string_view frame = "world";
  /// The default packing: faces row by row, so many in each row.  One entry: a row.  {1,1}: a column.
  std::span<const int> rows;
  double max_error = 0.01;  ///< worst error of the float kernels against double, in texels of a 16384-wide face
};

/// A face point with its owner.
struct Location {
  int face = 0;
  double u = 0, v = 0;
};

/// A direction with its derivatives with respect to u and v (of the normalised direction, exact to rounding).
struct DirectionJet {
  Vec3 d, du, dv;
};

/// The functions that a layout's file exports; see ENVCONV_EXPORT_LAYOUT in layout_kernel-inl.h.
struct LayoutKernels {
  LayoutInfo (*info)();
  Vec3 (*direction)(int face, double u, double v);
  DirectionJet (*direction_jet)(int face, double u, double v);
  double (*density)(int face, double u, double v);
  Location (*locate)(Vec3 d);
  int (*owner)(int face, double u, double v);  // the face that owns the direction of a face point
  void (*directions)(int face, std::size_t n, const float* u, const float* v, float* x, float* y, float* z);
  void (*locations)(std::size_t n, const float* x, const float* y, const float* z, float* face, float* u, float* v);
};

/// Floats past the end that directions() and locations() may read and overwrite in each array (the widest vector).
inline constexpr std::size_t batch_padding = 16;

/// A registered layout.  Immutable and thread-safe; its functions never allocate and never fail.
class Layout {
 public:
  Layout(std::string_view name, const LayoutKernels& kernels) : name_(name), kernels_(kernels), info_(kernels.info()) {}

  std::string_view name() const { return name_; }  ///< "octahedral-equal-area": the same word everywhere
  const LayoutInfo& info() const { return info_; }
  int face_count() const { return static_cast<int>(info_.faces.size()); }

  /// Unit direction of a face point, exact to double rounding.  Beyond [0,1] the map goes on smoothly over the
  /// edge for as far as an apron needs (one half of a face at least); beyond a disc's rim it comes back on the other
  /// side.
  Vec3 direction(int face, double u, double v) const {
    ENVCONV_ASSERT(has_face(face));
    return kernels_.direction(face, u, v);
  }
  /// The same with its derivatives, by automatic differentiation of the same formula.
  DirectionJet direction_jet(int face, double u, double v) const {
    ENVCONV_ASSERT(has_face(face));
    return kernels_.direction_jet(face, u, v);
  }
  /// Solid angle per unit of u and of v, in steradians: |dd/du x dd/dv|.
  double density(int face, double u, double v) const {
    ENVCONV_ASSERT(has_face(face));
    return kernels_.density(face, u, v);
  }
  /// The face that owns direction d (any finite length > 0), and where on it; u and v are in [0,1].
  Location locate(Vec3 d) const {
    ENVCONV_ASSERT(std::isfinite(length(d)) && length(d) > 0);
    const Location at = kernels_.locate(d);
    ENVCONV_ASSERT(has_face(at.face) && at.u >= 0 && at.u <= 1 && at.v >= 0 && at.v <= 1);
    return at;
  }
  /// True where the layout owns the face point: always for Domain::square.
  bool owns(int face, double u, double v) const;

  /// n face points of one face to unit directions, on the best SIMD target of this machine.  Arrays of n rounded up to
  /// a multiple of batch_padding floats; no alignment needed.  x, y, z must not overlap u, v.
  void directions(int face, std::size_t n, const float* u, const float* v, float* x, float* y, float* z) const {
    ENVCONV_ASSERT(has_face(face));
    kernels_.directions(face, n, u, v, x, y, z);
  }
  /// n directions of any length > 0 to owner and place; arrays as for directions().  face holds whole numbers.
  void locations(std::size_t n, const float* x, const float* y, const float* z, float* face, float* u, float* v) const {
    kernels_.locations(n, x, y, z, face, u, v);
  }

 private:
  bool has_face(int face) const { return face >= 0 && face < face_count(); }

  std::string_view name_;
  LayoutKernels kernels_;
  LayoutInfo info_;
};

/// Every layout, in the registry's order.
std::span<const Layout> all_layouts();
/// The layout of that name (command-line spelling), or nullptr.
const Layout* find_layout(std::string_view name);
/// The name in `names` nearest to `word` by edit distance, or "" when none is near: for "did you mean".
std::string_view nearest_name(std::string_view word, std::span<const std::string_view> names);

}  // namespace envconv
