// SPDX-License-Identifier: Apache-2.0
#include "discrepancy_kernels.h"

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "discrepancy_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
//
#include "hwy/contrib/math/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;

// 1 + |a - b_j| / 2 for a vector of points.
struct Point {
  V x, y, z;
};
HWY_INLINE Point broadcast(const PointArrays& a, std::size_t i) {
  const D d;
  return {hn::Set(d, a.x[i]), hn::Set(d, a.y[i]), hn::Set(d, a.z[i])};
}
HWY_INLINE V factor(const Point& a, V x, V y, V z) {
  const D d;
  const V dx = hn::Sub(a.x, x), dy = hn::Sub(a.y, y), dz = hn::Sub(a.z, z);
  const V square = hn::MulAdd(dz, dz, hn::MulAdd(dy, dy, hn::Mul(dx, dx)));
  return hn::MulAdd(hn::Sqrt(square), hn::Set(d, 0.5), hn::Set(d, 1.0));
}

// A sum of logarithms is the logarithm of a product: factors are in [1, 2], so a thousand of them stay below 2^1023.
double log_distance_sum_impl(const PointArrays& a, const PointArrays& b) {
  const D d;
  const std::size_t lanes = hn::Lanes(d), whole = b.count - b.count % lanes;
  const V one = hn::Set(d, 1.0);
  V product0 = one, product1 = one, sum = hn::Zero(d);
  const auto flush = [&]() HWY_ATTR {
    sum = hn::Add(sum, hn::Add(hn::Log(d, product0), hn::Log(d, product1)));
    product0 = product1 = one;
  };
  const auto mask = hn::FirstN(d, b.count - whole);
  int factors = 0;
  for (std::size_t i = 0; i < a.count; ++i) {
    const Point p = broadcast(a, i);
    for (std::size_t j = 0; j < whole;) {
      const std::size_t end = whole - j < 512 * lanes ? whole : j + 512 * lanes;
      if (factors > 480) {
        flush();
        factors = 0;
      }
      factors += static_cast<int>((end - j) / lanes);  // at most half of them go into one product, or one more
      for (; j + lanes < end; j += 2 * lanes) {
        product0 = hn::Mul(product0, factor(p, hn::LoadU(d, b.x + j), hn::LoadU(d, b.y + j), hn::LoadU(d, b.z + j)));
        product1 = hn::Mul(product1, factor(p, hn::LoadU(d, b.x + j + lanes), hn::LoadU(d, b.y + j + lanes),
                                            hn::LoadU(d, b.z + j + lanes)));
      }
      if (j < end) {
        product0 = hn::Mul(product0, factor(p, hn::LoadU(d, b.x + j), hn::LoadU(d, b.y + j), hn::LoadU(d, b.z + j)));
        j += lanes;
      }
    }
    if (whole == b.count) continue;
    if (factors > 480) {
      flush();
      factors = 0;
    }
    const V last = factor(p, hn::MaskedLoad(mask, d, b.x + whole), hn::MaskedLoad(mask, d, b.y + whole),
                          hn::MaskedLoad(mask, d, b.z + whole));
    product1 = hn::Mul(product1, hn::IfThenElse(mask, last, one));
    ++factors;
  }
  flush();
  return hn::GetLane(hn::SumOfLanes(d, sum));
}

double weighted_log_distance_sum_impl(const PointArrays& a, const PointArrays& b) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  double total = 0;
  for (std::size_t i = 0; i < a.count; ++i) {
    const Point p = broadcast(a, i);
    V sum = hn::Zero(d);
    for (std::size_t j = 0; j < b.count; j += lanes) {
      const auto mask = hn::FirstN(d, b.count - j < lanes ? b.count - j : lanes);
      const V f = factor(p, hn::MaskedLoad(mask, d, b.x + j), hn::MaskedLoad(mask, d, b.y + j),
                         hn::MaskedLoad(mask, d, b.z + j));
      sum = hn::MulAdd(hn::MaskedLoad(mask, d, b.weight + j), hn::Log(d, f), sum);
    }
    total += a.weight[i] * hn::GetLane(hn::SumOfLanes(d, sum));
  }
  return total;
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {
HWY_EXPORT(log_distance_sum_impl);
HWY_EXPORT(weighted_log_distance_sum_impl);

double log_distance_sum(const PointArrays& a, const PointArrays& b) {
  return HWY_DYNAMIC_DISPATCH(log_distance_sum_impl)(a, b);
}
double weighted_log_distance_sum(const PointArrays& a, const PointArrays& b) {
  return HWY_DYNAMIC_DISPATCH(weighted_log_distance_sum_impl)(a, b);
}
}  // namespace envconv
#endif
