// SPDX-License-Identifier: Apache-2.0
// Colour management, by OpenColorIO: a configuration names colour spaces, displays and views, and transforms pixels
// between them.  Resampling is done in linear light, so a conversion is: to a working space, resample, to the output.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "color_encoding.h"
#include "image.h"
#include "io.h"
#include "result.h"

namespace envconv {

/// A colour space: one that a configuration names, or linear light of given primaries, which needs no name.
struct ColorSpace {
  std::string name;  ///< the configuration's own spelling; "" for linear light of `primaries`
  Chromaticities primaries = rec709();

  static ColorSpace linear(const Chromaticities& primaries) { return {"", primaries}; }
  friend bool operator==(const ColorSpace&, const ColorSpace&) = default;
};

/// Where red, green and blue are among channels of those names, or three times where Y is; nothing where there is no
/// colour.
std::optional<std::array<int, 3>> color_channels(const Channels& channels);
inline bool has_color(const Channels& channels) { return color_channels(channels).has_value(); }

/// A display and one of its views.
struct ColorView {
  std::string display, view;
};

/// What is done to the pixels of an image.  Immutable and cheap to copy; any thread may use it.
class ColorTransform {
 public:
  /// Changes nothing.
  ColorTransform() = default;
  /// False when pixels change.
  bool is_identity() const { return !processor_; }
  /// Transforms colours in place, rows in parallel on TBB's threads.  Colour is taken off alpha before a transform that
  /// is not linear, and multiplied again; alpha and channels other than R, G, B or Y stay as they are.  A single Y is a
  /// grey.  Linear transforms keep negative and out-of-gamut values.  Error: unsupported, where there is no colour.
  Result<Ok> apply(Image& image, const Channels& channels) const;

 private:
  friend class ColorConfig;
  struct Processor;
  std::shared_ptr<const Processor> processor_;
};

/// A configuration.  Immutable and cheap to copy; any thread may use it.  Errors are ErrorCode::usage and carry
/// OpenColorIO's own text, or limit where memory ran out (functions without a Result then throw std::bad_alloc, as
/// strings do).  A configuration is trusted: it may name any file as a lookup table.
class ColorConfig {
 public:
  /// Made from OpenColorIO's built-in transforms; its names are those of the ASWF's configuration for computer
  /// graphics.
  static ColorConfig embedded();
  /// Reads a file.  Also an error where the C++ global locale has another decimal point than '.': OpenColorIO would
  /// misread the file's numbers.
  static Result<ColorConfig> from_file(const std::string& path);
  /// The file that $OCIO names when that is set and not empty (an error when it cannot be read), else embedded().
  static Result<ColorConfig> from_environment();

  /// The file's path, or "" for the embedded one.
  const std::string& path() const;
  /// Names of the active spaces (scene and display), of displays, and of a display's views, in the configuration's
  /// order.
  std::vector<std::string> spaces() const;
  std::vector<std::string> aliases(const std::string& space) const;
  std::string description(const std::string& space) const;
  std::vector<std::string> displays() const;
  std::vector<std::string> views(const std::string& display) const;

  /// The space of that name, alias or role, once it is certain that its transforms can be used.  The error suggests
  /// near names, or lists all.
  Result<ColorSpace> find_space(const std::string& name) const;
  /// An empty display or view stands for the default one.  Checks names only: transform() finds what a view lacks.
  Result<ColorView> find_view(const std::string& display, const std::string& view) const;
  /// The space that the configuration's rules find in a file's name, or "" when only their default would do.  A space's
  /// name counts where it stands as a word of its own in the last part of the path; one for data never does.
  std::string space_from_name(const std::string& path) const;
  /// True for spaces whose values are no colours.
  bool is_data(const ColorSpace& space) const;

  /// Curve and primaries of a space or of a view's display, found by transforming a few colours: unknown where they are
  /// not among those that file formats have words for, or where the configuration does not say how its reference is
  /// related to ACES2065-1 (role aces_interchange) or to CIE XYZ (cie_xyz_d65_interchange).
  ColorEncoding encoding_of(const ColorSpace& space) const;
  ColorEncoding encoding_of(const ColorView& view) const;

  /// The linear space to resample in on the way from a space: that of the output when it is linear, else the input's
  /// primaries, else the role scene_linear.
  Result<ColorSpace> working_space(const ColorSpace& from, const std::optional<ColorSpace>& to) const;

  Result<ColorTransform> transform(const ColorSpace& from, const ColorSpace& to) const;
  Result<ColorTransform> transform(const ColorSpace& from, const ColorView& to) const;

 private:
  struct Impl;
  explicit ColorConfig(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// In which space the pixels of a file are, and how that is known.
struct InputColor {
  ColorSpace space;
  std::string how;  ///< "as --in-colorspace says", "floating point", "chromaticities" ...
};
/// Decides for a file that was read: `forced` (a space's name, with the values read as stored) when not empty, else
/// what envconv recorded, else the file's name (`named`, likewise), else what the format says, else integers are sRGB
/// and floats linear Rec. 709.  Error: input, where values were stored in a space that the configuration lacks.
Result<InputColor> input_color(const ColorConfig& config, const PictureFile& file, const std::string& forced,
                               const std::string& named);

}  // namespace envconv
