// SPDX-License-Identifier: Apache-2.0
#include "describe.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "options.h"
#include "text.h"

namespace envconv::tool {

std::string aspect_text(const Layout& layout) {
  std::vector<std::string> seen;
  for (const Face& face : layout.info().faces) {
    const std::string text = number_text(face.aspect, 4) + ":1";
    if (std::find(seen.begin(), seen.end(), text) == seen.end()) seen.push_back(text);
  }
  const std::vector<std::string_view> views(seen.begin(), seen.end());
  return joined(views, " ");
}

std::vector<std::string> layout_columns() {
  return {"name", "faces", "aspect", "packing", "equal-area", "conformal", "sampling", "anisotropy", "source"};
}

std::vector<std::string> layout_row(const Layout& layout) {
  const LayoutInfo& info = layout.info();
  const LayoutFigures& measured = figures(layout);
  return {std::string(layout.name()),
          std::to_string(info.faces.size()),
          aspect_text(layout),
          std::string(default_packing(layout).name),
          info.equal_area ? "yes" : "no",
          info.conformal ? "yes" : "no",
          number_text(measured.sampling_requirement, 4),
          number_text(measured.anisotropy, 3),
          std::string(info.source)};
}

Result<std::vector<const Layout*>> layouts_named(const std::vector<std::string>& names) {
  std::vector<const Layout*> chosen;
  for (const std::string& name : names) {
    const Layout* layout = find_layout(name);
    if (!layout) {
      return Error{ErrorCode::usage, "no layout is called '" + name + "'" + did_you_mean(name, layout_names()) +
                                         " (see 'envconv layouts' for all)"};
    }
    chosen.push_back(layout);
  }
  if (chosen.empty()) {
    for (const Layout& layout : all_layouts()) chosen.push_back(&layout);
  }
  return chosen;
}

nlohmann::ordered_json finite_or_null(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json();
}

}  // namespace envconv::tool
