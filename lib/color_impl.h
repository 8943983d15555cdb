// SPDX-License-Identifier: Apache-2.0
// What the files of colour management share.  These alone include OpenColorIO.  Internal: not installed.
#pragma once

#include <exception>
#include <string>

#include "color.h"
#include "color_embedded.h"
#include "output_file.h"

namespace envconv {

Error color_usage(std::string what);

/// What is wrong, with OpenColorIO's text in one line after it: an error of ErrorCode::usage, or of limit where memory
/// ran out.
Error color_failure(std::string what, const std::exception& error);

/// Linear light of ACES2065-1, to which everything else is related.
inline const Chromaticities& reference_primaries() { return find_named_primaries("aces-ap0").xy; }

struct ColorConfig::Impl {
  std::string path;
  OCIO_NAMESPACE::ConstConfigRcPtr config;

  // The space that stands for ACES2065-1, or "".
  std::string scene_interchange() const {
    for (const char* name : {"aces_interchange", "ACES2065-1", "ACES - ACES2065-1"}) {
      if (const auto space = config->getColorSpace(name)) return space->getName();
    }
    return {};
  }
  std::string display_interchange() const {
    const auto space = config->getColorSpace("cie_xyz_d65_interchange");
    return space ? space->getName() : "";
  }
  std::string role(const char* name) const {
    const auto space = config->getColorSpace(name);
    return space ? space->getName() : "";
  }
  std::string called() const { return path.empty() ? "the embedded configuration" : printable(path); }

  // Throws what OpenColorIO throws.
  OCIO_NAMESPACE::ConstCPUProcessorRcPtr processor(const OCIO_NAMESPACE::ConstTransformRcPtr& transform) const;
  // Appends what takes values of a space to a named one; `named` becomes that name.
  Result<Ok> start_at_name(const ColorSpace& from, OCIO_NAMESPACE::GroupTransform& group, std::string& named) const {
    named = from.name;
    if (!named.empty()) return Ok{};
    named = scene_interchange();
    if (named.empty()) return color_usage(no_interchange());
    const auto matrix = rgb_from_rgb(reference_primaries(), from.primaries);
    if (!matrix) return color_usage("primaries that span no colours");
    group.appendTransform(matrix_transform(*matrix));
    return Ok{};
  }
  std::string no_interchange() const {
    return called() +
           " does not say where linear Rec. 709 lies: it has neither the role aces_interchange nor a space ACES2065-1 "
           "(name the input's space with --in-colorspace, and the output's)";
  }
};

}  // namespace envconv
