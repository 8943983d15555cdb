// SPDX-License-Identifier: Apache-2.0
// Transforms of pixels, and what a colour space is.
#include "color.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "color_impl.h"
#include "io_shared.h"

namespace envconv {

namespace ocio = OCIO_NAMESPACE;

// --- pixels ----------------------------------------------------------------------------------------------------------

struct ColorTransform::Processor {
  ocio::ConstCPUProcessorRcPtr cpu;
  bool linear = false;  // through the origin: it commutes with alpha
};

std::optional<std::array<int, 3>> color_channels(const Channels& channels) {
  const auto find = [&](const char* name) {
    const auto at = std::find(channels.names.begin(), channels.names.end(), name);
    return at == channels.names.end() ? -1 : static_cast<int>(at - channels.names.begin());
  };
  const std::array<int, 3> rgb{find("R"), find("G"), find("B")};
  if (rgb[0] >= 0 && rgb[1] >= 0 && rgb[2] >= 0) return rgb;
  const int y = find("Y");
  if (y >= 0) return std::array<int, 3>{y, y, y};
  return {};
}

namespace {

// Powers of subnormal numbers take several times as long as others, and no curve tells them from black.
void flush(float* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (std::abs(values[i]) < std::numeric_limits<float>::min()) values[i] = 0;
  }
}

}  // namespace

Result<Ok> ColorTransform::apply(Image& image, const Channels& channels) const {
  if (!processor_) return Ok{};
  const auto found = color_channels(channels);
  if (!found) return Error{ErrorCode::unsupported, "holds no colour (channels R, G, B or Y) to transform"};
  const std::array<int, 3> at = *found;
  const int alpha = processor_->linear ? -1 : channels.alpha, count = image.channels();
  const bool direct = count == 3 && at == std::array<int, 3>{0, 1, 2};
  const ocio::CPUProcessor& cpu = *processor_->cpu;
  tbb::parallel_for(0, image.height(), [&](int y) {
    if (direct) {
      if (!processor_->linear) flush(image.row(y), 3 * static_cast<std::size_t>(image.width()));
      ocio::PackedImageDesc row(image.row(y), image.width(), 1, 3);
      cpu.apply(row);
      return;
    }
    std::vector<float> colors(3 * static_cast<std::size_t>(image.width()));
    const auto cover = [&](const float* texel) { return alpha >= 0 && texel[alpha] > 0 ? texel[alpha] : 1.f; };
    float* texel = image.row(y);
    for (std::size_t i = 0; i < colors.size(); i += 3, texel += count) {
      for (std::size_t c = 0; c < 3; ++c) colors[i + c] = texel[at[c]] / cover(texel);
    }
    if (!processor_->linear) flush(colors.data(), colors.size());
    ocio::PackedImageDesc row(colors.data(), image.width(), 1, 3);
    cpu.apply(row);
    texel = image.row(y);
    for (std::size_t i = 0; i < colors.size(); i += 3, texel += count) {
      // Black under no cover stays what it is, whatever the curve makes of black.
      if (alpha >= 0 && !(texel[alpha] > 0) && texel[at[0]] == 0 && texel[at[1]] == 0 && texel[at[2]] == 0) continue;
      const float a = cover(texel);
      for (std::size_t c = 0; c < 3; ++c) texel[at[c]] = colors[i + c] * a;
    }
  });
  return Ok{};
}
// --- what a space is -------------------------------------------------------------------------------------------------

namespace {

ocio::ColorSpaceTransformRcPtr space_transform(const std::string& from, const std::string& to) {
  auto transform = ocio::ColorSpaceTransform::Create();
  transform->setSrc(from.c_str());
  transform->setDst(to.c_str());
  return transform;
}

using Function = std::function<Vec3(Vec3)>;  // stored values to linear RGB or XYZ of the interchange space

bool near(Vec3 a, Vec3 b, double tolerance) {
  return std::abs(a.x - b.x) <= tolerance && std::abs(a.y - b.y) <= tolerance && std::abs(a.z - b.z) <= tolerance;
}

// Linear through the origin, for values below and far above 1.
bool is_linear(const Function& f) {
  const Vec3 color{0.2, 0.5, 0.8}, once = f(color);
  for (const double factor : {0.0, 0.01, 4.0, 50.0}) {
    if (!near(f(factor * color), factor * once, 2e-4 * std::max(factor, 0.01) * length(once))) return false;
  }
  return true;
}

// Named primaries whose colours the function takes to where `matrix_of` says.
const Primaries* primaries_of(const Function& f,
                              const std::function<std::optional<Mat3>(const Chromaticities&)>& matrix_of) {
  for (const Primaries& primaries : all_primaries()) {
    const std::optional<Mat3> matrix = matrix_of(primaries.xy);
    bool same = matrix.has_value();
    for (const Vec3 color : {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}, Vec3{1, 1, 1}}) {
      same = same && near(f(color), *matrix * color, 3e-3);
    }
    if (same) return &primaries;
  }
  return nullptr;
}

// The curve of a space whose primaries are known, from greys: `white` is where 1 goes.
void find_curve(const Function& f, ColorEncoding& encoding) {
  const double white = f({1, 1, 1}).y;
  const auto grey = [&](double v) { return f({v, v, v}).y / white; };
  const double half = grey(0.5), dark = grey(0.02);
  if (std::abs(half - srgb_to_linear(0.5)) < 1e-4 && std::abs(dark - srgb_to_linear(0.02)) < 1e-5) {
    encoding.transfer = Transfer::srgb;
  } else if (half > 0 && half < 1) {
    const double gamma = std::log(half) / std::log(0.5);
    if (gamma < 0.1 || gamma > 10 || std::abs(dark - std::pow(0.02, gamma)) > 1e-2 * dark) return;
    encoding.transfer = Transfer::gamma;
    encoding.gamma = std::round(gamma * 1000) / 1000;
  }
}

}  // namespace

ColorEncoding ColorConfig::encoding_of(const ColorSpace& space) const {
  ColorEncoding encoding;
  if (space.name.empty()) {
    encoding.transfer = Transfer::linear;
    encoding.primaries = space.primaries;
    encoding.space = space_of(encoding);
    return encoding;
  }
  encoding.space = space.name;
  const auto found = impl_->config->getColorSpace(space.name.c_str());
  if (!found || found->isData()) return encoding;
  const bool display = found->getReferenceSpaceType() == ocio::REFERENCE_SPACE_DISPLAY;
  const std::string interchange = display ? impl_->display_interchange() : impl_->scene_interchange();
  const std::string target = interchange.empty() ? impl_->role("scene_linear") : interchange;
  if (target.empty()) return encoding;
  try {
    const auto cpu = impl_->processor(space_transform(space.name, target));
    const Function f = [&](Vec3 v) {
      float color[3] = {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
      cpu->applyRGB(color);
      return Vec3{color[0], color[1], color[2]};
    };
    const bool linear = is_linear(f);
    if (linear) encoding.transfer = Transfer::linear;
    if (interchange.empty()) return encoding;
    const auto matrix_of = [&](const Chromaticities& from) {
      return display ? xyz_from_rgb(from) : rgb_from_rgb(reference_primaries(), from);
    };
    if (const Primaries* primaries = primaries_of(f, matrix_of)) {
      encoding.primaries = primaries->xy;
      if (!linear) find_curve(f, encoding);
    } else if (linear && !display) {
      // Others, seen under the white of the reference.
      const Mat3 xyz = *xyz_from_rgb(reference_primaries());
      const Vec3 r = xyz * f({1, 0, 0}), g = xyz * f({0, 1, 0}), b = xyz * f({0, 0, 1}), w = xyz * f({1, 1, 1});
      const auto sum = [](Vec3 v) { return v.x + v.y + v.z; };
      const Chromaticities xy{r.x / sum(r), r.y / sum(r), g.x / sum(g), g.y / sum(g),
                              b.x / sum(b), b.y / sum(b), w.x / sum(w), w.y / sum(w)};
      if (xyz_from_rgb(xy)) encoding.primaries = xy;
    }
  } catch (const std::exception&) {
    // One-way tables, and spaces that lie apart: nothing is known of them.
  }
  return encoding;
}

ColorEncoding ColorConfig::encoding_of(const ColorView& view) const {
  const char* space = impl_->config->getDisplayViewColorSpaceName(view.display.c_str(), view.view.c_str());
  const std::string name = space && *space ? space : "";
  const bool shared = name == ocio::OCIO_VIEW_USE_DISPLAY_NAME;
  const auto found = impl_->config->getColorSpace((shared ? view.display : name).c_str());
  if (!found) return {};
  ColorEncoding encoding = encoding_of(ColorSpace{found->getName(), rec709()});
  return encoding;
}

Result<ColorSpace> ColorConfig::working_space(const ColorSpace& from, const std::optional<ColorSpace>& to) const {
  if (is_data(from)) return from;
  if (to && !is_data(*to) && encoding_of(*to).transfer == Transfer::linear) return *to;
  const ColorEncoding encoding = encoding_of(from);
  if (encoding.transfer == Transfer::linear) return from;
  if (encoding.primaries) return ColorSpace::linear(*encoding.primaries);
  const std::string linear = impl_->role("scene_linear");
  if (linear.empty()) {
    return color_usage(impl_->called() +
                       " has no role scene_linear, the space to resample in (choose a linear output)");
  }
  return ColorSpace{linear, rec709()};
}

// --- transforms ------------------------------------------------------------------------------------------------------

Result<ColorTransform> ColorConfig::transform(const ColorSpace& from, const ColorSpace& to) const {
  ColorTransform result;
  if (from == to || is_data(from) || is_data(to)) return result;
  const ColorEncoding a = encoding_of(from), b = encoding_of(to);
  const bool linear = a.transfer == Transfer::linear && b.transfer == Transfer::linear;
  // The same light by two names: the values must stay as they are, to the last bit.
  if (linear && a.primaries && a.primaries == b.primaries) return result;
  try {
    const auto group = ocio::GroupTransform::Create();
    if (from.name.empty() && to.name.empty()) {
      const auto matrix = rgb_from_rgb(to.primaries, from.primaries);
      if (!matrix) return color_usage("primaries that span no colours");
      group->appendTransform(matrix_transform(*matrix));
    } else {
      std::string name, target = to.name;
      ENVCONV_CHECK(impl_->start_at_name(from, *group, name));
      if (target.empty()) target = impl_->scene_interchange();
      if (target.empty()) return color_usage(impl_->no_interchange());
      group->appendTransform(space_transform(name, target));
      if (to.name.empty()) {
        const auto matrix = rgb_from_rgb(to.primaries, reference_primaries());
        if (!matrix) return color_usage("primaries that span no colours");
        group->appendTransform(matrix_transform(*matrix));
      }
    }
    auto processor = std::make_shared<ColorTransform::Processor>();
    processor->cpu = impl_->processor(group);
    processor->linear = linear;
    if (!processor->cpu->isNoOp()) result.processor_ = std::move(processor);
    return result;
  } catch (const std::exception& error) {
    return color_usage("no way from '" + printable(a.space) + "' to '" + printable(b.space) +
                       "': " + color_reason(error));
  }
}

Result<ColorTransform> ColorConfig::transform(const ColorSpace& from, const ColorView& to) const {
  ColorTransform result;
  if (is_data(from)) return result;
  try {
    const auto group = ocio::GroupTransform::Create();
    std::string name;
    ENVCONV_CHECK(impl_->start_at_name(from, *group, name));
    const auto view = ocio::DisplayViewTransform::Create();
    view->setSrc(name.c_str());
    view->setDisplay(to.display.c_str());
    view->setView(to.view.c_str());
    group->appendTransform(view);
    auto processor = std::make_shared<ColorTransform::Processor>();
    processor->cpu = impl_->processor(group);
    if (!processor->cpu->isNoOp()) result.processor_ = std::move(processor);
    return result;
  } catch (const std::exception& error) {
    return color_usage("view '" + printable(to.view) + "' of display '" + printable(to.display) +
                       "' cannot be used: " + color_reason(error));
  }
}

// --- inputs ----------------------------------------------------------------------------------------------------------

Result<InputColor> input_color(const ColorConfig& config, const PictureFile& file, const std::string& forced,
                               const std::string& named) {
  if (!forced.empty()) {
    ENVCONV_TRY(const ColorSpace space, config.find_space(forced));
    return InputColor{space, "as told"};
  }
  const ColorSpace linear = ColorSpace::linear(file.color_encoding.primaries.value_or(rec709()));
  const auto record = file.metadata.find("envconv:colorspace");
  if (record != file.metadata.end()) {
    if (!file.as_stored && file.color_encoding.space == record->second) return InputColor{linear, "recorded"};
    Result<ColorSpace> space = config.find_space(record->second);
    if (space) return InputColor{*space, "recorded"};
    const bool light = !file.as_stored || file.color_encoding.primaries.has_value();
    if (!light) {
      return Error{ErrorCode::input, printable(file.path) + ": its colour space is recorded as '" +
                                         printable(record->second) + "': " + space.error().message +
                                         " (--in-colorspace says otherwise)"};
    }
    return InputColor{linear, "linear, since its recorded space is unknown"};
  }
  if (!named.empty()) {
    ENVCONV_TRY(const ColorSpace space, config.find_space(named));
    return InputColor{space, "the file's name says so"};
  }
  return InputColor{linear, file.color_how};
}

}  // namespace envconv
