// SPDX-License-Identifier: Apache-2.0
// envconv convert: read any layout, resample, write any layout.
#include <memory>

#include "convert.h"
#include "text.h"

namespace envconv::tool {
namespace {

Option size_option(int& target) {
  Option option = integer_option("--size", "N", target, least_size, largest_size,
                                 "height of a face in texels (of a latlong: the image's height); auto: the smallest "
                                 "that keeps the input's worst-case detail");
  option.set = [plain = option.set, &target](const std::string& text) {
    if (text != "auto") return plain(text);
    target = 0;
    return std::string();
  };
  return option;
}

Option alpha_option(bool& drop) {
  Option option{.names = "--alpha",
                .value = "MODE",
                .help =
                    "keep the alpha channel, or drop it and keep colour as the file stores it: multiplied by alpha in "
                    "OpenEXR, not so in PNG"};
  option.choices = {"keep", "drop"};
  option.set = [&drop](const std::string& text) {
    drop = text == "drop";
    return drop || text == "keep" ? std::string() : "'" + text + "' is not one of keep, drop";
  };
  return option;
}

Option exposure_option(double& target) {
  Option option{.names = "--exposure", .value = "EV", .help = "multiply by 2 to the power of EV"};
  option.set = [&target](const std::string& text) {
    const auto value = parse_number(text);
    if (!value || *value < -100 || *value > 100) return "'" + text + "' is not a number from -100 to 100";
    target = *value;
    return std::string();
  };
  return option;
}

Option nonfinite_option(Nonfinite& target) {
  constexpr std::array<std::string_view, 4> names{"error", "zero", "clamp", "repair"};  // as in Nonfinite
  Option option{.names = "--nonfinite",
                .value = "POLICY",
                .help =
                    "what becomes of NaN and infinity in the input: error refuses the file; zero; clamp makes "
                    "infinity the largest finite value; repair takes the mean of the finite neighbours"};
  option.choices.assign(names.begin(), names.end());
  option.set = [&target, names](const std::string& text) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (names[i] != text) continue;
      target = static_cast<Nonfinite>(i);
      return std::string();
    }
    return "'" + text + "' is not one of " + joined(names);
  };
  return option;
}

Option shard_option(int& shard, int& shards) {
  Option option{.names = "--shard",
                .value = "I/N",
                .help =
                    "take every N-th input, starting from the I-th; the N shards of a batch share its inputs and write "
                    "what the batch as a whole would"};
  option.set = [&shard, &shards](const std::string& text) {
    const std::size_t slash = text.find('/');
    const auto i = parse_integer(std::string_view(text).substr(0, slash));
    const auto n = slash == std::string::npos ? std::nullopt : parse_integer(std::string_view(text).substr(slash + 1));
    if (!i || !n || *i < 1 || *n < 1 || *i > *n || *n > 1000000000) {
      return "'" + text + "' is not I/N with whole numbers, I from 1 to N";
    }
    shard = static_cast<int>(*i);
    shards = static_cast<int>(*n);
    return std::string();
  };
  return option;
}

void add_options(Command& command, ConvertOptions& o) {
  auto add = [&](std::string group, Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), std::move(group), std::move(initial)));
  };
  add("Output",
      text_option("-o,--output", "PATH", o.output,
                  "file to write, or a template with fields {dir} {stem} {ext} (of the input) {layout} {face} "
                  "{face_index} {size} {mip} {index}, or a folder with '/' at its end"));
  add("Output", layout_option("--to", o.layout, "layout of the output"), "cube");
  add("Output",
      packing_option("--packing", o.packing,
                     "how faces lie in the image; files: one file per face, with {face} in --output; parts: one "
                     "OpenEXR part per face, or the faces or layers of a DDS, KTX or KTX2 file"),
      "the layout's own; parts for DDS, KTX and KTX2");
  add("Output", frame_option("--frame", o.frame, "axes of the program that will use the output"), "world");
  add("Output", size_option(o.size), "auto");
  add("Output", count_option("--texels", "N", o.texels, std::int64_t{1} << 40,
                             "instead of --size: the largest size whose faces together hold at most N texels"));
  add("Output", type_option(o.write), "the nearest that the file format and the input share");
  add("Output",
      text_option("--compression", "NAME", o.write.compression,
                  "compression of the file format: zip, piz, dwaa:45 ... for OpenEXR, zstd:9 ... for KTX2; of bc6h the "
                  "effort, fast, normal or best, after a comma where both are given"),
      "the format's usual");
  add("Output", switch_option("--verify", o.write.verify, "read each output back before it takes its name"));
  add_level_options(command, o.levels);
  add_input_options(command, o.input);
  add("Pixels", rotate_option(o.rotation), "0,0,0");
  add("Pixels", filter_option(o.filter), "auto");
  add("Pixels", integer_option("--samples", "N", o.samples, 1, 64, "sub-samples a side of each output texel"),
      "as the filter chooses");
  add("Pixels", alpha_option(o.input.read.drop_alpha), "keep");
  add("Pixels", exposure_option(o.exposure), "0");
  add_color_options(command, o.color, "Colour");
  add("Pixels", nonfinite_option(o.nonfinite), "repair");
  add("Batch", text_option("--files-from", "FILE", o.files_from,
                           "read names of inputs from FILE, one a line; - is standard input"));
  add("Batch", switch_option("-0,--null", o.null_separated, "the names of --files-from end with a zero byte each"));
  add("Batch", shard_option(o.shard, o.shards));
  add("Batch",
      switch_option(
          "-n,--skip-existing", o.skip_existing,
          "leave outputs that exist, can be read to their end, are no older than their input, and are of the size, "
          "levels, layout, packing, frame, rotation, seam and --type asked for; other options are not compared"));
  add("Batch",
      switch_option("--keep-going", o.keep_going, "go on after a file that failed; the exit status is then 7"));
  add("Batch", switch_option("--dry-run", o.dry_run,
                             "read headers only, and print what would be done and how much memory it would take, and "
                             "of the disk where that is not enough"));
  add("General",
      count_option("--memory", "SIZE", o.memory, std::int64_t{1} << 50,
                   "bytes that may be held at one time: 1500M, 4G; pictures that do not fit are kept on the output's "
                   "disk meanwhile, and what needs more all the same is refused"),
      "three quarters of what is available");
  add("General", switch_option("--json", o.json,
                               "one JSON object on one line of stdout for each input, and for a batch a last one"));
  add("General", choice_option("--progress", "WHEN", o.progress, {"auto", "always", "never"}, "progress bar on stderr"),
      "auto: on a terminal");
  add_general_options(command, o.threads);
}

}  // namespace

Command convert_command() {
  auto options = std::make_shared<ConvertOptions>();
  Command command{
      .name = "convert",
      .summary = "read any layout, resample, write any layout",
      .operands = "INPUT...",
      .description =
          "Reads each INPUT, resamples it and writes it as --output says.  An INPUT with {face} "
          "in its name stands for one file per face: 'sky_{face}.exr'; - is standard input.  Several inputs make a "
          "batch, which needs a template or a folder as its output; its files are converted side by side "
          "and reported in their order.  The layout of an input is recognised from its metadata, its "
          "container or its proportions.",
      .reads_files = true};
  add_options(command, *options);
  command.run = [options](const std::vector<std::string>& named) {
    const Result<std::vector<std::string>> inputs = all_inputs(*options, named);
    if (!inputs) return fail(inputs.error());
    const Result<ConvertPlan> plan = make_plan(*options, *inputs);
    return plan ? run_plan(*plan) : fail(plan.error());
  };
  return command;
}

}  // namespace envconv::tool
