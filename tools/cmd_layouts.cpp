// SPDX-License-Identifier: Apache-2.0
// envconv layouts: the table of layouts, from the registry and from measurement.
#include <memory>
#include <nlohmann/json.hpp>

#include "describe.h"
#include "options.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

ordered_json json_of(const Layout& layout) {
  const LayoutInfo& info = layout.info();
  const LayoutFigures& measured = figures(layout);
  ordered_json faces = ordered_json::array();
  for (const Face& face : info.faces) {
    faces.push_back({{"name", face.name}, {"aspect", face.aspect}, {"scale", face.scale}});
  }
  return {{"name", layout.name()},
          {"title", info.title},
          {"faces", faces},
          {"packing", default_packing(layout).name},
          {"equal_area", info.equal_area},
          {"conformal", info.conformal},
          {"placement", info.placement == Placement::centre ? "centre" : "inclusive"},
          {"sampling_requirement", finite_or_null(measured.sampling_requirement)},
          {"anisotropy", finite_or_null(measured.anisotropy)},
          {"texel_ratio", finite_or_null(measured.texel_ratio)},
          {"source", info.source}};
}

std::string details(const Layout& layout) {
  const LayoutInfo& info = layout.info();
  std::string faces;
  for (const Face& face : info.faces) faces += (faces.empty() ? "" : " ") + std::string(face.name);
  std::string out = "\n" + std::string(layout.name()) + ": " + std::string(info.title) + "\n";
  if (info.faces.size() > 1) out += "  faces: " + wrapped(faces, 9, 79) + "\n";
  out += "  source: " + wrapped(info.source, 10, 79) + "\n";
  if (!info.notes.empty()) out += "  " + wrapped(info.notes, 2, 79) + "\n";
  return out;
}

int run(bool as_json, const std::vector<std::string>& names) {
  const Result<std::vector<const Layout*>> chosen = layouts_named(names);
  if (!chosen) return fail(chosen.error());
  if (as_json) {
    ordered_json list = ordered_json::array();
    for (const Layout* layout : *chosen) list.push_back(json_of(*layout));
    print(ordered_json{{"layouts", list}}.dump(2) + "\n");
    return 0;
  }
  std::vector<std::vector<std::string>> rows{layout_columns()};
  for (const Layout* layout : *chosen) rows.push_back(layout_row(*layout));
  print(table(rows));
  if (!names.empty()) {
    for (const Layout* layout : *chosen) print(details(*layout));
  }
  return 0;
}

}  // namespace

Command layouts_command() {
  auto json = std::make_shared<bool>(false);
  Command command{.name = "layouts",
                  .summary = "the table of layouts, or more about some",
                  .operands = "[NAME...]",
                  .description =
                      "Prints for each layout its faces, their aspect ratio, the default packing, whether "
                      "it is equal-area or conformal, its sampling requirement (texels in proportion to it "
                      "keep the same worst-case detail), its largest anisotropy, and its source.  The "
                      "figures are measured from the formulas.",
                  .operand_choices = layout_names()};
  command.options.push_back(in_group(switch_option("--json", *json, "one JSON object on stdout"), "General"));
  command.run = [json](const std::vector<std::string>& names) { return run(*json, names); };
  return command;
}

}  // namespace envconv::tool
