// SPDX-License-Identifier: Apache-2.0
// The figures of a comparison by name: in tables, in JSON, and as thresholds.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "command.h"
#include "metrics.h"

namespace envconv::tool {

/// One figure of ErrorFigures.
struct Figure {
  std::string_view name;   ///< "rmse": in JSON, in tables, and for --figure
  std::string_view title;  ///< with its unit, for plots and pages
  double ErrorFigures::*value;
  bool larger_is_better;
  std::string_view limit_option;  ///< "--max-rmse"; "" when there is no threshold
  std::string_view limit_help;
};
/// All of them, in the order of the tables.
const std::vector<Figure>& all_figures();
const Figure* find_figure(std::string_view name);
std::vector<std::string_view> figure_names();

/// A limit for each figure, or nothing.  [all_figures()]
struct Thresholds {
  std::vector<std::optional<double>> limits;
  std::optional<double> seam;  ///< of the largest seam error, relative to the map's mean radiance
  bool any() const;
};
/// --max-rmse and its kin, with a heading of their own.
void add_threshold_options(Command& command, Thresholds& target);

/// A limit that a comparison does not keep.
struct Failure {
  const Figure* figure;
  double value, limit;
};
/// The limits that the total does not keep; all that are set when a map has values that are NaN or infinite.  The seam
/// error is that of `converted`, the map that was made.
std::vector<Failure> failures(const Comparison& comparison, const EnvImage& converted, const Thresholds& thresholds);
/// "rmse 0.25 is above 0.1 (--max-rmse)".
std::string failure_text(const Comparison& comparison, const Failure& failure);

/// A figure as a person reads it.
std::string figure_text(double value);
/// The headings of a table of figures, and a row of them, without a first column.
std::vector<std::string> figure_headings();
std::vector<std::string> figure_cells(const ErrorFigures& figures);
/// "yaw 12.3, pitch -4.5 degrees": yaw from +Z towards +X, pitch upwards.
std::string direction_text(Vec3 direction);
/// "3 values are NaN or infinite", or "" when there is none.
std::string nonfinite_text(std::int64_t count);

/// {"mean_a": ..., ..., "max_error_direction": [x, y, z]}; infinite values and NaN are null.
nlohmann::ordered_json json_of(const ErrorFigures& figures);
/// The total's figures, then peak, nonfinite_a, nonfinite_b, excluded, same_grid, and "channels" with each one's own.
nlohmann::ordered_json json_of(const Comparison& comparison);
/// [{"threshold": "--max-rmse", "figure": "rmse", "value": ..., "limit": ...}]
nlohmann::ordered_json json_of(const std::vector<Failure>& failures);

}  // namespace envconv::tool
