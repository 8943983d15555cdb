// SPDX-License-Identifier: Apache-2.0
// Reconstruction filters: the kernels' formulas, how many taps they read, and how an output texel is sampled with them.
#pragma once

#include <span>
#include <string_view>

namespace envconv {

/// The continuous function that is laid through the source's texels.
enum class Kernel {
  nearest,            ///< 1 tap
  bilinear,           ///< 2 taps
  catmull_rom,        ///< 4 taps, interpolating cubic (Catmull & Rom 1974)
  band_limited,       ///< 5 taps on prefiltered texels, least error over the band (see kernel_design.py)
  band_limited_wide,  ///< 7 taps on texels prefiltered for them, for outputs finer than their source, or of many
                      ///< samples
  drooping,           ///< 5 taps, whose loss at high frequencies is made up for later (see kernel_design.py)
  lanczos3,           ///< 6 taps, normalised
};

/// Texels read along one axis.
constexpr int taps(Kernel kernel) {
  switch (kernel) {
    case Kernel::nearest: return 1;
    case Kernel::bilinear: return 2;
    case Kernel::catmull_rom: return 4;
    case Kernel::band_limited:
    case Kernel::drooping: return 5;
    case Kernel::band_limited_wide: return 7;
    case Kernel::lanczos3: return 6;
  }
  return 0;
}

/// How many taps lie left of the one whose texel a sample is at: at its floor, or for an odd number at the nearest.
constexpr int taps_before(Kernel kernel) { return (taps(kernel) - 1) / 2; }

/// Kernel::band_limited.  Weights of the taps at -2 .. 2 for a sample at f in [-1/2, 1/2] from the middle one are
/// polynomials: c0 in f^2; c1 and c2 of the taps at +1 and +2 in f, and of those at -1 and -2 in -f.  They add up to 1
/// for every f.  The texels go through 1/D(w), D = prod (1 - 2 p cos w + p^2) / (1 - p)^2 over two poles p, before.
///
/// Kernel and prefilter come from one weighted least-squares fit to exp(iwx) over [0, pi] and all f (Sanathanan and
/// Koerner's iteration for D, Lawson's for the weights): tests/bench/kernel_design.py.  The error of a wave (rms over
/// f) of 0.2, 0.4, 0.6, 0.7, 0.8 of the Nyquist frequency is -85, -71, -56, -49, -34 dB; OMOMS' cubic has -81, -55,
/// -33, -24, -15.
namespace band_limited {
inline constexpr float c0[4] = {0.4941882483f, -0.3532700389f, 0.1405218391f, -0.0170824945f};
inline constexpr float c1[7] = {0.2369767094f,  0.3633914404f, 0.0688076557f, -0.1510810387f,
                                -0.0885553467f, 0.0170935965f, 0.0119941789f};
inline constexpr float c2[7] = {0.0159291665f, 0.0685273763f,  0.1078273637f, 0.0743866647f,
                                0.0182944272f, -0.0099132809f, -0.0034529317f};
inline constexpr double poles[2] = {-0.5773157318, -0.0800810538};
}  // namespace band_limited

/// Kernel::band_limited_wide, likewise, with taps at -3 .. 3: twice the work, and errors of -107, -99, -86, -62, -49 dB
/// there.  It serves outputs finer than their source, as means over texels so small leave a kernel's errors as they
/// are, and those of which more samples are asked for than auto takes.
namespace band_limited_wide {
inline constexpr float c0[4] = {0.4435351517f, -0.2554902314f, 0.0695320888f, -0.0127605946f};
inline constexpr float c1[7] = {0.2454545777f,  0.2984546029f, 0.0152515878f, -0.1099538986f,
                                -0.0309958058f, 0.0177594804f, 0.0089395196f};
inline constexpr float c2[7] = {0.0327778449f,  0.0983036582f,  0.1054726005f, 0.0373749412f,
                                -0.0130927711f, -0.0137837891f, -0.0026471727f};
inline constexpr float c3[7] = {1.5343154802e-09f, 1.6378868126e-03f, 7.0209273728e-03f, 1.1822621732e-02f,
                                9.3225325006e-03f, 3.2088073460e-03f, 8.7950419062e-05f};
inline constexpr double poles[2] = {-0.6663955986, -0.1950705356};
}  // namespace band_limited_wide

/// The recursions that a kernel's texels go through before.
struct Prefilter {
  float pole1, pole2;
  /// Texels that a recursion runs over before it is used: pole1 to this power is about 1e-3, of what the row's
  /// beginning differs from a row that goes on like it.
  int margin;
};
/// Whether a kernel reads prefiltered texels.
constexpr bool is_prefiltered(Kernel kernel) {
  return kernel == Kernel::band_limited || kernel == Kernel::band_limited_wide;
}
/// Of a kernel that does.
constexpr Prefilter prefilter_of(Kernel kernel) {
  const double* poles = kernel == Kernel::band_limited ? band_limited::poles : band_limited_wide::poles;
  return {static_cast<float>(poles[0]), static_cast<float>(poles[1]), kernel == Kernel::band_limited ? 12 : 18};
}

/// Kernel::drooping, for texels of many source texels: polynomials likewise, and no prefilter.  A wave of w radians a
/// texel comes out drooping_height(w) times as high: 1 up to a fifth of the Nyquist frequency, 0.94 at two fifths, 0.74
/// at three.  What depends on the fraction, and is lost, is small: -68, -45, -39 dB there.  Who reads many samples
/// divides by the height.  From kernel_design.py too.
namespace drooping {
inline constexpr float c0[4] = {0.7562373966f, -0.8903840562f, 0.3380960773f, -0.0550822817f};
inline constexpr float c1[7] = {0.1665993679f,  0.6911816282f, 0.4196739803f, -0.3602534665f,
                                -0.2266277389f, 0.0744905595f, 0.0377511985f};
inline constexpr float c2[7] = {-0.044718067f, -0.0965603666f, 0.0255180499f, 0.191553632f,
                                0.0575797005f, -0.0417883919f, -0.0102100579f};
}  // namespace drooping
double drooping_height(double w);

/// A registered filter.
struct Filter {
  std::string_view name;  ///< as on the command line
  std::string_view note;  ///< one line for listings
  Kernel kernel = Kernel::bilinear;
  double spacing = 1.3;   ///< largest distance between sub-samples, in source texels
  int least_samples = 1;  ///< sub-samples a side at least
  double window = 1.0;    ///< side of the window over the output, in its texels; 1: the texel's own footprint
  bool gaussian = false;  ///< the window is a Gaussian of sigma 1/2 texel instead of a box
  bool limited = false;   ///< highlights are reconstructed apart, without negative lobes, and conserve energy
};

/// "auto" first.
std::span<const Filter> all_filters();
/// The filter of that name, or nullptr.
const Filter* find_filter(std::string_view name);

}  // namespace envconv
