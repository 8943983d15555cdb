// SPDX-License-Identifier: Apache-2.0
#include "icc_profile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>

#include "io_shared.h"

namespace envconv {
namespace {

using Bytes = std::span<const std::uint8_t>;

std::uint32_t number(Bytes bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 | std::uint32_t{bytes[at + 2]} << 8 |
         bytes[at + 3];
}

std::uint32_t short_number(Bytes bytes, std::size_t at) { return std::uint32_t{bytes[at]} << 8 | bytes[at + 1]; }

// s15Fixed16Number.
double fixed(Bytes bytes, std::size_t at) { return static_cast<std::int32_t>(number(bytes, at)) / 65536.0; }

bool is(Bytes bytes, std::size_t at, std::string_view text) {
  return std::equal(text.begin(), text.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

// The tag's data; empty where there is none, or where it is not all in the profile.
Bytes find(Bytes profile, std::string_view name) {
  constexpr std::size_t table = 132, entry = 12;
  const std::size_t count = std::min<std::size_t>(number(profile, 128), (profile.size() - table) / entry);
  for (std::size_t at = table; at < table + count * entry; at += entry) {
    if (!is(profile, at, name)) continue;
    const std::size_t offset = number(profile, at + 4), size = number(profile, at + 8);
    if (offset > profile.size() || size > profile.size() - offset) return {};
    return profile.subspan(offset, size);
  }
  return {};
}

// XYZType (section 10.31).
std::optional<Vec3> colorant(Bytes profile, std::string_view name) {
  const Bytes tag = find(profile, name);
  if (tag.size() < 20 || !is(tag, 0, "XYZ ")) return {};
  return Vec3{fixed(tag, 8), fixed(tag, 12), fixed(tag, 16)};
}

// The curve's values at equal steps from 0 to 1; empty where it makes no sense.
class Curve {
 public:
  explicit Curve(Bytes tag) : tag_(tag) {
    if (tag.size() < 12) return;
    if (is(tag, 0, "curv")) {
      count_ = number(tag, 8);
      good_ = count_ <= (tag.size() - 12) / 2;
    } else if (is(tag, 0, "para")) {
      constexpr std::array<std::size_t, 5> parameters{1, 3, 4, 5, 7};
      kind_ = short_number(tag, 8);
      good_ = kind_ < parameters.size() && (tag.size() - 12) / 4 >= parameters[kind_];
      parametric_ = true;
    }
  }
  bool good() const { return good_; }
  double operator()(double x) const { return parametric_ ? formula(x) : table(x); }

 private:
  // parametricCurveType (section 10.18, table 68).
  double formula(double x) const {
    const auto p = [this](std::size_t i) { return fixed(tag_, 12 + 4 * i); };
    const auto power = [&](double v) { return std::pow(std::max(v, 0.0), p(0)); };
    switch (kind_) {
      case 0: return power(x);
      case 1: return p(1) * x + p(2) >= 0 ? power(p(1) * x + p(2)) : 0;
      case 2: return (p(1) * x + p(2) >= 0 ? power(p(1) * x + p(2)) : 0) + p(3);
      case 3: return x >= p(4) ? power(p(1) * x + p(2)) : p(3) * x;
      default: return x >= p(4) ? power(p(1) * x + p(2)) + p(5) : p(3) * x + p(6);
    }
  }
  // curveType (section 10.6).
  double table(double x) const {
    if (count_ == 0) return x;
    if (count_ == 1) return std::pow(x, short_number(tag_, 12) / 256.0);
    const double at = x * (count_ - 1);
    const auto below = std::min(static_cast<std::size_t>(at), std::size_t{count_} - 2);
    const double a = short_number(tag_, 12 + 2 * below), b = short_number(tag_, 14 + 2 * below);
    return (a + (b - a) * (at - static_cast<double>(below))) / 65535;
  }

  Bytes tag_;
  bool good_ = false, parametric_ = false;
  std::uint32_t count_ = 0, kind_ = 0;
};

constexpr int kSteps = 64;
constexpr double kTolerance = 1.0 / 500;

template <class Function>
bool fits(const Curve& curve, const Function& function) {
  for (int i = 0; i <= kSteps; ++i) {
    const double x = static_cast<double>(i) / kSteps;
    if (!(std::abs(curve(x) - function(x)) <= kTolerance)) return false;
  }
  return true;
}

}  // namespace

std::optional<IccColor> read_icc_profile(Bytes profile) {
  if (profile.size() < 132 || !is(profile, 36, "acsp") || !is(profile, 16, "RGB ") || !is(profile, 20, "XYZ "))
    return {};
  if (!find(profile, "A2B0").empty()) return {};  // it has precedence (section 9.2.1)
  std::array<double, 8> xy{};
  Vec3 white{};
  constexpr std::array<std::string_view, 3> colorants{"rXYZ", "gXYZ", "bXYZ"}, curves{"rTRC", "gTRC", "bTRC"};
  const auto put = [&xy](std::size_t i, const Vec3& v) {
    const double sum = v.x + v.y + v.z;
    xy[2 * i] = v.x / sum, xy[2 * i + 1] = v.y / sum;
    return sum > 0;
  };
  for (std::size_t i = 0; i < 3; ++i) {
    const std::optional<Vec3> v = colorant(profile, colorants[i]);
    if (!v || !put(i, *v)) return {};
    white = white + *v;
  }
  if (!put(3, white)) return {};
  const std::optional<Chromaticities> primaries = usable_primaries(xy);
  if (!primaries) return {};

  const Curve red(find(profile, curves[0]));
  if (!red.good()) return {};
  for (const std::string_view name : curves) {
    const Curve other(find(profile, name));
    if (!other.good() || !fits(other, red)) return {};
  }
  IccColor color{Transfer::linear, 1, *primaries};
  if (fits(red, [](double x) { return x; })) return color;
  color.transfer = Transfer::srgb;
  if (fits(red, srgb_to_linear)) return color;
  // The power through the curve's middle.
  color.transfer = Transfer::gamma;
  color.gamma = std::log(red(0.5)) / std::log(0.5);
  const bool usable = color.gamma > 0.1 && color.gamma < 10;
  if (usable && fits(red, [&](double x) { return std::pow(x, color.gamma); })) return color;
  return {};
}

}  // namespace envconv
