// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cmath>
#include <string_view>

#include "recognize_shared.h"

namespace envconv {
namespace {

// A whole number in [least, most], or 0.
int parse_count(const std::string& text, int least, int most) {
  int number = 0;
  const std::from_chars_result r = std::from_chars(text.data(), text.data() + text.size(), number);
  return r.ec == std::errc() && r.ptr == text.data() + text.size() && number >= least && number <= most ? number : 0;
}

bool parse(std::string_view words, Rotation& rotation) {
  const char *at = words.data(), *end = at + words.size();
  double* const angles[] = {&rotation.yaw, &rotation.pitch, &rotation.roll};
  for (int i = 0; i < 3; ++i) {
    if (i > 0 && (at == end || *at++ != ',')) return false;
    const std::from_chars_result r = std::from_chars(at, end, *angles[i]);
    if (r.ec != std::errc() || !std::isfinite(*angles[i])) return false;
    at = r.ptr;
  }
  return at == end;
}

}  // namespace

Recorded read_metadata(const Metadata& metadata, std::vector<std::string>& warnings) {
  Recorded recorded;
  const auto read = [&](const char* key, auto find, auto& into) {
    const auto entry = metadata.find(key);
    if (entry == metadata.end()) return;
    if (const auto* found = find(entry->second))
      into = found;
    else
      warnings.push_back(text(key) + " is \"" + entry->second + "\", which is unknown: ignored");
  };
  read("envconv:layout", find_layout, recorded.layout);
  read("envconv:packing", find_packing, recorded.packing);
  read("envconv:frame", find_frame, recorded.frame);
  if (const auto entry = metadata.find("envconv:rotation"); entry != metadata.end()) {
    if (Rotation rotation; parse(entry->second, rotation))
      recorded.rotation = rotation;
    else
      warnings.push_back("envconv:rotation is \"" + entry->second + "\", not three angles: ignored");
  }
  if (const auto entry = metadata.find("envconv:seam"); entry != metadata.end()) {
    if (const Result<Seam> seam = parse_seam(entry->second))
      recorded.levels.seam = *seam;
    else
      warnings.push_back("envconv:seam is \"" + entry->second + "\", which is unknown: ignored");
  }
  if (const auto entry = metadata.find("envconv:size"); entry != metadata.end())
    recorded.levels.height = parse_count(entry->second, 1, 1 << 24);
  if (const auto entry = metadata.find("envconv:level"); entry != metadata.end())
    recorded.levels.level = parse_count(entry->second, 0, 31);
  return recorded;
}

Metadata metadata_of(const Layout& layout, const Packing& packing, const Frame& frame, const Rotation& rotation,
                     const RecordedLevels& levels) {
  Metadata metadata{{"envconv:layout", text(layout.name())},
                    {"envconv:packing", text(packing.name)},
                    {"envconv:frame", text(frame.name)},
                    {"envconv:rotation", text(rotation.yaw) + "," + text(rotation.pitch) + "," + text(rotation.roll)}};
  if (levels.seam.method != SeamMethod::none) metadata["envconv:seam"] = text_of(levels.seam);
  if (levels.height > 0) metadata["envconv:size"] = std::to_string(levels.height);
  if (levels.level > 0) metadata["envconv:level"] = std::to_string(levels.level);
  // These two layouts are OpenEXR's own pictures as they stand; another frame would turn or mirror them, and gutters
  // move them.
  if (frame.name == "world" && levels.seam.gutter() == 0) {
    if (layout.name() == "latlong-inclusive") metadata["envmap"] = "latlong";
    if (layout.name() == "openexr-cube" && packing.name == "column") metadata["envmap"] = "cube";
  }
  return metadata;
}

}  // namespace envconv
