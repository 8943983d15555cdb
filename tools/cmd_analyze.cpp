// SPDX-License-Identifier: Apache-2.0
// envconv analyze: what the formulas of layouts are worth, in figures and pictures.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "analyze.h"
#include "describe.h"
#include "discrepancy.h"
#include "distortion.h"
#include "io.h"
#include "options.h"
#include "output_file.h"
#include "svg.h"
#include "texel_figures.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

struct AnalyzeOptions {
  int size = 0;             ///< 0: from texels
  std::int64_t texels = 0;  ///< 0: not given
  std::string plot, picture;
  bool json = false;
};

constexpr std::int64_t default_texels = 10000, default_plot_texels = 100000;
/// Bounds of what is measured texel by texel, and of the discrepancy's sum.
constexpr int largest_height = 16384;
constexpr std::int64_t most_points = 20'000'000;
constexpr double degrees = 180 / std::numbers::pi;

// All figures of one layout.
struct Row {
  const Layout* layout;
  LayoutFigures limit;
  int height;
  TexelFigures texels;
  Discrepancy discrepancy;
};

Row measure(const Layout& layout, int height) {
  return {&layout, figures(layout), height, texel_figures(layout, height),
          generalised_discrepancy(texel_centres(layout, height))};
}

ordered_json json_of(const Row& row) {
  const TexelFigures& t = row.texels;
  return {{"name", row.layout->name()},
          {"sampling_requirement", finite_or_null(row.limit.sampling_requirement)},
          {"anisotropy", finite_or_null(row.limit.anisotropy)},
          {"texel_ratio", finite_or_null(row.limit.texel_ratio)},
          {"smallest_texel_limit", row.limit.smallest_texel},
          {"largest_texel_limit", finite_or_null(row.limit.largest_texel)},
          {"size", row.height},
          {"texels", t.stored},
          {"used_texels", t.used},
          {"used_share", static_cast<double>(t.used) / static_cast<double>(t.stored)},
          {"smallest_texel", t.smallest},
          {"largest_texel", t.largest},
          {"mean_distance", degrees * t.mean_distance},
          {"largest_distance", degrees * t.largest_distance},
          {"discrepancy", row.discrepancy.value},
          {"discrepancy_error", row.discrepancy.error}};
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return number_text(value, 3);
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}
std::string scientific(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::vector<std::string> cells_of(const Row& row) {
  const TexelFigures& t = row.texels;
  return {std::string(row.layout->name()),
          fixed(row.limit.sampling_requirement, 3),
          fixed(row.limit.anisotropy, 4),
          fixed(row.limit.texel_ratio, 4),
          std::to_string(row.height),
          std::to_string(t.stored),
          fixed(100 * static_cast<double>(t.used) / static_cast<double>(t.stored), 1) + "%",
          scientific(t.smallest),
          scientific(t.largest),
          fixed(degrees * t.mean_distance, 4),
          fixed(degrees * t.largest_distance, 4),
          scientific(row.discrepancy.value)};
}

// Discrepancy against the number of points, two sizes to each doubling.
Series curve_of(const Layout& layout, std::int64_t most) {
  Series series;
  series.name = layout.name();
  int last = 0;
  for (double texels = 100; texels < 1.001 * static_cast<double>(most); texels *= std::numbers::sqrt2) {
    const int height = height_for_texels(layout, static_cast<std::int64_t>(std::llround(texels)));
    if (height == last) continue;
    last = height;
    const std::vector<Vec3> points = texel_centres(layout, height);
    if (points.empty()) continue;
    series.x.push_back(static_cast<double>(points.size()));
    series.y.push_back(generalised_discrepancy(points, 1e-3).value);
  }
  return series;
}

Result<Ok> write_plot(const std::string& path, const std::vector<const Layout*>& layouts, std::int64_t most) {
  Chart chart;
  chart.title = "Generalised discrepancy of texel centres";
  chart.x.label = "points";
  chart.y.label = "discrepancy";
  chart.x.logarithmic = chart.y.logarithmic = true;
  for (const Layout* layout : layouts) chart.series.push_back(curve_of(*layout, most));
  chart.height = std::max(420, 120 + 22 * static_cast<int>(layouts.size()));
  const std::string text = svg_of(chart);
  ENVCONV_TRY(OutputFile file, OutputFile::create(path));
  file.write(text.data(), text.size());
  return file.commit();
}

Result<Ok> write_picture(const std::string& path, const Layout& layout, int height) {
  WriteOptions write;
  ENVCONV_CHECK(can_write(path, write, 1, 3));
  Result<Image> image = distortion_picture(layout, height);
  if (!image) return Error{image.error().code, path + ": " + image.error().message};
  std::vector<Picture> pictures;
  pictures.push_back({"", std::move(*image), Channels::standard(3), PixelType::half});
  ENVCONV_TRY(const WriteReport report, write_pictures(path, pictures, write));
  for (const std::string& warning : report.warnings) warn(path, warning);
  return Ok{};
}

// Size of what is measured, or what is wrong with it.
Result<int> height_of(const Layout& layout, const AnalyzeOptions& o) {
  const int height = o.size ? o.size : height_for_texels(layout, o.texels ? o.texels : default_texels);
  if (height > largest_height || texel_count(layout, height) > most_points)
    return Error{ErrorCode::limit, std::string(layout.name()) + ": more than " + std::to_string(most_points) +
                                       " texels are not measured one by one (choose a smaller --size or --texels)"};
  return height;
}

int run(const AnalyzeOptions& o, const std::vector<std::string>& names) {
  const Result<std::vector<const Layout*>> chosen = layouts_named(names);
  if (!chosen) return fail(chosen.error());
  if (!o.picture.empty() && names.size() != 1)
    return fail({ErrorCode::usage, "--picture shows one layout (name it: envconv analyze isocube --picture FILE)"});
  if (o.size && o.texels) return fail({ErrorCode::usage, "--size and --texels exclude each other (give one of them)"});
  if (o.texels > most_points)
    return fail({ErrorCode::limit, "--texels goes up to " + std::to_string(most_points) + " here"});
  std::vector<int> heights;
  for (const Layout* layout : *chosen) {
    const Result<int> height = height_of(*layout, o);
    if (!height) return fail(height.error());
    heights.push_back(*height);
  }
  ordered_json list = ordered_json::array();
  std::vector<std::vector<std::string>> rows{{"name", "sampling", "anisotropy", "texel ratio", "size", "texels", "used",
                                              "smallest sr", "largest sr", "mean deg", "largest deg", "discrepancy"}};
  for (std::size_t i = 0; i < chosen->size(); ++i) {
    const Row row = measure(*(*chosen)[i], heights[i]);
    if (o.json) {
      list.push_back(json_of(row));
    } else {
      rows.push_back(cells_of(row));
    }
  }
  if (!o.plot.empty()) {
    const Result<Ok> written = write_plot(o.plot, *chosen, o.texels ? o.texels : default_plot_texels);
    if (!written) return fail(written.error());
  }
  if (!o.picture.empty()) {
    const Result<Ok> written = write_picture(o.picture, *chosen->front(), 384);
    if (!written) return fail(written.error());
  }
  print(o.json ? ordered_json{{"layouts", list}}.dump(2) + "\n" : table(rows));
  return 0;
}

}  // namespace

Command analyze_command() {
  auto options = std::make_shared<AnalyzeOptions>();
  Command command{
      .name = "analyze",
      .summary = "figures of layouts: distortion, texels, evenness",
      .operands = "[LAYOUT...]",
      .description =
          "Measures layouts from their formulas, all of them or the ones named.  In the limit of many texels, to "
          "five digits: the sampling requirement (texels in proportion to it keep the same worst-case detail), the "
          "largest anisotropy (largest over smallest stretch), and the largest over the smallest solid angle of a "
          "texel.  At one size: the share of the stored texels whose centre the layout owns, the solid angles, in "
          "steradians, of the smallest and the largest texel, the mean and the largest angle between the centres of "
          "neighbours, in degrees and over seams too, and the generalised discrepancy of the centres, which is the "
          "smaller the more evenly they are spread; --json adds the bound of its error.",
      .operand_choices = layout_names()};
  auto add = [&](std::string group, Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), std::move(group), std::move(initial)));
  };
  add("Measurement",
      integer_option("--size", "N", options->size, 1, largest_height, "height of a face in texels, for all layouts"));
  add("Measurement",
      count_option(
          "--texels", "N", options->texels, std::int64_t{1} << 40,
          "instead of --size: the largest size whose faces together hold at most N texels; --plot goes up to N"),
      "10k, and 100k for --plot");
  add("Output", text_option("--plot", "FILE.svg", options->plot,
                            "draw the discrepancy against the number of points, both logarithmic, as SVG"));
  add("Output", text_option("--picture", "FILE", options->picture,
                            "of one layout: heat maps of its anisotropy and of its density (solid angle per area, "
                            "relative to the mean) over the faces, with the pictures of equal small circles"));
  add("General", switch_option("--json", options->json, "one JSON object on stdout"));
  command.run = [options](const std::vector<std::string>& names) { return run(*options, names); };
  return command;
}

}  // namespace envconv::tool
