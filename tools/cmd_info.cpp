// SPDX-License-Identifier: Apache-2.0
// envconv info: what a file is, and what is in it.
#include <array>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>

#include "color_options.h"
#include "image.h"
#include "input.h"
#include "luminance.h"
#include "pixels.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

struct InfoOptions {
  InputOptions input;
  ColorOptions color;
  int threads = 0;
  bool seams = false, json = false;
};

// All that is told of one file.
struct Facts {
  PictureFile file;  ///< its pixels have been moved out
  std::vector<Size> sizes;
  std::vector<ChannelStatistics> statistics;
  bool recognised = false;
  Recognition recognition;
  std::string why_not;                  ///< when it was not recognised
  std::vector<std::string> candidates;  ///< when that is because it could be several
  SourceColor color;
  std::vector<double> mean;
  LuminanceStatistics luminance;
  std::optional<SeamError> seams;
  std::vector<std::string> warnings;
};

Result<Facts> collect(const InfoOptions& o, const ColorPlan& color, const std::string& name) {
  const Input input = input_named(name, o.input.hints);
  ENVCONV_CHECK(check_readable(input));
  ReadOptions read = with_color(o.input.read, color, input.paths.front());
  read.threads = o.threads;
  Facts facts;
  ENVCONV_TRY(facts.file, read_input(input, read));
  if (facts.file.pictures.empty()) return Error{ErrorCode::input, name + ": holds no picture"};
  ENVCONV_TRY(facts.color, source_color(color, facts.file, input.paths.front()));
  for (Picture& picture : facts.file.pictures) {
    if (has_color(picture.channels)) {
      ENVCONV_CHECK(to_working(color, facts.color, picture.channels, {&picture.image, 1}));
    }
    facts.sizes.push_back({picture.image.width(), picture.image.height()});
    if (picture.channels == facts.file.pictures.front().channels) add_statistics(picture.image, facts.statistics);
  }
  facts.warnings = facts.file.warnings;
  Result<Recognition> recognition = recognize_input(input, facts.file, o.input.hints);
  const bool told = o.input.hints.layout || o.input.hints.packing || o.input.hints.frame;
  if (!recognition) {
    if (told) return recognition.error();  // the file is not what it was said to be
    facts.why_not = recognition.error().message;
    if (const std::string prefix = facts.file.path + ": "; facts.why_not.starts_with(prefix)) {
      facts.why_not.erase(0, prefix.size());
    }
    facts.candidates = candidates(facts.file, o.input.hints);
    return facts;
  }
  facts.recognition = *recognition;
  facts.recognised = true;
  facts.warnings.insert(facts.warnings.end(), recognition->warnings.begin(), recognition->warnings.end());
  PictureFile pixels = std::move(facts.file);
  facts.file.path = pixels.path;
  facts.file.format = pixels.format;
  facts.file.compression = pixels.compression;
  facts.file.color = pixels.color;
  facts.file.levels = pixels.levels;
  facts.file.level = pixels.level;
  facts.file.metadata = pixels.metadata;
  facts.file.pictures.clear();
  for (const Picture& picture : pixels.pictures) {
    facts.file.pictures.push_back({picture.name, {}, picture.channels, picture.type});
  }
  std::vector<Image> grown;
  ENVCONV_TRY(const EnvImage image, to_environment(std::move(pixels), facts.recognition, &grown));
  facts.mean = mean_radiance(image);
  if (o.seams) facts.seams = seam_error(image, grown, facts.recognition.seam.gutter());
  if (has_color(image.channels)) {
    ENVCONV_TRY(facts.luminance, luminance_statistics(image, facts.color.working_primaries.value_or(rec709())));
  }
  return facts;
}

// {"name": "rec709", "red": [x, y], ...}, or null.
ordered_json chromaticities_json(const std::optional<Chromaticities>& xy) {
  if (!xy) return {};
  const Primaries* named = find_primaries(*xy);
  return {{"name", named ? ordered_json(named->name) : ordered_json()},
          {"red", {xy->red_x, xy->red_y}},
          {"green", {xy->green_x, xy->green_y}},
          {"blue", {xy->blue_x, xy->blue_y}},
          {"white", {xy->white_x, xy->white_y}}};
}

void add_luminance(ordered_json& json, const Facts& f) {
  const LuminanceStatistics& l = f.luminance;
  ordered_json percentiles;
  for (std::size_t i = 0; i < luminance_shares.size(); ++i) {
    percentiles[number_text(luminance_shares[i], 3)] = l.percentiles[i];
  }
  json["luminance"] = {{"min", l.min}, {"max", l.max}, {"mean", l.mean}, {"percentiles", percentiles}};
  const Brightest& b = l.brightest;
  json["brightest"] = {{"direction", {b.direction.x, b.direction.y, b.direction.z}},
                       {"face", f.recognition.layout->info().faces[static_cast<std::size_t>(b.face)].name},
                       {"x", b.x},
                       {"y", b.y}};
  json["dynamic_range_stops"] = l.stops();
  json["dynamic_range_stops_98"] = l.usual_stops();
}

// Lines of the text: luminance, its percentiles, the brightest texel, the range.
std::vector<std::pair<std::string, std::string>> luminance_lines(const Facts& f) {
  const LuminanceStatistics& l = f.luminance;
  const auto text = [](double v) { return number_text(v, 4); };
  std::string percentiles;
  for (std::size_t i = 0; i < luminance_shares.size(); ++i) {
    percentiles += (i ? ", " : "") + number_text(luminance_shares[i], 3) + "% " + text(l.percentiles[i]);
  }
  const Brightest& b = l.brightest;
  return {{"luminance", "min " + text(l.min) + ", max " + text(l.max) + ", mean " + text(l.mean)},
          {"percentiles", percentiles},
          {"brightest", "towards " + text(b.direction.x) + "," + text(b.direction.y) + "," + text(b.direction.z) +
                            ", texel " + std::to_string(b.x) + "," + std::to_string(b.y) + " of " +
                            std::string(f.recognition.layout->info().faces[static_cast<std::size_t>(b.face)].name)},
          {"range", text(l.stops()) + " stops, " + text(l.usual_stops()) + " of them in the middle 98% of the sphere"}};
}

// Size of a face as it is stored.
Size stored_size(const Recognition& r, int face) {
  return r.stored.empty() ? face_size(*r.layout, face, r.height) : r.stored[static_cast<std::size_t>(face)];
}

// Along both axes of the first face.
std::array<LookupScale, 2> lookup_scales(const Recognition& r) {
  const Size size = stored_size(r, 0);
  const auto axis = [&](int n) { return lookup_scale(n, placement_of(r), r.seam.gutter()); };
  return {axis(size.width), axis(size.height)};
}

bool is_scaled(const Recognition& r) { return placement_of(r) != Placement::centre || r.seam.gutter() > 0; }

std::string lookup_text(const Recognition& r) {
  const auto axis = [](const char* name, const LookupScale& l) {
    return std::string(name) + " * " + number_text(l.scale, 9) + " + " + number_text(l.offset, 9);
  };
  const auto [u, v] = lookup_scales(r);
  return axis("u", u) + ", " + axis("v", v);
}

ordered_json json_of(const std::string& name, const Facts& f) {
  const Picture& first = f.file.pictures.front();
  const Recognition& r = f.recognition;
  ordered_json json{{"file", name}};
  json["format"] = f.file.format;
  json["compression"] = f.file.compression;
  json["color"] = f.file.color;
  json["colorspace"] = f.color.text;
  json["colorspace_from"] = f.color.input.how;
  json["primaries"] = chromaticities_json(f.color.working_primaries);
  json["type"] = name_of(first.type);
  json["width"] = f.sizes.front().width;
  json["height"] = f.sizes.front().height;
  json["levels"] = f.file.levels;
  json["level"] = f.file.level;
  json["parts"] = f.file.pictures.size();
  json["layout"] = f.recognised ? ordered_json(r.layout->name()) : ordered_json();
  if (!f.candidates.empty()) json["candidates"] = f.candidates;
  json["how"] = f.recognised ? r.how : f.why_not;
  if (f.recognised) {
    json["packing"] = r.packing->name;
    json["frame"] = r.frame->name;
    json["rotation"] = {r.rotation.yaw, r.rotation.pitch, r.rotation.roll};
    json["size"] = r.height;
    ordered_json faces = ordered_json::array();
    for (int i = 0; i < r.layout->face_count(); ++i) {
      const Size size = stored_size(r, i);
      faces.push_back({{"name", r.layout->info().faces[static_cast<std::size_t>(i)].name},
                       {"width", size.width},
                       {"height", size.height}});
    }
    json["faces"] = faces;
    json["seam"] = text_of(r.seam);
    const auto [u, v] = lookup_scales(r);
    json["lookup"] = {{"scale", {u.scale, v.scale}}, {"offset", {u.offset, v.offset}}};
    if (f.seams) {
      json["seams"] = {{"largest", f.seams->largest},
                       {"rms", f.seams->rms},
                       {"inside_largest", f.seams->inside_largest},
                       {"inside_rms", f.seams->inside_rms},
                       {"points", f.seams->points}};
    }
  }
  ordered_json channels = ordered_json::array();
  for (std::size_t c = 0; c < f.statistics.size() && c < first.channels.names.size(); ++c) {
    const ChannelStatistics& s = f.statistics[c];
    ordered_json channel{{"name", first.channels.names[c]}};
    channel["min"] = s.finite ? ordered_json(s.min) : ordered_json();
    channel["max"] = s.finite ? ordered_json(s.max) : ordered_json();
    channel["mean"] = c < f.mean.size() ? ordered_json(f.mean[c]) : ordered_json();
    channel["nan"] = s.nan;
    channel["inf"] = s.infinite;
    channel["negative"] = s.negative;
    channels.push_back(channel);
  }
  json["channels"] = channels;
  if (f.luminance.any) add_luminance(json, f);
  json["warnings"] = f.warnings;
  return json;
}

std::string text_of(const std::string& name, const Facts& f) {
  const Picture& first = f.file.pictures.front();
  const Recognition& r = f.recognition;
  std::string out = visible(name) + "\n";
  auto line = [&](const std::string& key, const std::string& value) {
    out += "  " + key + std::string(13 - key.size(), ' ') + visible(value) + "\n";
  };
  if (f.recognised) {
    line("layout", std::string(r.layout->name()) + ", " + r.how);
    line("packing", std::string(r.packing->name));
    line("frame", std::string(r.frame->name));
    if (r.rotation != Rotation{}) {
      line("rotation", number_text(r.rotation.yaw, 9) + "," + number_text(r.rotation.pitch, 9) + "," +
                           number_text(r.rotation.roll, 9) + " degrees, in the pixels already");
    }
    const Size size = stored_size(r, 0);
    line("faces", std::to_string(r.layout->face_count()) + " of " + std::to_string(size.width) + "x" +
                      std::to_string(size.height) + (r.layout->info().faces.size() > 1 ? " (the first)" : ""));
    line("size", std::to_string(r.height));
    if (r.seam.method != SeamMethod::none) line("seam", text_of(r.seam));
    if (is_scaled(r)) line("lookup", lookup_text(r) + ", clamped bilinear");
    if (f.seams) {
      line("seam error", number_text(f.seams->largest, 4) + " at most, " + number_text(f.seams->rms, 4) +
                             " rms, of the mean; inside faces " + number_text(f.seams->inside_largest, 4) + " and " +
                             number_text(f.seams->inside_rms, 4) + " over steps as long");
    }
  } else if (!f.candidates.empty()) {
    const std::vector<std::string_view> names(f.candidates.begin(), f.candidates.end());
    line("layout", "could be any of " + joined(names) + " (say which with --from)");
  } else {
    line("layout", "not recognised: " + f.why_not);
  }
  line("image", std::to_string(f.sizes.front().width) + "x" + std::to_string(f.sizes.front().height) +
                    (f.sizes.size() > 1 ? ", " + std::to_string(f.sizes.size()) + " pictures" : ""));
  line("levels", std::to_string(f.file.levels) + (f.file.level > 0 ? ", read: " + std::to_string(f.file.level) : ""));
  std::string channels;
  for (const std::string& channel : first.channels.names) channels += (channels.empty() ? "" : " ") + channel;
  line("channels", channels);
  line("type", std::string(name_of(first.type)));
  line("format", f.file.format + (f.file.compression.empty() ? "" : ", " + f.file.compression));
  line("colour", f.color.text + ", " + f.color.input.how);
  if (f.luminance.any) {
    for (const auto& [key, value] : luminance_lines(f)) line(key, value);
  }
  std::vector<std::vector<std::string>> rows{{"channel", "min", "max", "mean", "NaN", "Inf", "negative"}};
  for (std::size_t c = 0; c < f.statistics.size() && c < first.channels.names.size(); ++c) {
    const ChannelStatistics& s = f.statistics[c];
    rows.push_back({visible(first.channels.names[c]), s.finite ? number_text(s.min, 6) : "-",
                    s.finite ? number_text(s.max, 6) : "-", c < f.mean.size() ? number_text(f.mean[c], 6) : "-",
                    std::to_string(s.nan), std::to_string(s.infinite), std::to_string(s.negative)});
  }
  const std::string cells = table(rows);
  for (std::size_t at = 0; at < cells.size();) {
    const std::size_t end = cells.find('\n', at);
    out += "  " + cells.substr(at, end - at + 1);
    at = end + 1;
  }
  return out;
}

int run(const InfoOptions& o, const std::vector<std::string>& names) {
  const Result<ColorPlan> color = plan_color(o.color, {});
  if (!color) return fail(color.error());
  ordered_json list = ordered_json::array();
  int status = 0;
  bool first = true;
  for (const std::string& name : names) {
    Result<Facts> facts = [&]() -> Result<Facts> {
      try {
        return collect(o, *color, name);
      } catch (const std::bad_alloc&) {
        return Error{ErrorCode::limit, name + ": not enough memory"};
      }
    }();
    if (!facts) {
      // The other files are told of all the same; the first failure gives the status.
      const int failed = fail(facts.error());
      if (status == 0) status = failed;
      list.push_back({{"file", name}, {"error", facts.error().message}});
      continue;
    }
    for (const std::string& warning : facts->warnings) warn(name, warning);
    if (o.json) {
      list.push_back(json_of(name, *facts));
    } else {
      print((first ? "" : "\n") + text_of(name, *facts));
      first = false;
    }
  }
  if (o.json) {
    const ordered_json& result = names.size() == 1 ? list.front() : list;
    print(result.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n");
  }
  return status;
}

}  // namespace

Command info_command() {
  auto options = std::make_shared<InfoOptions>();
  Command command{.name = "info",
                  .summary = "what a file is, and what is in it",
                  .operands = "FILE...",
                  .min_operands = 1,
                  .description =
                      "Prints the layout of each FILE and how it was recognised, its packing, frame, faces "
                      "and size, the image's levels, channels, type, format and colour, and for each "
                      "channel the range of its finite values, the mean over the sphere (weighted by solid "
                      "angle), and how many values are NaN, infinite or negative.  Of the luminance: its range, mean "
                      "and percentiles over the sphere, the direction (right, up, forward) and texel of the largest, "
                      "and the dynamic range in stops (powers of two) from the smallest positive value to the largest "
                      "and over the middle 98 % of the sphere.  Values are linear.",
                  .reads_files = true};
  add_input_options(command, options->input);
  add_config_option(command, options->color, "Input");
  command.options.push_back(in_group(
      switch_option("--seams", options->seams,
                    "measure the seam error: the largest and the root-mean-square difference between the two sides' "
                    "clamped bilinear reconstructions along all seams, of the mean radiance, beside steps "
                    "as long inside faces, from the texels beside the seams"),
      "General"));
  command.options.push_back(in_group(
      switch_option("--json", options->json, "one JSON object on stdout, or an array of them for several files"),
      "General"));
  add_general_options(command, options->threads);
  command.run = [options](const std::vector<std::string>& names) { return run(*options, names); };
  return command;
}

}  // namespace envconv::tool
