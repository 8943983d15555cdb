// SPDX-License-Identifier: Apache-2.0
// The memory that a reader's child and its caller share: where pixels lie in it.  Internal: not installed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder.h"

namespace envconv {

/// Where whole pictures lie: each on its own pages.
struct PicturesPlan {
  std::size_t bytes = 0;  ///< of the mapping
  std::vector<std::size_t> offsets;
};

inline PicturesPlan plan_of(const FileSpec& spec) {
  PicturesPlan plan;
  for (const PictureSpec& picture : spec.pictures) {
    plan.offsets.push_back(plan.bytes);
    plan.bytes += bytes_of(picture);
  }
  return plan;
}

/// For pictures that go elsewhere, the memory that both sides share: two places, each for the largest band of rows of
/// all pictures, so that one band is decoded while the one before is copied.
struct SharedWindow {
  std::size_t place = 0;  ///< bytes
  explicit SharedWindow(const FileSpec& spec) {
    for (const PictureSpec& picture : spec.pictures) {
      const std::size_t bytes = bytes_of_rows(picture, rows_at_a_time(picture));
      place = std::max(place, (bytes + 65535) / 65536 * 65536);
      two = two || picture.band > 0 || spec.pictures.size() > 1;
    }
  }
  std::size_t bytes() const { return two ? 2 * place : place; }
  /// Where the band goes that is asked for as the `turn`th, from 0.
  std::size_t offset(std::int64_t turn) const { return two && turn % 2 ? place : 0; }

 private:
  bool two = false;
};

}  // namespace envconv
