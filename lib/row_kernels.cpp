// SPDX-License-Identifier: Apache-2.0
#include "row_kernels.h"

#include <algorithm>
#include <numeric>

#include "assertion.h"

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "row_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;
using Words = hn::RebindToSigned<Floats>;  // the bits of floats without their sign, so signed comparisons do
using Halves = hn::Rebind<std::uint16_t, Words>;

constexpr std::int32_t kBias = 127 - 15;             // between the exponents of the types
constexpr std::int32_t kInfinity = 0x7F800000;       // as a float
constexpr std::int32_t kLargest = 0x477FE000;        // 65504
constexpr std::int32_t kTooHigh = 0x477FF000;        // 65520, halfway to what would come next
constexpr std::int32_t kNormal = (kBias + 1) << 23;  // 2^-14, the least with a whole mantissa
constexpr int kDropped = 13;                         // mantissa bits that half does not have

// Calls f(index, rest) for whole vectors of a row, and at last with what is left.
template <class F>
HWY_INLINE void for_vectors(std::size_t count, std::size_t lanes, F&& f) {
  for (std::size_t i = 0; i < count; i += lanes) f(i, std::min(lanes, count - i));
}

void floats_to_halves_impl(const float* from, std::size_t count, std::uint16_t* to, HalfCounts& counts) {
  const Floats df;
  const Words d;
  const Halves dh;
  const std::size_t lanes = hn::Lanes(d);
  // The sum with this has half's smallest step, 2^-24, as its own: the addition rounds.
  const auto half = hn::Set(df, 0.5f);
  const auto one = hn::Set(d, 1);
  std::size_t beyond = 0, nonfinite = 0;
  const auto convert = [&](const float* in, std::uint16_t* out) HWY_ATTR {
    const auto bits = hn::BitCast(d, hn::LoadU(df, in));
    const auto size = hn::And(bits, hn::Set(d, 0x7FFFFFFF));
    const auto is_nan = hn::Gt(size, hn::Set(d, kInfinity));
    beyond += hn::CountTrue(d, hn::Gt(size, hn::Set(d, kTooHigh - 1)));
    nonfinite += hn::CountTrue(d, hn::Gt(size, hn::Set(d, kInfinity - 1)));
    const auto kept = hn::IfThenZeroElse(is_nan, hn::Min(size, hn::Set(d, kLargest)));
    const auto denormal = hn::Sub(hn::BitCast(d, hn::Add(hn::BitCast(df, kept), half)), hn::BitCast(d, half));
    const auto even = hn::And(hn::ShiftRight<kDropped>(kept), one);
    const auto normal =
        hn::ShiftRight<kDropped>(hn::Add(kept, hn::Add(even, hn::Set(d, (1 << (kDropped - 1)) - 1 - (kBias << 23)))));
    const auto sign = hn::And(hn::ShiftRight<16>(bits), hn::IfThenZeroElse(is_nan, hn::Set(d, 0x8000)));
    const auto code = hn::Or(hn::IfThenElse(hn::Lt(kept, hn::Set(d, kNormal)), denormal, normal), sign);
    hn::StoreU(hn::DemoteTo(dh, code), dh, out);
  };
  for_vectors(count, lanes, [&](std::size_t i, std::size_t rest) HWY_ATTR {
    if (rest == lanes) return convert(from + i, to + i);
    float in[hn::MaxLanes(df)] = {};
    std::uint16_t out[hn::MaxLanes(df)];
    std::copy_n(from + i, rest, in);
    convert(in, out);
    std::copy_n(out, rest, to + i);
  });
  counts.high += static_cast<std::int64_t>(beyond - nonfinite);
  counts.nonfinite += static_cast<std::int64_t>(nonfinite);
}

void halves_to_floats_impl(const std::uint16_t* from, std::size_t count, float* to) {
  const Floats df;
  const Words d;
  const Halves dh;
  const std::size_t lanes = hn::Lanes(d);
  const auto bias = hn::Set(d, kBias << 23);
  const auto convert = [&](const std::uint16_t* in, float* out) HWY_ATTR {
    const auto code = hn::PromoteTo(d, hn::LoadU(dh, in));
    const auto sign = hn::ShiftLeft<16>(hn::And(code, hn::Set(d, 0x8000)));
    const auto shifted = hn::ShiftLeft<kDropped>(hn::And(code, hn::Set(d, 0x7FFF)));
    const auto finite = hn::Lt(shifted, hn::Set(d, 31 << 23));
    const auto normal = hn::Add(hn::Add(shifted, bias), hn::IfThenZeroElse(finite, bias));
    // With the exponent of 2^-14 there would be a leading 1, which is taken off again.
    const auto least = hn::Set(d, kNormal);
    const auto denormal = hn::Sub(hn::BitCast(df, hn::Add(shifted, least)), hn::BitCast(df, least));
    const auto value = hn::IfThenElse(hn::Lt(shifted, hn::Set(d, 1 << 23)), hn::BitCast(d, denormal), normal);
    hn::StoreU(hn::BitCast(df, hn::Or(value, sign)), df, out);
  };
  for_vectors(count, lanes, [&](std::size_t i, std::size_t rest) HWY_ATTR {
    if (rest == lanes) return convert(from + i, to + i);
    std::uint16_t in[hn::MaxLanes(df)] = {};
    float out[hn::MaxLanes(df)];
    std::copy_n(from + i, rest, in);
    convert(in, out);
    std::copy_n(out, rest, to + i);
  });
}

void split_bytes_impl(const std::uint8_t* from, std::size_t count, std::uint8_t* to) {
  if (count == 0) return;
  const std::size_t evens = (count + 1) / 2;
  to[0] = from[0];
  if (count > 1) to[evens] = static_cast<std::uint8_t>(from[1] - from[2 * (evens - 1)] + 128);
  std::size_t i = 2;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<std::uint8_t> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto middle = hn::Set(d, 128);
  for (; i + 2 * lanes <= count; i += 2 * lanes) {
    const auto difference = [&](std::size_t at) HWY_ATTR {
      return hn::Add(hn::Sub(hn::LoadU(d, from + at), hn::LoadU(d, from + at - 2)), middle);
    };
    const auto low = difference(i), high = difference(i + lanes);
    hn::StoreU(hn::ConcatEven(d, high, low), d, to + i / 2);
    hn::StoreU(hn::ConcatOdd(d, high, low), d, to + evens + i / 2);
  }
#endif
  for (; i < count; ++i) {
    to[(i % 2 == 0 ? 0 : evens) + i / 2] = static_cast<std::uint8_t>(from[i] - from[i - 2] + 128);
  }
}

#if HWY_TARGET != HWY_SCALAR
// Running sums of 16 bytes.
template <class D, class V>
HWY_INLINE V running_sums(D d, V v) {
  v = hn::Add(v, hn::ShiftLeftBytes<1>(d, v));
  v = hn::Add(v, hn::ShiftLeftBytes<2>(d, v));
  v = hn::Add(v, hn::ShiftLeftBytes<4>(d, v));
  return hn::Add(v, hn::ShiftLeftBytes<8>(d, v));
}
#endif

void join_bytes_impl(const std::uint8_t* from, std::size_t count, std::uint8_t* to) {
  const std::size_t evens = (count + 1) / 2, odds = count / 2;
  const std::uint8_t* second = from + evens;
  // Sums modulo 256, so that 128 may be added for being taken off.  The first byte is no difference.
  std::uint8_t even = 128;
  const auto sum = std::accumulate(from, second, std::uint32_t{0});
  auto odd = static_cast<std::uint8_t>(even + sum + 128 * evens);
  std::size_t k = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::FixedTag<std::uint8_t, 16> d;
  constexpr std::size_t lanes = 16;
  const auto middle = hn::Set(d, 128), last = hn::Set(d, 15);
  auto even_before = hn::Set(d, even), odd_before = hn::Set(d, odd);
  for (; k + lanes <= odds; k += lanes) {
    const auto e = hn::Add(running_sums(d, hn::Xor(hn::LoadU(d, from + k), middle)), even_before);
    const auto o = hn::Add(running_sums(d, hn::Xor(hn::LoadU(d, second + k), middle)), odd_before);
    even_before = hn::TableLookupBytes(e, last);
    odd_before = hn::TableLookupBytes(o, last);
    hn::StoreU(hn::InterleaveLower(d, e, o), d, to + 2 * k);
    hn::StoreU(hn::InterleaveUpper(d, e, o), d, to + 2 * k + lanes);
  }
  even = hn::GetLane(even_before), odd = hn::GetLane(odd_before);
#endif
  for (; k < evens; ++k) {
    to[2 * k] = even = static_cast<std::uint8_t>(even + from[k] + 128);
    if (k < odds) to[2 * k + 1] = odd = static_cast<std::uint8_t>(odd + second[k] + 128);
  }
}

template <int inner>
void multiply_transposed_of(int rows, int columns, MatrixView<const double> a, MatrixView<const double> b,
                            MatrixView<double> out) {
  int x = 0;
#if HWY_HAVE_FLOAT64
  const hn::ScalableTag<double> d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (; x + lanes <= columns; x += lanes) {
    hn::Vec<decltype(d)> column[inner];
    for (std::size_t k = 0; k < inner; ++k) column[k] = hn::LoadU(d, b.values + k * b.step + x);
    for (int y = 0; y < rows; ++y) {
      auto sum = hn::Mul(hn::Set(d, a.values[y]), column[0]);
      for (std::size_t k = 1; k < inner; ++k) sum = hn::MulAdd(hn::Set(d, a.values[k * a.step + y]), column[k], sum);
      hn::StoreU(sum, d, out.values + static_cast<std::size_t>(y) * out.step + x);
    }
  }
#endif
  for (; x < columns; ++x)
    for (int y = 0; y < rows; ++y) {
      double sum = 0;
      for (std::size_t k = 0; k < inner; ++k) sum += a.values[k * a.step + y] * b.values[k * b.step + x];
      out.values[static_cast<std::size_t>(y) * out.step + x] = sum;
    }
}

void multiply_transposed_impl(int rows, int inner, int columns, MatrixView<const double> a, MatrixView<const double> b,
                              MatrixView<double> out) {
  static_assert(most_inner == 8);
  constexpr decltype(&multiply_transposed_of<1>) of[most_inner] = {
      multiply_transposed_of<1>, multiply_transposed_of<2>, multiply_transposed_of<3>, multiply_transposed_of<4>,
      multiply_transposed_of<5>, multiply_transposed_of<6>, multiply_transposed_of<7>, multiply_transposed_of<8>};
  of[inner - 1](rows, columns, a, b, out);
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {
HWY_EXPORT(floats_to_halves_impl);
HWY_EXPORT(halves_to_floats_impl);
HWY_EXPORT(split_bytes_impl);
HWY_EXPORT(join_bytes_impl);
HWY_EXPORT(multiply_transposed_impl);

void floats_to_halves(const float* from, std::size_t count, std::uint16_t* to, HalfCounts& counts) {
  HWY_DYNAMIC_DISPATCH(floats_to_halves_impl)(from, count, to, counts);
}
void halves_to_floats(const std::uint16_t* from, std::size_t count, float* to) {
  HWY_DYNAMIC_DISPATCH(halves_to_floats_impl)(from, count, to);
}
void split_bytes(const std::uint8_t* from, std::size_t count, std::uint8_t* to) {
  HWY_DYNAMIC_DISPATCH(split_bytes_impl)(from, count, to);
}
void join_bytes(const std::uint8_t* from, std::size_t count, std::uint8_t* to) {
  HWY_DYNAMIC_DISPATCH(join_bytes_impl)(from, count, to);
}
void multiply_transposed(int rows, int inner, int columns, MatrixView<const double> a, MatrixView<const double> b,
                         MatrixView<double> out) {
  ENVCONV_ASSERT(inner >= 1 && inner <= most_inner);
  HWY_DYNAMIC_DISPATCH(multiply_transposed_impl)(rows, inner, columns, a, b, out);
}
}  // namespace envconv
#endif
