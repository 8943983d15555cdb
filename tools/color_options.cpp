// SPDX-License-Identifier: Apache-2.0
#include "color_options.h"

#include <algorithm>

#include "options.h"

namespace envconv::tool {
namespace {

Error usage(const std::string& option, const std::string& what) { return {ErrorCode::usage, option + ": " + what}; }

bool is_display_type(PixelType type) { return type == PixelType::uint8 || type == PixelType::uint16; }

// The space, or its curve and primaries where it has no name.
std::string space_text(const PictureFile& file, const InputColor& input) {
  if (!input.space.name.empty()) return input.space.name;
  if (!file.color_encoding.space.empty()) return file.color_encoding.space;
  const Primaries* primaries = find_primaries(input.space.primaries);
  return file.color + ", " + (primaries ? std::string(primaries->name) : "other") + " primaries";
}

// Every input whose space is not named must have a way to the output.
Result<Ok> check_way(const ColorPlan& plan, const std::vector<std::string>& inputs) {
  if (!plan.out && !plan.view && plan.in.empty()) return Ok{};
  std::vector<ColorSpace> sources;
  if (!plan.in.empty()) {
    ENVCONV_TRY(ColorSpace in, plan.config.find_space(plan.in));
    sources.push_back(std::move(in));
  }
  for (std::size_t i = 0; i < inputs.size() && plan.in.empty(); ++i) {
    const std::string name = plan.config.space_from_name(inputs[i]);
    const ColorSpace source = name.empty() ? ColorSpace::linear(rec709()) : ColorSpace{name, rec709()};
    if (std::find(sources.begin(), sources.end(), source) == sources.end()) sources.push_back(source);
  }
  for (const ColorSpace& source : sources) {
    ENVCONV_TRY(const ColorSpace working, plan.config.working_space(source, plan.out));
    ENVCONV_CHECK(plan.config.transform(source, working));
    if (plan.out) ENVCONV_CHECK(plan.config.transform(working, *plan.out));
    if (plan.view) ENVCONV_CHECK(plan.config.transform(working, *plan.view));
  }
  return Ok{};
}

}  // namespace

void add_config_option(Command& command, ColorOptions& target, std::string group) {
  command.options.push_back(
      in_group(text_option("--ocio-config", "FILE", target.config, "OpenColorIO configuration, a trusted file"),
               std::move(group), "$OCIO, or the one that is built in"));
}

void add_color_options(Command& command, ColorOptions& target, const std::string& group) {
  const auto add = [&](Option option, std::string initial) {
    command.options.push_back(in_group(std::move(option), group, std::move(initial)));
  };
  add(text_option("--in-colorspace", "NAME", target.in,
                  "colour space of the input's values as they are stored: a name, alias or role of the configuration"),
      "told by the file, or sRGB for integers and linear Rec. 709 for floating point");
  add(text_option("--out-colorspace", "NAME", target.out, "colour space of the output's values as they are stored"),
      "sRGB for integers, the input's linear light for floating point");
  add_config_option(command, target, group);
  add(text_option("--display", "NAME", target.display, "display that --view is for"), "the configuration's first");
  add(text_option("--view", "NAME", target.view,
                  "store what a display shows through this view, for previews; none clips what is too bright for "
                  "integers"),
      "none; the display's first view when values above 1 go to integers");
}

Result<ColorPlan> plan_color(const ColorOptions& options, const std::vector<std::string>& inputs) {
  const bool none = options.view == "none";
  if (!options.out.empty() && (!options.display.empty() || (!options.view.empty() && !none))) {
    return usage("--out-colorspace", "a view has an output space of its own (leave --display and --view out)");
  }
  if (none && !options.display.empty()) return usage("--display", "means nothing with --view none");
  ColorPlan plan;
  if (options.config.empty()) {
    ENVCONV_TRY(plan.config, ColorConfig::from_environment());
  } else {
    ENVCONV_TRY(plan.config, ColorConfig::from_file(options.config));
  }
  const auto named = [](const char* option, const auto& found) { return usage(option, found.error().message); };
  if (!options.in.empty()) {
    const auto found = plan.config.find_space(options.in);
    if (!found) return named("--in-colorspace", found);
    plan.in = found->name;
  }
  if (!options.out.empty()) {
    const auto found = plan.config.find_space(options.out);
    if (!found) return named("--out-colorspace", found);
    plan.out = *found;
  } else if (!none) {
    const bool asked = !options.display.empty() || !options.view.empty();
    const auto found = plan.config.find_view(options.display, options.view);
    if (!found && asked) return named(options.view.empty() ? "--display" : "--view", found);
    if (found) (asked ? plan.view : plan.preview) = *found;
  }
  ENVCONV_CHECK(check_way(plan, inputs));
  return plan;
}

std::string named_space(const ColorPlan& plan, const std::string& path) {
  return plan.in.empty() ? plan.config.space_from_name(path) : "";
}

ReadOptions with_color(ReadOptions options, const ColorPlan& plan, const std::string& path) {
  options.as_stored = !plan.in.empty() || !named_space(plan, path).empty();
  return options;
}

Result<SourceColor> source_color(const ColorPlan& plan, const PictureFile& file, const std::string& path) {
  SourceColor color;
  ENVCONV_TRY(color.input, input_color(plan.config, file, plan.in, named_space(plan, path)));
  ENVCONV_TRY(color.working, plan.config.working_space(color.input.space, plan.out));
  color.working_primaries = plan.config.encoding_of(color.working).primaries;
  color.text = space_text(file, color.input);
  return color;
}

Result<Ok> to_working(const ColorPlan& plan, const SourceColor& color, const Channels& channels,
                      std::span<Image> images) {
  ENVCONV_TRY(const ColorTransform transform, plan.config.transform(color.input.space, color.working));
  for (Image& image : images) ENVCONV_CHECK(transform.apply(image, channels));
  return Ok{};
}

bool wants_peak(const ColorPlan& plan, PixelType source, PixelType type) {
  return plan.preview && !plan.out && !plan.view && is_display_type(type) && !is_display_type(source);
}

OutputColor output_color(const ColorPlan& plan, const Channels& channels, PixelType type, float peak) {
  if (plan.view) return {plan.view, false};
  // What is above 1 by less than half a step of 8 bits rounds to 1: nothing would be clipped.
  constexpr float white = 1.0045f;
  if (plan.preview && !plan.out && is_display_type(type) && has_color(channels) && peak > white) {
    return {plan.preview, true};
  }
  return {};
}

Result<Ok> to_output(const ColorPlan& plan, const OutputColor& output, const SourceColor& source, EnvImage& image,
                     WriteOptions& write) {
  const bool asked = plan.out || plan.view;
  if (!asked && !has_color(image.channels)) return Ok{};
  const bool data = plan.config.is_data(source.working);
  ColorTransform transform;
  if (output.view) {
    ENVCONV_TRY(transform, plan.config.transform(source.working, *output.view));
    write.color = plan.config.encoding_of(*output.view);
    // Files of a usual display are read as any other of its kind.
    if (const std::string_view usual = space_of(write.color); !usual.empty()) write.color.space = usual;
    write.metadata["envconv:view"] = output.view->view + " (" + output.view->display + ")";
  } else if (plan.out) {
    ENVCONV_TRY(transform, plan.config.transform(source.working, *plan.out));
    write.color = plan.config.encoding_of(*plan.out);
  } else if (is_display_type(write.type) && !data) {
    ENVCONV_TRY(transform, plan.config.transform(source.working, ColorSpace::linear(rec709())));
    write.color = {std::string(kSrgbSpace), Transfer::srgb, 1, rec709()};
    write.encoding = Encoding::srgb;
  } else {
    write.color = plan.config.encoding_of(source.working);
  }
  if (output.view || plan.out || data) write.encoding = Encoding::as_is;
  for (Image& face : image.faces) ENVCONV_CHECK(transform.apply(face, image.channels));
  return Ok{};
}

std::string view_text(const ColorView& view) { return "view '" + view.view + "' of display '" + view.display + "'"; }

}  // namespace envconv::tool
