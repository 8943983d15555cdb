// SPDX-License-Identifier: Apache-2.0
// envconv pattern: test cards in any layout.
#include <algorithm>
#include <memory>
#include <vector>

#include "analyze.h"
#include "convert.h"
#include "pattern.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr int default_size = 512;
constexpr std::int64_t most_texels = std::int64_t{1} << 30;

struct PatternCommand {
  ConvertOptions convert;  // what it shares with convert
  PatternOptions pattern;
  std::vector<double> value, radiance, direction;
  std::int64_t seed = 1;
};

std::vector<std::string_view> pattern_names() {
  std::vector<std::string_view> names;
  for (const PatternInfo& pattern : all_patterns()) names.push_back(pattern.name);
  return names;
}

// Numbers with commas between them, as many as one of `counts`.
Option numbers_option(std::string names, std::string value, std::vector<double>& target,
                      std::vector<std::size_t> counts, std::string wanted, std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target, counts, wanted](const std::string& text) {
    target.clear();
    bool good = true;
    for (std::size_t at = 0; good && at <= text.size();) {
      const std::size_t end = std::min(text.find(',', at), text.size());
      const auto number = parse_number(std::string_view(text).substr(at, end - at));
      good = number.has_value();
      if (good) target.push_back(*number);
      at = end + 1;
    }
    good = good && std::find(counts.begin(), counts.end(), target.size()) != counts.end();
    return good ? std::string() : "'" + text + "' is not " + wanted;
  };
  return option;
}

Option radiance_option(std::string names, std::vector<double>& target, std::string help) {
  return numbers_option(std::move(names), "R[,G,B]", target, {1, 3}, "one number, or three with commas between them",
                        std::move(help));
}

Option number_option(std::string names, std::string value, double& target, std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target](const std::string& text) {
    const auto number = parse_number(text);
    if (!number) return "'" + text + "' is not a number";
    target = *number;
    return std::string();
  };
  return option;
}

void add_options(Command& command, PatternCommand& c) {
  auto add = [&](std::string group, Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), std::move(group), std::move(initial)));
  };
  ConvertOptions& o = c.convert;
  add("Output", text_option("-o,--output", "PATH", o.output,
                            "file to write, or with --packing files a template with {face} or {face_index}; {layout} "
                            "and {size} are known too, and {stem} is KIND"));
  add("Output", layout_option("--to", o.layout, "layout of the output"), "cube");
  add("Output",
      packing_option("--packing", o.packing,
                     "how faces lie in the image; files: one file per face, with {face} in --output; parts: one "
                     "OpenEXR part per face"),
      "the layout's own");
  add("Output",
      frame_option("--frame", o.frame,
                   "axes of the program that will use the output: those that directions, labels, grid and sun name"),
      "world");
  add("Output", integer_option("--size", "N", o.size, least_size, largest_size, "height of a face in texels"), "512");
  add("Output", count_option("--texels", "N", o.texels, most_texels,
                             "instead of --size: the largest size whose faces together hold at most N texels"));
  add("Output", type_option(o.write), "float, or the nearest that the file format has");
  add("Output", text_option("--compression", "NAME", o.write.compression, "compression of the file format"),
      "the format's usual");
  add("Output", switch_option("--verify", o.write.verify, "read the output back before it takes its name"));
  add("Pattern", rotate_option(o.rotation), "0,0,0");
  add("Pattern", radiance_option("--value", c.value, "of constant: its radiance"), "0.5");
  add("Pattern",
      count_option("--seed", "N", c.seed, std::int64_t{1} << 62, "of noise: the same number gives the same noise"),
      "1");
  add("Pattern",
      integer_option(
          "--degree", "N", c.pattern.degree, 1, 4096,
          "of noise: the highest degree of spherical harmonics in it, which oscillate N times in 360 degrees"),
      "32");
  add("Pattern",
      numbers_option("--direction", "X,Y,Z", c.direction, {3}, "three numbers with commas between them",
                     "of sun: where its centre is seen, in the axes of --frame"),
      "straight up");
  add("Pattern", number_option("--diameter", "DEGREES", c.pattern.diameter, "of sun: the angle that it spans"), "0.53");
  add("Pattern", radiance_option("--radiance", c.radiance, "of sun: its radiance"), "1");
  add_general_options(command, o.threads);
}

void set_radiance(const std::vector<double>& from, std::array<double, 3>& to) {
  for (std::size_t c = 0; c < 3 && !from.empty(); ++c) to[c] = from[from.size() == 3 ? c : 0];
}

Result<Ok> draw(PatternCommand& c, const std::string& kind) {
  const PatternInfo* info = find_pattern(kind);
  if (!info)
    return Error{ErrorCode::usage, "no pattern is called '" + kind + "'" + did_you_mean(kind, pattern_names()) +
                                       "; there are: " + joined(pattern_names())};
  if (!c.convert.size && !c.convert.texels) c.convert.size = default_size;
  ENVCONV_TRY(ConvertPlan plan, plan_output(c.convert, kind));
  const ConvertOptions& o = plan.options;
  PatternOptions& p = c.pattern;
  p.kind = info->kind;
  p.layout = o.layout;
  p.height = o.size ? o.size : height_for_texels(*o.layout, o.texels);
  if (texel_count(*o.layout, p.height) > most_texels)
    return Error{ErrorCode::limit,
                 "--size: more than " + std::to_string(most_texels) + " texels (choose a smaller one)"};
  p.placement = o.layout->info().placement;
  p.consumer_from_world = o.frame->consumer_from_world;
  p.rotation = o.rotation;
  p.seed = static_cast<std::uint64_t>(c.seed);
  if (p.kind == PatternKind::sun) p.value = {1, 1, 1};
  set_radiance(p.kind == PatternKind::sun ? c.radiance : c.value, p.value);
  p.direction = c.direction.empty() ? p.consumer_from_world * Vec3{0, 1, 0}
                                    : Vec3{c.direction[0], c.direction[1], c.direction[2]};
  ENVCONV_TRY(EnvImage image, make_pattern(p));
  Outcome outcome;
  const Job& job = plan.jobs.front();
  outcome.shape.height = p.height;
  outcome.shape.channels = image.channels.count();
  const LevelPlace place = level_place(plan, job);
  outcome.shape.levels = levels_to_make(o.levels, place, p.height);
  const WriteOptions write = write_options(plan, job, outcome.shape, o.rotation, PixelType::float32);
  ENVCONV_TRY(std::vector<EnvImage> levels, make_levels(o.levels, place, std::move(image), o.threads));
  ENVCONV_CHECK(write_files(plan, job, write, std::move(levels), outcome));
  for (const std::string& warning : outcome.warnings) warn(job.output, warning);
  remark(kind + ": " + std::string(o.layout->name()) + ", size " + std::to_string(p.height) + ": " + job.output);
  return Ok{};
}

std::string kinds_in_words() {
  std::string out;
  for (const PatternInfo& pattern : all_patterns())
    out += (out.empty() ? "" : "; ") + std::string(pattern.name) + ": " + std::string(pattern.note);
  return out;
}

}  // namespace

Command pattern_command() {
  auto options = std::make_shared<PatternCommand>();
  Command command{.name = "pattern",
                  .summary = "draw a test card: labels, zone plates ...",
                  .operands = "KIND",
                  .min_operands = 1,
                  .max_operands = 1,
                  .description =
                      "Writes an environment that is known in closed form, each texel its mean over the "
                      "texel's footprint.  KIND is one of: " +
                      kinds_in_words() + ".",
                  .operand_choices = pattern_names()};
  add_options(command, *options);
  command.run = [options](const std::vector<std::string>& operands) {
    const Result<Ok> done = draw(*options, operands.front());
    return done ? 0 : fail(done.error());
  };
  return command;
}

}  // namespace envconv::tool
