// SPDX-License-Identifier: Apache-2.0
#include "to_linear.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "io_shared.h"

namespace envconv {
namespace {

using Curve = std::function<double(double)>;

Curve curve_of(const FileSpec& spec) {
  switch (spec.transfer) {
    case Transfer::srgb: return srgb_to_linear;
    case Transfer::gamma:
      return [gamma = static_cast<double>(spec.gamma)](double v) { return std::pow(std::max(v, 0.0), gamma); };
    default: return [](double v) { return v; };
  }
}

// Where a stored texel is shown, in an image of that size.
void place(int orientation, int width, int height, int column, int row, int& x, int& y) {
  switch (orientation) {
    case 2: x = width - 1 - column, y = row; break;
    case 3: x = width - 1 - column, y = height - 1 - row; break;
    case 4: x = column, y = height - 1 - row; break;
    case 5: x = row, y = column; break;
    case 6: x = width - 1 - row, y = column; break;
    case 7: x = width - 1 - row, y = height - 1 - column; break;
    case 8: x = row, y = height - 1 - column; break;
    default: x = column, y = row;
  }
}

}  // namespace

bool ToLinear::is_identity(const PictureSpec& picture, const FileSpec& spec, bool drop_alpha) {
  return picture.element == PixelType::float32 && spec.orientation == 1 && !drop_alpha &&
         spec.transfer == Transfer::linear && (picture.channels.alpha < 0 || !spec.unassociated);
}

ToLinear::ToLinear(const PictureSpec& picture, const FileSpec& spec, bool drop_alpha)
    : picture_(picture), spec_(spec), drop_alpha_(drop_alpha), curve_(curve_of(spec)) {
  if (picture.element != PixelType::uint8 && picture.element != PixelType::uint16) return;
  const int top = picture.element == PixelType::uint8 ? 255 : 65535;
  scale_ = 1 / static_cast<float>(top);
  for (int i = 0; i <= top; ++i) table_.push_back(static_cast<float>(curve_(static_cast<double>(i) / top)));
}

void ToLinear::rows(const void* elements, int first, int count, Image& image) const {
  const std::size_t values =
      static_cast<std::size_t>(picture_.width) * static_cast<std::size_t>(picture_.channels.count());
  const bool plain = !table_.empty() && picture_.channels.alpha < 0 && spec_.orientation == 1;
  const auto look_up = [&](const auto* from, float* to) {
    for (std::size_t i = 0; i < values; ++i) to[i] = table_[from[i]];
  };
  tbb::parallel_for(0, count, [&](int i) {
    const std::size_t begin = static_cast<std::size_t>(i) * values;
    if (!plain) return row(elements, begin, first + i, image);
    if (picture_.element == PixelType::uint8)
      return look_up(static_cast<const std::uint8_t*>(elements) + begin, image.row(first + i));
    return look_up(static_cast<const std::uint16_t*>(elements) + begin, image.row(first + i));
  });
}

// One stored row, whose elements begin there.
void ToLinear::row(const void* elements, std::size_t begin, int number, Image& image) const {
  const int channels = picture_.channels.count(), alpha = picture_.channels.alpha;
  const bool curved = spec_.transfer != Transfer::linear;
  for (int column = 0; column < picture_.width; ++column) {
    const std::size_t at = begin + static_cast<std::size_t>(column) * static_cast<std::size_t>(channels);
    int x = 0, y = 0;
    place(spec_.orientation, image.width(), image.height(), column, number, x, y);
    float* to = image.at(x, y);
    const auto raw = [&](int c) -> std::uint32_t {
      return picture_.element == PixelType::uint8
                 ? static_cast<const std::uint8_t*>(elements)[at + static_cast<std::size_t>(c)]
                 : static_cast<const std::uint16_t*>(elements)[at + static_cast<std::size_t>(c)];
    };
    const auto fraction = [&](int c) {
      return table_.empty() ? static_cast<const float*>(elements)[at + static_cast<std::size_t>(c)]
                            : static_cast<float>(raw(c)) * scale_;
    };
    const float a = alpha >= 0 ? fraction(alpha) : 1.f;
    for (int c = 0; c < channels; ++c) {
      if (c == alpha) {
        if (!drop_alpha_) *to++ = a;
      } else if (alpha >= 0 && !drop_alpha_ && !spec_.unassociated && curved) {
        // Colour times alpha was put through the curve as a product; take alpha off first.
        *to++ = a > 0 ? static_cast<float>(curve_(static_cast<double>(fraction(c)) / a)) * a : 0.f;
      } else {
        const float v = !table_.empty() ? table_[raw(c)]
                        : curved        ? static_cast<float>(curve_(fraction(c)))
                                        : fraction(c);
        *to++ = alpha >= 0 && !drop_alpha_ && spec_.unassociated ? v * a : v;
      }
    }
  }
}

}  // namespace envconv
