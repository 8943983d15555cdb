// SPDX-License-Identifier: Apache-2.0
// Polar-capped maps: a band of 45 degrees to either side of the equator, and two discs for the poles.
//
//      +---------------------------+      The band is that of the lat-long map: centre +Z, right of it +X.
//      | -Z   -X    +Z    +X    -Z |      A cap's disc has a radius of 45 degrees and lies as the cube's face
//      +---------------------------+      does: north, above the +Z face, has -Z at its top and +Z at its
//        . -Z .          . +Z .           bottom; south the other way round.  Corners of caps, and aprons,
//      -X  +Y +X        -X -Y +X          go on by the same formula.
//        ` +Z '          ` -Z '
//        north            south
//
// Stretch-invariant: lat-long band and azimuthal equidistant caps.  Conformal: Mercator band and stereographic caps.
// Source: Snyder & Mitchell, Sampling-Efficient Mapping of Spherical Images, Microsoft Research 2001.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/polar_capped.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

inline constexpr double log_1_sqrt2 = 0.88137358701954302523;    // Mercator's height of 45 degrees: ln tan(3 pi/8)
inline constexpr double tan_eighth = std::numbers::sqrt2 - 1.0;  // tan(45 degrees / 2): radius of a stereographic cap

// Up to 45 degrees a direction belongs to the band.
template <class F>
auto in_band(const Vec<F>& d) {
  return d.y * d.y <= d.x * d.x + d.z * d.z;
}

struct polar_capped {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"band", 4.0}, {"north"}, {"south"}};
    static constexpr int rows[] = {1, 2};
    return {.title = "Polar-capped map, stretch-invariant",
            .source = "Snyder & Mitchell 2001",
            .notes =
                "The lat-long band of 45 degrees to either side of the equator (centre +Z, right of it +X), and two "
                "discs of equal angular steps for the poles, each placed as the cube's face: top of the north cap -Z, "
                "top of the south cap +Z. A lat-long map without its waste: no texel is stretched by more than 1.41. "
                "The corners beyond a cap hold the band's true radiance.",
            .faces = faces,
            .domain = Domain::overlap,
            .rows = rows,
            .max_error = 0.0015};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    if (face == 0) {
      F sin_lon, cos_lon, sin_lat, cos_lat;
      sincos_turns(u - 0.5, sin_lon, cos_lon);
      sincos_turns(0.25 * (0.5 - v), sin_lat, cos_lat);
      d = {sin_lon * cos_lat, sin_lat, cos_lon * cos_lat};
    } else {
      Vec<F> e;
      azimuthal_equidistant(0.125, 2.0 * u - 1.0, 1.0 - 2.0 * v, e);
      d = {e.x, face == 1 ? e.z : -e.z, face == 1 ? -e.y : e.y};
    }
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const auto band = in_band(d);
    const auto south = d.y < 0.0;
    F right, forward;
    const F h = polar(d.x, d.z, right, forward);
    const F half_r = 4.0 * atan2_turns(h, abs(d.y));
    const F down = select(south, -forward, forward);
    face = select(band, F(0.0), select(south, F(2.0), F(1.0)));
    u = 0.5 + select(band, atan2_turns(d.x, d.z), half_r * right);
    v = 0.5 + select(band, -4.0 * atan2_turns(d.y, h), half_r * down);
  }
};

struct polar_capped_conformal {
  static LayoutInfo info() {
    // A cap's |dd/dv| at its centre is 4 tan(pi/8), the band's 2 ln tan(3 pi/8).
    static constexpr double cap_scale = 2.0 * tan_eighth / log_1_sqrt2;
    static constexpr Face faces[] = {{"band", pi / log_1_sqrt2}, {"north", 1.0, cap_scale}, {"south", 1.0, cap_scale}};
    static constexpr int rows[] = {1, 2};
    return {.title = "Polar-capped map, conformal",
            .source = "Snyder & Mitchell 2001",
            .notes =
                "As polar-capped, with a Mercator band (aspect pi : ln tan(3 pi/8), about 3.564) and stereographic "
                "caps: free of anisotropy everywhere. The caps are 0.94 times as high as the band, so that texels "
                "agree at the faces' centres.",
            .faces = faces,
            .domain = Domain::overlap,
            .conformal = true,
            .rows = rows,
            .max_error = 0.0015};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    if (face == 0) {
      F sin_lon, cos_lon;
      sincos_turns(u - 0.5, sin_lon, cos_lon);
      // Latitude from Mercator's height m = atanh(sin lat): cos = 1/cosh m, sin = tanh m.  An apron of half a face
      // reaches m = 1.76; the exponential's range ends at 2.
      const F m = min(max(2.0 * log_1_sqrt2 * (0.5 - v), -2.0), 2.0);
      const F e = exp(m), e2 = e * e;
      const F cos_lat = 2.0 * e / (e2 + 1.0), sin_lat = (e2 - 1.0) / (e2 + 1.0);
      d = {sin_lon * cos_lat, sin_lat, cos_lon * cos_lat};
    } else {
      const F a = tan_eighth * (2.0 * u - 1.0), down = tan_eighth * (2.0 * v - 1.0);
      const F r2 = a * a + down * down;
      const F k = 2.0 / (1.0 + r2);
      const F height = (1.0 - r2) / (1.0 + r2), forward = k * down;
      d = {k * a, face == 1 ? height : -height, face == 1 ? forward : -forward};
    }
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const auto band = in_band(d);
    const auto south = d.y < 0.0;
    const F l = sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    const F k = (0.5 / tan_eighth) / (l + abs(d.y));
    const F height = select(band, d.y, F(0.0)) / l;  // atanh goes to infinity in the caps
    face = select(band, F(0.0), select(south, F(2.0), F(1.0)));
    u = 0.5 + select(band, atan2_turns(d.x, d.z), k * d.x);
    v = 0.5 + select(band, (-0.5 / log_1_sqrt2) * atanh(height), k * select(south, -d.z, d.z));
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(polar_capped)
ENVCONV_EXPORT_LAYOUT(polar_capped_conformal)
