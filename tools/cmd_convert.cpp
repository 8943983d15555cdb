// SPDX-License-Identifier: Apache-2.0
// envconv convert: read any layout, resample, write any layout.
#include <unistd.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>

#include "convert.h"
#include "progress.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

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
  add("Batch",
      switch_option("-n,--skip-existing", o.skip_existing, "leave outputs that exist and can be read to their end"));
  add("Batch",
      switch_option("--keep-going", o.keep_going, "go on after a file that failed; the exit status is then 7"));
  add("Batch", switch_option("--dry-run", o.dry_run, "read headers only, and print what would be done"));
  add("General", switch_option("--json", o.json, "one JSON object on one line of stdout for each input"));
  add("General", choice_option("--progress", "WHEN", o.progress, {"auto", "always", "never"}, "progress bar on stderr"),
      "auto: on a terminal");
  add_general_options(command, o.threads);
}

// What is known of a job, done or planned.
ordered_json json_of(const ConvertPlan& plan, const Job& job, const Shape* shape) {
  ordered_json json{{"input", job.input.name}, {"output", job.output}, {"files", job.paths}};
  json["layout"] = plan.options.layout->name();
  json["packing"] = plan.options.packing->name;
  json["frame"] = plan.options.frame->name;
  if (!shape || !shape->source.layout) return json;
  json["size"] = shape->height;
  ordered_json faces = ordered_json::array();
  for (std::size_t i = 0; i < shape->faces.size(); ++i) {
    faces.push_back({{"name", plan.options.layout->info().faces[i].name},
                     {"width", shape->faces[i].width},
                     {"height", shape->faces[i].height}});
  }
  json["faces"] = faces;
  json["levels"] = shape->levels;
  json["seam"] = text_of(plan.options.levels.seam);
  json["source"] = {{"layout", shape->source.layout->name()},
                    {"packing", shape->source.packing->name},
                    {"frame", shape->source.frame->name},
                    {"size", shape->source.height},
                    {"width", shape->image.width},
                    {"height", shape->image.height},
                    {"channels", shape->channels},
                    {"colorspace", shape->color.text},
                    {"how", shape->source.how}};
  return json;
}

void print_json(const ordered_json& json) {
  print(json.dump(-1, ' ', false, ordered_json::error_handler_t::replace) + "\n");
}

std::string sentence(const ConvertPlan& plan, const Job& job, const Shape& shape) {
  return job.input.name + ": " + std::string(shape.source.layout->name()) + " " + std::to_string(shape.image.width) +
         "x" + std::to_string(shape.image.height) + ", " + shape.source.how + ", " + shape.color.text + ", to " +
         std::string(plan.options.layout->name()) + ", " + std::to_string(shape.faces.size()) +
         (shape.faces.size() == 1 ? " face" : " faces") + " of " + std::to_string(shape.faces.front().width) + "x" +
         std::to_string(shape.faces.front().height) +
         (shape.levels > 1 ? ", " + std::to_string(shape.levels) + " levels" : "") + ", as " +
         std::string(plan.options.packing->name) + ": " + job.output;
}

int print_plan(const ConvertPlan& plan) {
  int failed = 0, status = 0;
  for (const Job& job : plan.jobs) {
    const Result<Shape> shape = job.error ? Result<Shape>(*job.error) : read_shape(plan, job);
    if (!shape) {
      status = fail(shape.error());
      ++failed;
    }
    if (plan.options.json) {
      ordered_json json = json_of(plan, job, shape ? &*shape : nullptr);
      json["dry_run"] = true;
      if (shape) json["peak_bytes"] = shape->peak_bytes;
      json["error"] = shape ? ordered_json() : ordered_json(shape.error().message);
      print_json(json);
    } else if (shape) {
      print(visible(sentence(plan, job, *shape)) + "; " + number_text(static_cast<double>(shape->peak_bytes) / 1e6, 3) +
            " MB of pixels\n");
    }
    if (failed && !plan.options.keep_going) break;
  }
  return failed && plan.options.keep_going && plan.jobs.size() > 1 ? 7 : status;
}

int run_plan(const ConvertPlan& plan) {
  const ConvertOptions& o = plan.options;
  const bool bar = o.progress == "always" || (o.progress == "auto" && verbosity() >= 0 && isatty(STDERR_FILENO));
  Progress progress(bar, static_cast<int>(plan.jobs.size()));
  int status = 0, failed = 0, skipped = 0;
  for (std::size_t i = 0; i < plan.jobs.size(); ++i) {
    const Job& job = plan.jobs[i];
    const auto start = std::chrono::steady_clock::now();
    const Result<Outcome> outcome = run_job(
        plan, job, [&](double texels) { progress.begin(job.input.name, static_cast<int>(i), texels); },
        [&](double share) {
          progress.update(share);
          return true;
        });
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    progress.hide();
    if (outcome) {
      for (const std::string& warning : outcome->warnings) warn(job.input.name, warning);
      if (outcome->skipped) {
        ++skipped;
        remark(job.input.name + ": skipped, since " + job.output + " exists");
      } else {
        remark(sentence(plan, job, outcome->shape) + ", " + std::string(name_of(outcome->type)) + ", " +
               number_text(seconds, 3) + " s");
      }
    } else {
      status = fail(outcome.error());
      ++failed;
    }
    if (o.json) {
      ordered_json json = json_of(plan, job, outcome ? &outcome->shape : nullptr);
      if (outcome) {
        if (outcome->skipped) {
          json["skipped"] = true;
        } else {
          json["type"] = name_of(outcome->type);
          json["colorspace"] = outcome->color.empty() ? ordered_json() : ordered_json(outcome->color);
          if (outcome->seam) json["seam_error"] = {{"largest", outcome->seam->error}, {"level", outcome->seam->level}};
        }
      }
      json["seconds"] = seconds;
      json["warnings"] = outcome ? outcome->warnings : std::vector<std::string>{};
      json["error"] = outcome ? ordered_json() : ordered_json(outcome.error().message);
      if (!outcome) json["status"] = static_cast<int>(outcome.error().code);
      print_json(json);
    }
    if (failed && !o.keep_going) break;
  }
  if (plan.jobs.size() > 1 && verbosity() >= 0 && (failed || verbosity() > 0)) {
    const std::size_t done = plan.jobs.size() - static_cast<std::size_t>(failed + skipped);
    if (o.keep_going || !failed) {
      complain(std::to_string(plan.jobs.size()) + " inputs: " + std::to_string(done) + " converted, " +
               std::to_string(skipped) + " skipped, " + std::to_string(failed) + " failed");
    }
  }
  return failed && o.keep_going && plan.jobs.size() > 1 ? 7 : status;
}

}  // namespace

Command convert_command() {
  auto options = std::make_shared<ConvertOptions>();
  Command command{.name = "convert",
                  .summary = "read any layout, resample, write any layout",
                  .operands = "INPUT...",
                  .min_operands = 1,
                  .description =
                      "Reads each INPUT, resamples it and writes it as --output says.  An INPUT with {face} "
                      "in its name stands for one file per face: 'sky_{face}.exr'.  Several inputs make a "
                      "batch, which needs a template or a folder as its output.  The layout of an input is "
                      "recognised from its metadata, its container or its proportions.",
                  .reads_files = true};
  add_options(command, *options);
  command.run = [options](const std::vector<std::string>& inputs) {
    const Result<ConvertPlan> plan = make_plan(*options, inputs);
    if (!plan) return fail(plan.error());
    return options->dry_run ? print_plan(*plan) : run_plan(*plan);
  };
  return command;
}

}  // namespace envconv::tool
