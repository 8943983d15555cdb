// SPDX-License-Identifier: Apache-2.0
// Colour management as the command line has it: options, what they come to before anything is read, and the two
// transforms of a conversion.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "color.h"
#include "command.h"
#include "image.h"
#include "io.h"

namespace envconv::tool {

/// As typed; "" where not given.
struct ColorOptions {
  std::string in, out, config, display, view;
};
/// --ocio-config alone, and all five.
void add_config_option(Command& command, ColorOptions& target, std::string group);
void add_color_options(Command& command, ColorOptions& target, const std::string& group);

/// The configuration, and names that are known to be in it.
struct ColorPlan {
  ColorConfig config = ColorConfig::embedded();
  std::string in;                    ///< --in-colorspace, or ""
  std::optional<ColorSpace> out;     ///< --out-colorspace
  std::optional<ColorView> view;     ///< --display and --view
  std::optional<ColorView> preview;  ///< for values above 1 in integer formats when nothing was asked for
};
/// Reads the configuration and checks all names, also against each other.  `inputs` are the inputs' first files, whose
/// names may name colour spaces.  Errors are ErrorCode::usage.
Result<ColorPlan> plan_color(const ColorOptions& options, const std::vector<std::string>& inputs);

/// The colour space that an input's name tells, or "", and reading options that go with it.
std::string named_space(const ColorPlan& plan, const std::string& path);
ReadOptions with_color(ReadOptions options, const ColorPlan& plan, const std::string& path);

/// What an input's colours are, and the linear space that they were taken to.
struct SourceColor {
  InputColor input;
  ColorSpace working;
  std::optional<Chromaticities> working_primaries;  ///< where they are known
  std::string text;                                 ///< the input's space in words
};
/// Decides what a file's colours are.  `path` is that of its first file.
Result<SourceColor> source_color(const ColorPlan& plan, const PictureFile& file, const std::string& path);
/// Takes pixels as they were read to the working space.
Result<Ok> to_working(const ColorPlan& plan, const SourceColor& color, const Channels& channels,
                      std::span<Image> images);

/// What becomes of the pixels on their way out.
struct OutputColor {
  std::optional<ColorView> view;
  bool is_preview = false;  ///< the view was not asked for
};
/// `peak` is the source's largest value when that matters (see wants_peak()), or 0.
OutputColor output_color(const ColorPlan& plan, const Channels& channels, PixelType type, float peak);
/// True where a preview may be made, so that the source's largest value decides.
bool wants_peak(const ColorPlan& plan, PixelType source, PixelType type);
/// Takes pixels from the working space to the output's, and tells `write` what they are then.
Result<Ok> to_output(const ColorPlan& plan, const OutputColor& output, const SourceColor& source, EnvImage& image,
                     WriteOptions& write);
/// "view 'V' of display 'D'".
std::string view_text(const ColorView& view);

}  // namespace envconv::tool
