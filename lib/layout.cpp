// SPDX-License-Identifier: Apache-2.0
#include "layout.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "assertion.h"

namespace envconv {

#define ENVCONV_LAYOUT(symbol, file, name) LayoutKernels layout_kernels_##symbol();
#include "layouts/registry.inc"
#undef ENVCONV_LAYOUT

std::span<const Layout> all_layouts() {
  static const std::vector<Layout> layouts = {
#define ENVCONV_LAYOUT(symbol, file, name) Layout(name, layout_kernels_##symbol()),
#include "layouts/registry.inc"
#undef ENVCONV_LAYOUT
  };
  return layouts;
}

const Layout* find_layout(std::string_view name) {
  for (const Layout& layout : all_layouts())
    if (layout.name() == name) return &layout;
  return nullptr;
}

bool Layout::owns(int face, double u, double v) const {
  ENVCONV_ASSERT(has_face(face));
  switch (info_.domain) {
    case Domain::square: return u >= 0 && u <= 1 && v >= 0 && v <= 1;
    case Domain::disc: return (2 * u - 1) * (2 * u - 1) + (2 * v - 1) * (2 * v - 1) <= 1;
    case Domain::overlap: return u >= 0 && u <= 1 && v >= 0 && v <= 1 && kernels_.owner(face, u, v) == face;
  }
  return false;
}

std::string_view nearest_name(std::string_view word, std::span<const std::string_view> names) {
  std::string_view best;
  std::size_t best_distance = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string_view name : names) {
    // Levenshtein's distance, one row at a time.
    std::vector<std::size_t> row(name.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < word.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i + 1;
      for (std::size_t j = 0; j < name.size(); ++j) {
        const std::size_t replaced = diagonal + (word[i] == name[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
      }
    }
    if (row.back() < best_distance) best_distance = row.back(), best = name;
  }
  return best;
}

}  // namespace envconv
