// SPDX-License-Identifier: Apache-2.0
#include "figures.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "options.h"
#include "seam.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

constexpr int digits = 6;

// JSON has no infinity.
ordered_json finite_or_null(double value) { return std::isfinite(value) ? ordered_json(value) : ordered_json(); }

}  // namespace

const std::vector<Figure>& all_figures() {
  using F = ErrorFigures;
  static const std::vector<Figure> figures{
      {"mean_a", "mean of A", &F::mean_a, true, "", ""},
      {"mean_b", "mean of B", &F::mean_b, true, "", ""},
      {"rmse", "root mean square error", &F::rmse, false, "--max-rmse", "root mean square error"},
      {"mae", "mean absolute error", &F::mae, false, "", ""},
      {"max_error", "largest error", &F::max_error, false, "--max-error", "largest error"},
      {"psnr", "PSNR (dB)", &F::psnr, true, "--min-psnr", "peak signal-to-noise ratio, dB"},
      {"psnr_hdr", "PSNR of log-encoded values (dB)", &F::psnr_hdr, true, "--min-psnr-hdr",
       "peak signal-to-noise ratio of log-encoded values, dB"},
      {"ws_psnr", "WS-PSNR (dB)", &F::ws_psnr, true, "--min-ws-psnr", "WS-PSNR, dB"},
      {"s_psnr", "S-PSNR (dB)", &F::s_psnr, true, "--min-s-psnr", "S-PSNR, dB"},
      {"ssim_sphere", "SSIM on the sphere", &F::ssim_sphere, true, "--min-ssim", "structural similarity on the sphere"},
  };
  return figures;
}

const Figure* find_figure(std::string_view name) {
  const auto at = std::ranges::find(all_figures(), name, &Figure::name);
  return at == all_figures().end() ? nullptr : &*at;
}

std::vector<std::string_view> figure_names() {
  std::vector<std::string_view> names;
  for (const Figure& figure : all_figures()) names.push_back(figure.name);
  return names;
}

// Of one map, and so none of a comparison's.
static constexpr Figure seam_figure{"seam_error", "seam error",
                                    nullptr,      false,
                                    "--max-seam", "seam error of the map that was made, relative to its mean radiance"};

bool Thresholds::any() const {
  return seam || std::ranges::any_of(limits, [](const auto& limit) { return limit.has_value(); });
}

void add_threshold_options(Command& command, Thresholds& target) {
  target.limits.resize(all_figures().size());  // now: the options keep references
  for (std::size_t i = 0; i < all_figures().size(); ++i) {
    const Figure& figure = all_figures()[i];
    if (figure.limit_option.empty()) continue;
    const std::string help = (figure.larger_is_better ? "the least allowed " : "the most allowed ") +
                             std::string(figure.limit_help) + "; beyond it the exit status is 1";
    command.options.push_back(in_group(
        number_option(std::string(figure.limit_option), "X", target.limits[i], -1e30, 1e30, help), "Thresholds"));
  }
  const std::string help =
      "the most allowed " + std::string(seam_figure.limit_help) + "; beyond it the exit status is 1";
  command.options.push_back(
      in_group(number_option(std::string(seam_figure.limit_option), "X", target.seam, 0, 1e30, help), "Thresholds"));
}

std::vector<Failure> failures(const Comparison& comparison, const EnvImage& converted, const Thresholds& thresholds) {
  const bool spoiled = comparison.nonfinite_a + comparison.nonfinite_b > 0;
  std::vector<Failure> out;
  for (std::size_t i = 0; i < thresholds.limits.size(); ++i) {
    if (!thresholds.limits[i]) continue;
    const Figure& figure = all_figures()[i];
    const double value = comparison.total.*figure.value, limit = *thresholds.limits[i];
    const bool kept = figure.larger_is_better ? value >= limit : value <= limit;  // NaN keeps nothing
    if (!kept || spoiled) out.push_back({&figure, value, limit});
  }
  if (thresholds.seam) {
    const double value = seam_error(converted).largest;
    if (!(value <= *thresholds.seam)) out.push_back({&seam_figure, value, *thresholds.seam});
  }
  return out;
}

std::string failure_text(const Comparison& comparison, const Failure& failure) {
  const std::string option = " (" + std::string(failure.figure->limit_option) + ")";
  const double limit = failure.limit, value = failure.value;
  const std::string numbers = std::string(failure.figure->name) + " " + number_text(value, 9);
  const bool kept = failure.figure->larger_is_better ? value >= limit : value <= limit;
  if (kept)
    return numbers + " does not count: " + nonfinite_text(comparison.nonfinite_a + comparison.nonfinite_b) + option;
  return numbers +
         (std::isnan(value)                  ? " is not "
          : failure.figure->larger_is_better ? " is below "
                                             : " is above ") +
         number_text(limit, 9) + option;
}

std::string figure_text(double value) { return number_text(value, digits); }

std::vector<std::string> figure_headings() {
  std::vector<std::string> out;
  for (const Figure& figure : all_figures()) out.emplace_back(figure.name);
  return out;
}

std::vector<std::string> figure_cells(const ErrorFigures& figures) {
  std::vector<std::string> out;
  for (const Figure& figure : all_figures()) out.push_back(figure_text(figures.*figure.value));
  return out;
}

std::string direction_text(Vec3 d) {
  constexpr double degrees = 180 / std::numbers::pi;
  const double yaw = degrees * std::atan2(d.x, d.z), pitch = degrees * std::asin(std::clamp(d.y, -1.0, 1.0));
  return "yaw " + number_text(std::round(10 * yaw) / 10, 4) + ", pitch " + number_text(std::round(10 * pitch) / 10, 4) +
         " degrees";
}

std::string nonfinite_text(std::int64_t count) {
  if (count == 0) return "";
  return std::to_string(count) + (count == 1 ? " value is" : " values are") + " NaN or infinite";
}

ordered_json json_of(const ErrorFigures& figures) {
  ordered_json json = ordered_json::object();
  for (const Figure& figure : all_figures()) {
    json[std::string(figure.name)] = finite_or_null(figures.*figure.value);
    if (figure.name == "max_error") {
      const Vec3 d = figures.max_error_direction;
      json["max_error_direction"] = {d.x, d.y, d.z};
    }
  }
  return json;
}

ordered_json json_of(const Comparison& comparison) {
  ordered_json json = json_of(comparison.total);
  json["peak"] = comparison.peak;
  json["nonfinite_a"] = comparison.nonfinite_a;
  json["nonfinite_b"] = comparison.nonfinite_b;
  json["excluded"] = comparison.excluded;
  json["same_grid"] = comparison.same_grid;
  ordered_json channels = ordered_json::array();
  for (std::size_t c = 0; c < comparison.channels.size(); ++c) {
    ordered_json channel{{"name", comparison.channels[c]}};
    channel.update(json_of(comparison.figures[c]));
    channels.push_back(channel);
  }
  json["channels"] = channels;
  return json;
}

ordered_json json_of(const std::vector<Failure>& failures) {
  ordered_json list = ordered_json::array();
  for (const Failure& f : failures) {
    list.push_back({{"threshold", f.figure->limit_option},
                    {"figure", f.figure->name},
                    {"value", finite_or_null(f.value)},
                    {"limit", f.limit}});
  }
  return list;
}

}  // namespace envconv::tool
