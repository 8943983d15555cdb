// SPDX-License-Identifier: Apache-2.0
// envconv compare: error between two maps of any layouts and sizes, on the sphere.
#include <filesystem>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>

#include "convert.h"
#include "error_picture.h"
#include "figures.h"
#include "png.h"
#include "report.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

struct CompareRequest {
  InputOptions input;
  InputHints hints_b;
  Thresholds thresholds;
  std::optional<double> peak;
  std::string error_map, report;
  const Layout* layout = nullptr;    ///< of the error map; nullptr: latlong
  const Packing* packing = nullptr;  ///< nullptr: the layout's own
  int size = 512;
  int threads = 0;
  bool json = false;
};

void warn_of(const LoadedMap& a, const LoadedMap& b, const Comparison& comparison) {
  for (const LoadedMap* map : {&a, &b})
    for (const std::string& warning : map->warnings) warn(map->name, warning);
  const auto tell = [&](const LoadedMap& map, const std::vector<std::string>& channels, std::int64_t nonfinite) {
    for (const std::string& channel : channels)
      warn(map.name, "channel " + channel + " is not compared: the other map lacks it");
    if (nonfinite > 0) warn(map.name, nonfinite_text(nonfinite) + ": left out of all figures");
  };
  tell(a, comparison.only_in_a, comparison.nonfinite_a);
  tell(b, comparison.only_in_b, comparison.nonfinite_b);
  if (a.recognition.rotation != b.recognition.rotation)
    warn(b.name, "was turned otherwise than " + a.name + ", by its metadata; both are compared as they are");
}

void print_text(const LoadedMap& a, const LoadedMap& b, const Comparison& c) {
  std::vector<std::vector<std::string>> rows{figure_headings()};
  rows.front().insert(rows.front().begin(), "channel");
  const auto add = [&](const std::string& name, const ErrorFigures& figures) {
    std::vector<std::string>& row = rows.emplace_back(figure_cells(figures));
    row.insert(row.begin(), visible(name));
  };
  for (std::size_t i = 0; i < c.channels.size(); ++i) add(c.channels[i], c.figures[i]);
  add("total", c.total);
  std::string out = "A: " + visible(a.name) + ", " + std::string(a.recognition.layout->name()) +
                    "\nB: " + visible(b.name) + ", " + std::string(b.recognition.layout->name()) + "\n" + table(rows);
  if (c.total.max_error > 0)
    out +=
        "largest error " + figure_text(c.total.max_error) + " at " + direction_text(c.total.max_error_direction) + "\n";
  out += "peak " + figure_text(c.peak) + "\n";
  if (c.excluded > 0) out += number_text(100 * c.excluded, 4) + " % of the sphere could not be compared\n";
  print(out);
}

void print_json(const LoadedMap& a, const LoadedMap& b, const Comparison& c, const std::vector<Failure>& failed) {
  ordered_json json{{"a", a.name},
                    {"b", b.name},
                    {"layout_a", a.recognition.layout->name()},
                    {"layout_b", b.recognition.layout->name()}};
  json.update(json_of(c));
  json["failed"] = json_of(failed);
  print(json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n");
}

const Layout& map_layout(const CompareRequest& o) { return o.layout ? *o.layout : *find_layout("latlong"); }
const Packing& map_packing(const CompareRequest& o) { return o.packing ? *o.packing : default_packing(map_layout(o)); }

WriteOptions map_write_options(const CompareRequest& o) {
  WriteOptions write;
  write.threads = o.threads;
  return write;
}

Result<Ok> check_outputs(const CompareRequest& o, const std::vector<std::string>& inputs) {
  for (const std::string& output : {o.error_map, o.report})
    for (const std::string& input : inputs) {
      std::error_code none;
      if (!output.empty() && std::filesystem::equivalent(output, input, none))
        return Error{ErrorCode::usage, output + ": would be written over an input"};
    }
  if (o.error_map.empty()) {
    if (o.layout || o.packing) return Error{ErrorCode::usage, "--to and --packing want --error-map"};
    return Ok{};
  }
  ENVCONV_CHECK(packed_shape(map_layout(o), map_packing(o), o.size));
  return can_write(o.error_map, map_write_options(o), 1, 3);
}

Result<Ok> write_error_map(const CompareRequest& o, const LoadedMap& a, const LoadedMap& b) {
  ENVCONV_TRY(const EnvImage errors, error_map(a.image, b.image, map_layout(o), o.size, o.threads));
  ENVCONV_TRY(Image picture, error_picture(errors, map_packing(o), error_scale(errors),
                                           "root mean square error, " + std::string(map_layout(o).name())));
  std::vector<Picture> pictures;
  pictures.push_back({"", std::move(picture), Channels::standard(3), PixelType::uint8});
  ENVCONV_CHECK(write_pictures(o.error_map, pictures, map_write_options(o)));
  return Ok{};
}

Result<int> compare(const CompareRequest& o, const std::string& name_a, const std::string& name_b) {
  ENVCONV_CHECK(check_outputs(o, {name_a, name_b}));
  ReadOptions read = o.input.read;
  read.threads = o.threads;
  ENVCONV_TRY(const LoadedMap a, load_map(name_a, o.input.hints, read));
  ENVCONV_TRY(const LoadedMap b, load_map(name_b, o.hints_b, read));
  CompareOptions options;
  options.threads = o.threads;
  options.peak = o.peak ? *o.peak : is_integer(a.type) ? 1.0 : 0.0;
  const Result<Comparison> comparison = compare_maps(a.image, b.image, options);
  if (!comparison) return Error{comparison.error().code, name_b + ": " + comparison.error().message};
  const std::vector<Failure> failed = failures(*comparison, b.image, o.thresholds);
  warn_of(a, b, *comparison);
  if (!o.error_map.empty()) ENVCONV_CHECK(write_error_map(o, a, b));
  if (!o.report.empty()) {
    ENVCONV_TRY(const std::string page, report_page({a, b, *comparison, failed, o.threads}));
    ENVCONV_CHECK(write_text_file(o.report, page));
  }
  if (o.json) {
    print_json(a, b, *comparison, failed);
  } else {
    print_text(a, b, *comparison);
  }
  for (const Failure& failure : failed) complain(name_b + ": " + failure_text(*comparison, failure));
  return failed.empty() ? 0 : 1;
}

int run(const CompareRequest& o, const std::vector<std::string>& names) {
  try {
    const Result<int> status = compare(o, names[0], names[1]);
    return status ? *status : fail(status.error());
  } catch (const std::bad_alloc&) {
    return fail({ErrorCode::limit, names[1] + ": not enough memory to compare"});
  }
}

void add_options(Command& command, CompareRequest& o) {
  add_input_options(command, o.input);
  add_second_input_options(command, o.hints_b);
  add_threshold_options(command, o.thresholds);
  const auto add = [&](std::string group, Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), std::move(group), std::move(initial)));
  };
  const std::string pictures = "Pictures";
  add(pictures, text_option("--error-map", "PATH", o.error_map,
                            "draw where the error is, on a logarithmic scale that is drawn below the map"));
  add(pictures, layout_option("--to", o.layout, "layout of the error map"), "latlong");
  add(pictures, packing_option("--packing", o.packing, "how the error map's faces lie in its image"),
      "the layout's own");
  add(pictures, integer_option("--size", "N", o.size, least_size, largest_size, "height of a face of the error map"),
      "512");
  add(pictures, text_option("--report", "PATH", o.report,
                            "write a page (HTML) with both maps, the error map, the figures and plots"));
  const std::string general = "General";
  add(general, number_option("--peak", "X", o.peak, 1e-30, 1e30, "the value that PSNR and its kin measure against"),
      "1 when A holds integers, else A's largest value");
  add(general, switch_option("--json", o.json, "one JSON object on stdout"));
  add_general_options(command, o.threads);
}

}  // namespace

Command compare_command() {
  auto options = std::make_shared<CompareRequest>();
  Command command{.name = "compare",
                  .summary = "error between two maps of any layouts and sizes",
                  .operands = "A B",
                  .min_operands = 2,
                  .max_operands = 2,
                  .description =
                      "Prints how far map B is from map A, the reference, for each channel and for all colours "
                      "together: means, root mean square, mean absolute and largest error, and PSNR, WS-PSNR, S-PSNR "
                      "and structural similarity.  All are taken over the sphere, whatever the two layouts, sizes and "
                      "frames.  A threshold that is not kept gives exit status 1.",
                  .reads_files = true};
  add_options(command, *options);
  command.run = [options](const std::vector<std::string>& names) { return run(*options, names); };
  return command;
}

}  // namespace envconv::tool
