// SPDX-License-Identifier: Apache-2.0
// The vocabulary in which kernels are written, for double (the reference) and for Jet (automatic differentiation).
// lane-inl.h gives the same words, with the same signatures, to SIMD lanes.
//
//   + - * /  unary -  < <= > >=  abs min max sqrt floor copysign select
//   sincos_turns(t, s, c)   sine and cosine of 2 pi t, any t of moderate size
//   atan2_turns(y, x)       angle in turns, (-1/2, 1/2]; 0 for (0, 0)
//   exp(x), atanh(x)        |x| <= 2 and |x| <= 0.75 in lanes
//   lookup(table, i)        entry i (a whole number in F) of a Table
//   named(x, "name")        x; gives generated code its author's names
#pragma once

#include <cmath>
#include <cstddef>
#include <numbers>

namespace envconv {

inline constexpr double pi = std::numbers::pi;

/// Constants that kernels select by a computed index, in both precisions.
template <std::size_t N>
struct Table {
  double d[N]{};
  float f[(N + 15) / 16 * 16]{};  // whole vectors
  constexpr Table() = default;
  template <class... T>
  constexpr explicit Table(T... values) : d{static_cast<double>(values)...}, f{static_cast<float>(values)...} {}
  constexpr void set(std::size_t i, double value) { d[i] = value, f[i] = static_cast<float>(value); }
};

// --- double ---------------------------------------------------------------------------------------------------------
inline double abs(double x) { return std::fabs(x); }
inline double min(double a, double b) { return a < b ? a : b; }
inline double max(double a, double b) { return a > b ? a : b; }
inline double sqrt(double x) { return std::sqrt(x); }
inline double floor(double x) { return std::floor(x); }
inline double copysign(double magnitude, double sign) { return std::copysign(magnitude, sign); }
inline double select(bool condition, double yes, double no) { return condition ? yes : no; }
inline double exp(double x) { return std::exp(x); }
inline double atanh(double x) { return std::atanh(x); }
inline double named(double x, const char*) { return x; }
template <std::size_t N>
double lookup(const Table<N>& table, double i) {
  return table.d[static_cast<std::size_t>(i)];
}
inline void sincos_turns(double t, double& s, double& c) {
  // Quarter turns come off first, so that axes are exact.
  const double quarter = std::floor(4.0 * t + 0.5);
  const double r = 2.0 * pi * (t - 0.25 * quarter);
  const double s0 = std::sin(r), c0 = std::cos(r);
  switch (static_cast<int>(quarter) & 3) {
    case 0: s = s0, c = c0; break;
    case 1: s = c0, c = -s0; break;
    case 2: s = -s0, c = -c0; break;
    default: s = -c0, c = s0; break;
  }
}
inline double atan2_turns(double y, double x) { return std::atan2(y, x) / (2.0 * pi); }

// --- Jet: a value with its derivatives with respect to u and v
// --------------------------------------------------------
struct Jet {
  double v = 0, du = 0, dv = 0;
  Jet() = default;
  Jet(double value) : v(value) {}  // NOLINT: constants convert
  Jet(double value, double by_u, double by_v) : v(value), du(by_u), dv(by_v) {}

  friend Jet operator+(Jet a, Jet b) { return {a.v + b.v, a.du + b.du, a.dv + b.dv}; }
  friend Jet operator-(Jet a, Jet b) { return {a.v - b.v, a.du - b.du, a.dv - b.dv}; }
  friend Jet operator-(Jet a) { return {-a.v, -a.du, -a.dv}; }
  friend Jet operator*(Jet a, Jet b) { return {a.v * b.v, a.du * b.v + a.v * b.du, a.dv * b.v + a.v * b.dv}; }
  friend Jet operator/(Jet a, Jet b) {
    const double q = a.v / b.v;
    return {q, (a.du - q * b.du) / b.v, (a.dv - q * b.dv) / b.v};
  }
  friend bool operator<(Jet a, Jet b) { return a.v < b.v; }
  friend bool operator<=(Jet a, Jet b) { return a.v <= b.v; }
  friend bool operator>(Jet a, Jet b) { return a.v > b.v; }
  friend bool operator>=(Jet a, Jet b) { return a.v >= b.v; }
  friend Jet abs(Jet a) { return std::signbit(a.v) ? -a : a; }
  friend Jet min(Jet a, Jet b) { return a.v < b.v ? a : b; }
  friend Jet max(Jet a, Jet b) { return a.v > b.v ? a : b; }
  friend Jet sqrt(Jet a) {
    const double r = std::sqrt(a.v);
    const double d = r > 0 ? 0.5 / r : 0.0;  // the root's kink at 0 gets no slope
    return {r, d * a.du, d * a.dv};
  }
  friend Jet floor(Jet a) { return {std::floor(a.v)}; }
  friend Jet copysign(Jet magnitude, Jet sign) {
    return std::signbit(magnitude.v) == std::signbit(sign.v) ? magnitude : -magnitude;
  }
  friend Jet select(bool condition, Jet yes, Jet no) { return condition ? yes : no; }
  friend Jet exp(Jet a) {
    const double e = std::exp(a.v);
    return {e, e * a.du, e * a.dv};
  }
  friend Jet atanh(Jet a) {
    const double d = 1.0 / (1.0 - a.v * a.v);
    return {std::atanh(a.v), d * a.du, d * a.dv};
  }
  friend Jet named(Jet a, const char*) { return a; }
  template <std::size_t N>
  friend Jet lookup(const Table<N>& table, Jet i) {
    return {table.d[static_cast<std::size_t>(i.v)]};
  }
  friend void sincos_turns(Jet t, Jet& s, Jet& c) {
    double s0, c0;
    envconv::sincos_turns(t.v, s0, c0);
    const double d = 2.0 * pi;
    s = {s0, d * c0 * t.du, d * c0 * t.dv};
    c = {c0, -d * s0 * t.du, -d * s0 * t.dv};
  }
  friend Jet atan2_turns(Jet y, Jet x) {
    const double r2 = x.v * x.v + y.v * y.v;
    const double d = r2 > 0 ? 1.0 / (2.0 * pi * r2) : 0.0;
    return {envconv::atan2_turns(y.v, x.v), d * (x.v * y.du - y.v * x.du), d * (x.v * y.dv - y.v * x.dv)};
  }
};

}  // namespace envconv
