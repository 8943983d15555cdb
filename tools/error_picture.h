// SPDX-License-Identifier: Apache-2.0
// An error map as a picture, with its scale.
#pragma once

#include <string>

#include "image.h"
#include "packing.h"
#include "result.h"

namespace envconv::tool {

/// The errors that the two ends of the colours stand for, with equal ratios in between.
struct ErrorScale {
  static constexpr double decades = 4;
  double low = 1e-4, high = 1;
};
/// A scale whose high end is the largest error, rounded up to 1, 2 or 5 times a power of ten; 1 when there is no error.
ErrorScale error_scale(const EnvImage& errors);

/// The map that error_map() gave, packed, in the colours of scale_color(), and below it a strip with the scale and its
/// numbers.  Linear sRGB, three channels.  What could not be compared is red, what the layout does not own grey.
Result<Image> error_picture(const EnvImage& errors, const Packing& packing, const ErrorScale& scale,
                            const std::string& caption);

}  // namespace envconv::tool
