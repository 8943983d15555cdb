// SPDX-License-Identifier: Apache-2.0
// envconv roundtrip: there and back through layouts, and what is lost.
#include <algorithm>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>

#include "analyze.h"
#include "convert.h"
#include "figures.h"
#include "pixels.h"
#include "png.h"
#include "svg.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

struct RoundtripRequest {
  InputOptions input;
  Thresholds thresholds;
  std::vector<const Layout*> via;
  int size = 0;             ///< 0: not given
  std::int64_t texels = 0;  ///< 0: not given
  std::vector<int> sizes;   ///< empty: not given
  const Filter* filter = nullptr;
  const Figure* figure = find_figure("psnr");
  std::string plot;
  int threads = 0;
  bool json = false;
};

// One layout at one size.
struct Trip {
  const Layout* layout;
  int height;
  std::int64_t texels;
  Comparison comparison;
  std::vector<Failure> failed;
};

Result<EnvImage> converted(const EnvImage& source, const Layout& layout, int height, Placement placement,
                           const Mat3& frame, const RoundtripRequest& o) {
  ResampleOptions options;
  options.layout = &layout;
  options.height = height;
  options.placement = placement;
  options.consumer_from_world = frame;
  options.filter = o.filter;
  options.threads = o.threads;
  return resample(source, options);
}

Result<Trip> make_trip(const RoundtripRequest& o, const LoadedMap& map, const Layout& layout, int height) {
  const EnvImage& original = map.image;
  ENVCONV_TRY(const EnvImage there, converted(original, layout, height, layout.info().placement, Mat3{}, o));
  ENVCONV_TRY(const EnvImage back, converted(there, *original.layout, original.height(), original.placement,
                                             original.consumer_from_world, o));
  CompareOptions options;
  options.threads = o.threads;
  options.peak = is_integer(map.type) ? 1.0 : 0.0;
  Trip trip{&layout, height, texel_count(layout, height), {}, {}};
  ENVCONV_TRY(trip.comparison, compare_maps(original, back, options));
  trip.failed = failures(trip.comparison, there, o.thresholds);
  return trip;
}

// The heights that a layout is tried at.
std::vector<int> heights_for(const RoundtripRequest& o, const Layout& layout, const EnvImage& original) {
  if (!o.sizes.empty()) return o.sizes;
  if (o.size > 0) return {o.size};
  const std::int64_t texels = o.texels > 0 ? o.texels : static_cast<std::int64_t>(original.texel_count());
  return {height_for_texels(layout, texels)};
}

// Sizes ascending, and the best first among those of one size.
void put_in_order(const RoundtripRequest& o, std::vector<Trip>& trips) {
  const auto worse = [&](const Trip& t) {
    const double value = t.comparison.total.*o.figure->value;
    return o.figure->larger_is_better ? -value : value;
  };
  std::ranges::stable_sort(trips, [&](const Trip& a, const Trip& b) {
    if (!o.sizes.empty() && a.height != b.height) return a.height < b.height;
    return worse(a) < worse(b);
  });
}

void print_text(const std::vector<Trip>& trips) {
  std::vector<std::vector<std::string>> rows{figure_headings()};
  rows.front().insert(rows.front().begin(), {"layout", "size", "texels"});
  for (const Trip& trip : trips) {
    std::vector<std::string>& row = rows.emplace_back(figure_cells(trip.comparison.total));
    row.insert(row.begin(),
               {std::string(trip.layout->name()), std::to_string(trip.height), std::to_string(trip.texels)});
  }
  print(table(rows));
}

void print_json(const LoadedMap& map, const std::vector<Trip>& trips) {
  ordered_json results = ordered_json::array();
  for (const Trip& trip : trips) {
    ordered_json result{{"layout", trip.layout->name()}, {"size", trip.height}, {"texels", trip.texels}};
    result.update(json_of(trip.comparison));
    result["failed"] = json_of(trip.failed);
    results.push_back(result);
  }
  const ordered_json json{{"input", map.name}, {"layout", map.recognition.layout->name()}, {"results", results}};
  print(json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n");
}

std::string plot_of(const RoundtripRequest& o, const LoadedMap& map, const std::vector<Trip>& trips) {
  Chart chart{.title = "There and back: " + visible(map.name),
              .x = {"texels", true, {}},
              .y = {std::string(o.figure->title), !o.figure->larger_is_better, {}},
              .series = {}};
  for (const Layout* layout : o.via) {
    Series& series = chart.series.emplace_back();
    series.name = layout->name();
    for (const Trip& trip : trips) {
      if (trip.layout != layout) continue;
      series.x.push_back(static_cast<double>(trip.texels));
      series.y.push_back(trip.comparison.total.*o.figure->value);
    }
  }
  return svg_of(chart);
}

Result<Ok> check(const RoundtripRequest& o) {
  if (o.via.empty())
    return Error{ErrorCode::usage, "roundtrip: --via is missing (--via cube,octahedral, or --via all)"};
  if ((o.size > 0) + (o.texels > 0) + !o.sizes.empty() > 1)
    return Error{ErrorCode::usage, "--size, --texels and --sizes exclude each other"};
  if (!o.plot.empty() && o.sizes.empty()) return Error{ErrorCode::usage, "--plot wants --sizes"};
  return Ok{};
}

Result<int> roundtrip(const RoundtripRequest& o, const std::string& name) {
  ENVCONV_CHECK(check(o));
  ReadOptions read = o.input.read;
  read.threads = o.threads;
  ENVCONV_TRY(LoadedMap map, load_map(name, o.input.hints, read));
  for (const std::string& warning : map.warnings) warn(name, warning);
  std::int64_t nonfinite = 0;
  for (Image& face : map.image.faces) {
    nonfinite += count_nonfinite(face);
    repair_nonfinite(face);
  }
  if (nonfinite > 0) warn(name, nonfinite_text(nonfinite) + ": replaced by the mean of the neighbours");
  std::vector<Trip> trips;
  for (const Layout* layout : o.via)
    for (const int height : heights_for(o, *layout, map.image)) {
      remark("via " + std::string(layout->name()) + " of size " + std::to_string(height));
      Result<Trip> trip = make_trip(o, map, *layout, height);
      if (!trip) return Error{trip.error().code, name + ": " + trip.error().message};
      trips.push_back(std::move(*trip));
    }
  put_in_order(o, trips);
  if (!o.plot.empty()) ENVCONV_CHECK(write_text_file(o.plot, plot_of(o, map, trips)));
  if (o.json) {
    print_json(map, trips);
  } else {
    print_text(trips);
  }
  bool failed = false;
  for (const Trip& trip : trips)
    for (const Failure& failure : trip.failed) {
      complain(name + ": via " + std::string(trip.layout->name()) + " of size " + std::to_string(trip.height) + ": " +
               failure_text(trip.comparison, failure));
      failed = true;
    }
  return failed ? 1 : 0;
}

int run(const RoundtripRequest& o, const std::string& name) {
  try {
    const Result<int> status = roundtrip(o, name);
    return status ? *status : fail(status.error());
  } catch (const std::bad_alloc&) {
    return fail({ErrorCode::limit, name + ": not enough memory"});
  }
}

// The words between commas.
std::vector<std::string> listed(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    words.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return words;
}

Option via_option(std::vector<const Layout*>& target) {
  Option option{.names = "--via",
                .value = "LAYOUT,...",
                .help = "layouts to go through, with commas between them; all stands for every one"};
  option.choices = layout_names();
  option.choices.push_back("all");
  option.set = [&target](const std::string& text) {
    target.clear();
    for (const std::string& word : listed(text)) {
      if (word == "all") {
        for (const Layout& layout : all_layouts()) target.push_back(&layout);
        continue;
      }
      const Layout* layout = find_layout(word);
      if (!layout) return "no layout is called '" + word + "'" + did_you_mean(word, layout_names());
      target.push_back(layout);
    }
    return std::string();
  };
  return option;
}

Option sizes_option(std::vector<int>& target) {
  Option option{.names = "--sizes",
                .value = "N,...",
                .help = "several sizes, with commas between them: error against resolution"};
  option.set = [&target](const std::string& text) {
    target.clear();
    for (const std::string& word : listed(text)) {
      const auto number = parse_integer(word);
      if (!number || *number < least_size || *number > largest_size)
        return "'" + word + "' is not a whole number from " + std::to_string(least_size) + " to " +
               std::to_string(largest_size);
      target.push_back(static_cast<int>(*number));
    }
    std::ranges::sort(target);
    return std::string();
  };
  return option;
}

Option figure_option(const Figure*& target) {
  Option option{.names = "--figure",
                .value = "NAME",
                .help = "the figure that the results are ordered by, best first, and that --plot draws",
                .choices = figure_names()};
  option.set = [&target](const std::string& name) {
    target = find_figure(name);
    return target ? std::string() : "'" + name + "' is not one of " + joined(figure_names());
  };
  return option;
}

void add_options(Command& command, RoundtripRequest& o) {
  add_input_options(command, o.input);
  const auto add = [&](std::string group, Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), std::move(group), std::move(initial)));
  };
  const std::string trip = "Trip";
  add(trip, via_option(o.via));
  add(trip, count_option("--texels", "N", o.texels, std::int64_t{1} << 40, "as large as so many texels in all allow"),
      "as many as the input has");
  add(trip, integer_option("--size", "N", o.size, least_size, largest_size, "height of a face in texels"));
  add(trip, sizes_option(o.sizes));
  add(trip, filter_option(o.filter), "auto");
  add_threshold_options(command, o.thresholds);
  const std::string general = "General";
  add(general, figure_option(o.figure), "psnr");
  add(general, text_option("--plot", "PATH", o.plot, "with --sizes: a chart (SVG) of the figure against texels"));
  add(general, switch_option("--json", o.json, "one JSON object on stdout"));
  add_general_options(command, o.threads);
}

}  // namespace

Command roundtrip_command() {
  auto options = std::make_shared<RoundtripRequest>();
  Command command{.name = "roundtrip",
                  .summary = "what is lost on the way through layouts and back",
                  .operands = "INPUT",
                  .min_operands = 1,
                  .max_operands = 1,
                  .description =
                      "Converts INPUT to each of the layouts and back to its own layout and size, and prints how far "
                      "the result is from INPUT, one line for each layout, the best first.  The figures are those of "
                      "compare.  A threshold that is not kept gives exit status 1.",
                  .reads_files = true};
  add_options(command, *options);
  command.run = [options](const std::vector<std::string>& names) { return run(*options, names.front()); };
  return command;
}

}  // namespace envconv::tool
