// SPDX-License-Identifier: Apache-2.0
#include "embedded_metadata.h"

#include <algorithm>
#include <array>

#include "icc_profile.h"

namespace envconv {

bool take_icc_profile(std::span<const std::uint8_t> profile, PixelType stored, FileSpec& spec) {
  const auto color = read_icc_profile(profile);
  if (!color) return false;
  // Floating point is linear, whatever profile it was left with.
  if (stored != PixelType::float32 && stored != PixelType::half) {
    spec.transfer = color->transfer;
    spec.gamma = static_cast<float>(color->gamma);
  }
  spec.primaries = color->primaries;
  spec.color_how = "ICC profile";
  return true;
}

bool is_idle_xmp(std::string_view packet) {
  using namespace std::string_view_literals;
  // A zero: of an encoding with wide characters.
  constexpr std::array words{"Orientation"sv, "ColorSpace"sv, "Gamma"sv, "envconv:"sv, "\0"sv};
  return std::ranges::all_of(words, [&](std::string_view word) { return packet.find(word) == packet.npos; });
}

std::string own_description(std::string_view text) {
  constexpr std::size_t most = 4095;
  text = text.substr(0, std::min(text.find('\0'), most));
  return text.find("envconv:") == text.npos ? "" : std::string(text);
}

}  // namespace envconv
