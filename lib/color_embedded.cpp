// SPDX-License-Identifier: Apache-2.0
// Names are those of the Academy Software Foundation's configuration for computer graphics (cg-config), so that what
// people know works here, and what is written here is understood there.
#include "color_embedded.h"

#include <initializer_list>
#include <string>

#include "color_encoding.h"

namespace envconv {
namespace {

namespace ocio = OCIO_NAMESPACE;

ocio::BuiltinTransformRcPtr builtin(const char* style) {
  auto transform = ocio::BuiltinTransform::Create();
  transform->setStyle(style);
  return transform;
}

class Builder {
 public:
  Builder() : config_(ocio::Config::Create()) {
    config_->setVersion(2, 1);
    config_->setName("envconv");
    config_->setDescription("envconv's own configuration; the reference space is ACES2065-1");
  }

  void add(ocio::ReferenceSpaceType type, std::string_view name, const char* encoding, const char* description,
           std::initializer_list<const char*> aliases, const ocio::ConstTransformRcPtr& transform,
           ocio::ColorSpaceDirection direction = ocio::COLORSPACE_DIR_TO_REFERENCE) {
    auto space = ocio::ColorSpace::Create(type);
    space->setName(std::string(name).c_str());
    space->setEncoding(encoding);
    space->setDescription(description);
    space->setBitDepth(ocio::BIT_DEPTH_F32);
    for (const char* alias : aliases) space->addAlias(alias);
    if (transform) space->setTransform(transform, direction);
    config_->addColorSpace(space);
  }
  void add_linear(const Primaries& primaries, const char* description, std::initializer_list<const char*> aliases) {
    const Chromaticities& reference = find_named_primaries("aces-ap0").xy;
    ocio::ConstTransformRcPtr transform;
    if (primaries.xy != reference) transform = matrix_transform(*rgb_from_rgb(reference, primaries.xy));
    add(ocio::REFERENCE_SPACE_SCENE, primaries.space, "scene-linear", description, aliases, transform);
  }
  // Rec. 709 primaries behind a curve from stored value to light.
  void add_texture(std::string_view name, const char* description, std::initializer_list<const char*> aliases,
                   const ocio::ConstTransformRcPtr& curve) {
    auto group = ocio::GroupTransform::Create();
    group->appendTransform(curve->createEditableCopy());
    group->appendTransform(matrix_transform(*rgb_from_rgb(find_named_primaries("aces-ap0").xy, rec709())));
    add(ocio::REFERENCE_SPACE_SCENE, name, "sdr-video", description, aliases, group);
  }
  void add_gamma(double gamma, std::string_view name, const char* description,
                 std::initializer_list<const char*> aliases) {
    auto curve = ocio::ExponentTransform::Create();
    const double values[4] = {gamma, gamma, gamma, 1};
    curve->setValue(values);
    curve->setNegativeStyle(ocio::NEGATIVE_MIRROR);
    add_texture(name, description, aliases, curve);
  }
  void add_view_transform(const char* name, const char* style) {
    auto transform = ocio::ViewTransform::Create(ocio::REFERENCE_SPACE_SCENE);
    transform->setName(name);
    transform->setTransform(builtin(style), ocio::VIEWTRANSFORM_DIR_FROM_REFERENCE);
    config_->addViewTransform(transform);
  }
  ocio::Config& config() { return *config_; }
  ocio::ConstConfigRcPtr result() { return config_; }

 private:
  ocio::ConfigRcPtr config_;
};

void add_scene_spaces(Builder& b) {
  b.add_linear(find_named_primaries("aces-ap0"), "ACES interchange: linear light, AP0 primaries, ACES white",
               {"aces2065_1", "ACES - ACES2065-1", "lin_ap0"});
  b.add_linear(find_named_primaries("aces-ap1"), "linear light, AP1 primaries, ACES white",
               {"ACES - ACEScg", "lin_ap1"});
  b.add_linear(find_named_primaries("rec709"), "linear light, primaries of Rec. 709 and sRGB, D65",
               {"lin_rec709", "lin_rec709_srgb", "lin_srgb", "Linear Rec.709", "Utility - Linear - Rec.709",
                "Utility - Linear - sRGB"});
  b.add_linear(find_named_primaries("rec2020"), "linear light, primaries of Rec. 2020, D65",
               {"lin_rec2020", "Utility - Linear - Rec.2020"});
  b.add_linear(find_named_primaries("p3-d65"), "linear light, P3 primaries, D65",
               {"lin_p3d65", "lin_displayp3", "Utility - Linear - P3-D65"});

  // IEC 61966-2-1 with the curve mirrored for negative values, so that it can be undone.
  auto srgb = ocio::ExponentWithLinearTransform::Create();
  const double gamma[4] = {2.4, 2.4, 2.4, 1}, offset[4] = {0.055, 0.055, 0.055, 0};
  srgb->setGamma(gamma);
  srgb->setOffset(offset);
  srgb->setNegativeStyle(ocio::NEGATIVE_MIRROR);
  b.add_texture(kSrgbSpace, "sRGB curve (IEC 61966-2-1), Rec. 709 primaries",
                {"srgb_tx", "srgb_texture", "sRGB", "Utility - sRGB - Texture"}, srgb);
  b.add_gamma(2.4, "Gamma 2.4 Rec.709 - Texture",
              "Rec. 709 pictures as a display shows them: gamma 2.4 (Rec. 1886), not the camera's curve",
              {"g24_rec709", "g24_rec709_tx", "rec709_tx", "Utility - Rec.709 - Texture"});
  b.add_gamma(2.2, "Gamma 2.2 Rec.709 - Texture", "gamma 2.2, Rec. 709 primaries", {"g22_rec709", "g22_rec709_tx"});
  b.add_gamma(1.8, "Gamma 1.8 Rec.709 - Texture", "gamma 1.8, Rec. 709 primaries", {"g18_rec709", "g18_rec709_tx"});

  auto raw = ocio::ColorSpace::Create(ocio::REFERENCE_SPACE_SCENE);
  raw->setName("Raw");
  raw->addAlias("Utility - Raw");
  raw->setEncoding("data");
  raw->setDescription("data that is no colour: never transformed");
  raw->setIsData(true);
  b.config().addColorSpace(raw);
}

void add_displays(Builder& b) {
  b.add(ocio::REFERENCE_SPACE_DISPLAY, "CIE-XYZ-D65", "display-linear", "the reference of displays: CIE XYZ, D65",
        {"cie_xyz_d65"}, nullptr);
  struct Display {
    const char *name, *alias, *style, *description;
  };
  for (const Display& display :
       {Display{"sRGB - Display", "srgb_display", "DISPLAY - CIE-XYZ-D65_to_sRGB", "an sRGB monitor"},
        Display{"Rec.1886 Rec.709 - Display", "rec1886_rec709_display", "DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.709",
                "an HD television: gamma 2.4, Rec. 709 primaries"}}) {
    b.add(ocio::REFERENCE_SPACE_DISPLAY, display.name, "sdr-video", display.description, {display.alias},
          builtin(display.style), ocio::COLORSPACE_DIR_FROM_REFERENCE);
    const std::pair<const char*, const char*> views[] = {{"ACES 1.0 - SDR Video", "ACES 1.0 - SDR Video"},
                                                         {"Un-tone-mapped", "Un-tone-mapped"}};
    for (const auto& [view, transform] : views) {
      b.config().addDisplayView(display.name, view, transform, display.name, "", "", "");
    }
    b.config().addDisplayView(display.name, "Raw", "Raw", "");
  }
  b.add_view_transform("ACES 1.0 - SDR Video", "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0");
  b.add_view_transform("Un-tone-mapped", "UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD");
  b.config().setDefaultViewTransformName("Un-tone-mapped");
}

}  // namespace

ocio::MatrixTransformRcPtr matrix_transform(const Mat3& matrix) {
  auto transform = ocio::MatrixTransform::Create();
  double values[16] = {};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) values[4 * row + column] = matrix.m[3 * row + column];
  }
  values[15] = 1;
  transform->setMatrix(values);
  return transform;
}

ocio::ConstConfigRcPtr embedded_config() {
  Builder b;
  add_scene_spaces(b);
  add_displays(b);
  const std::string linear(kLinearSpace);
  for (const char* role : {"scene_linear", "default", "rendering"}) b.config().setRole(role, linear.c_str());
  b.config().setRole("data", "Raw");
  b.config().setRole("texture_paint", std::string(kSrgbSpace).c_str());
  b.config().setRole("aces_interchange", "ACES2065-1");
  b.config().setRole("cie_xyz_d65_interchange", "CIE-XYZ-D65");
  return b.result();
}

}  // namespace envconv
