// SPDX-License-Identifier: Apache-2.0
#include "stored_pixels.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>

#include "row_kernels.h"

namespace envconv {

StoredPixels stored_pixels(const Picture& picture, const WriteOptions& options, WriteReport& report) {
  const Image& image = picture.image;
  StoredPixels pixels{image.width(), image.height(), image.channels(), picture.channels.alpha, report.type, {}};
  if (is_integer(report.type)) {
    pixels.owned = to_elements(picture, report.type, options.encoding, report);
  } else if (report.type == PixelType::half) {
    HalfCounts odd;
    pixels.owned.reset(std::malloc(image.value_count() * 2));
    if (!pixels.owned) throw std::bad_alloc();
    floats_to_halves(image.data(), image.value_count(), static_cast<std::uint16_t*>(pixels.owned.get()), odd);
    report.nonfinite += odd.nonfinite;
    report.clamped_high += odd.high;
  } else {
    report.nonfinite +=
        std::count_if(image.data(), image.data() + image.value_count(), [](float v) { return !std::isfinite(v); });
  }
  pixels.data = pixels.owned ? pixels.owned.get() : image.data();
  return pixels;
}

}  // namespace envconv
