// SPDX-License-Identifier: Apache-2.0
// The only files that include OpenColorIO are this one and color_embedded.
#include "color.h"

#include <sys/stat.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <locale>
#include <mutex>
#include <span>

#include "color_embedded.h"
#include "io_shared.h"
#include "output_file.h"

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

// --- configurations
// ----------------------------------------------------------------------------------------------------

namespace {

Error usage(std::string what) { return {ErrorCode::usage, std::move(what)}; }

// OpenColorIO's text in one line.
std::string reason(const std::exception& error) {
  std::string text;
  for (const char* p = error.what(); *p; ++p) {
    if (*p != '\n') {
      text += *p;
    } else if (!text.empty() && text.back() != ' ') {
      text += ' ';
    }
  }
  if (text.size() > 600) text = text.substr(0, 600) + "...";
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return printable(text);
}

// OpenColorIO prints warnings unless told not to, for the whole process; the level is put back afterwards.
class Silence {
 public:
  Silence() : lock_(mutex()), level_(ocio::GetLoggingLevel()) { ocio::SetLoggingLevel(ocio::LOGGING_LEVEL_NONE); }
  ~Silence() { ocio::SetLoggingLevel(level_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }
  std::lock_guard<std::mutex> lock_;
  ocio::LoggingLevel level_;
};

// All that costs no accuracy: the library's default takes powers from a polynomial that is off by 1e-5.
constexpr auto kOptimization = static_cast<ocio::OptimizationFlags>(
    ocio::OPTIMIZATION_VERY_GOOD & ~static_cast<unsigned long>(ocio::OPTIMIZATION_FAST_LOG_EXP_POW));

ocio::ColorSpaceTransformRcPtr space_transform(const std::string& from, const std::string& to) {
  auto transform = ocio::ColorSpaceTransform::Create();
  transform->setSrc(from.c_str());
  transform->setDst(to.c_str());
  return transform;
}

const Chromaticities& reference_primaries() { return find_named_primaries("aces-ap0").xy; }

// Throws what is wrong with it.  Without a search path, 2.1 finds fault with any lookup table and says nothing more: a
// fault that has no reason is none, and tables are tried when they are needed.
void check(const ocio::Config& config) {
  try {
    config.validate();
  } catch (const std::exception& error) {
    if (std::string_view(error.what()) != "Config failed sanitycheck.") throw;
  }
}

std::string cannot_be_read(const std::string& path, const std::string& why) {
  return printable(path) + ": not a usable OpenColorIO configuration: " + why;
}

}  // namespace

struct ColorConfig::Impl {
  std::string path;
  ocio::ConstConfigRcPtr config;

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

  ocio::ConstCPUProcessorRcPtr processor(const ocio::ConstTransformRcPtr& transform) const {
    const Silence silence;
    return config->getProcessor(transform)->getOptimizedCPUProcessor(kOptimization);
  }
  // Appends what takes values of a space to a named one; `named` becomes that name.
  Result<Ok> start_at_name(const ColorSpace& from, ocio::GroupTransform& group, std::string& named) const {
    named = from.name;
    if (!named.empty()) return Ok{};
    named = scene_interchange();
    if (named.empty()) return usage(no_interchange());
    const auto matrix = rgb_from_rgb(reference_primaries(), from.primaries);
    if (!matrix) return usage("primaries that span no colours");
    group.appendTransform(matrix_transform(*matrix));
    return Ok{};
  }
  std::string no_interchange() const {
    return called() +
           " does not say where linear Rec. 709 lies: it has neither the role aces_interchange nor a space ACES2065-1 "
           "(name the input's space with --in-colorspace, and the output's)";
  }
};

ColorConfig ColorConfig::embedded() {
  auto impl = std::make_shared<Impl>();
  impl->config = embedded_config();
  return ColorConfig(std::move(impl));
}

Result<ColorConfig> ColorConfig::from_file(const std::string& path) {
  if (path.compare(0, 7, "ocio://") != 0) {  // names of configurations inside newer versions of the library
    struct stat status {};
    if (::stat(path.c_str(), &status) != 0) return usage(cannot_be_read(path, std::strerror(errno)));
    if (!S_ISREG(status.st_mode)) return usage(cannot_be_read(path, "not a regular file"));
  }
  if (std::use_facet<std::numpunct<char>>(std::locale()).decimal_point() != '.') {
    return usage(cannot_be_read(path, "this program's C++ locale \"" + std::locale().name() +
                                          "\" has no decimal point, and OpenColorIO would misread numbers (set "
                                          "std::locale::classic())"));
  }
  try {
    auto impl = std::make_shared<Impl>();
    impl->path = path;
    const Silence silence;
    impl->config = ocio::Config::CreateFromFile(path.c_str());
    check(*impl->config);
    return ColorConfig(std::move(impl));
  } catch (const std::exception& error) {
    return usage(cannot_be_read(path, reason(error)));
  }
}

Result<ColorConfig> ColorConfig::from_environment() {
  const char* path = std::getenv("OCIO");
  if (!path || !*path) return embedded();
  Result<ColorConfig> config = from_file(path);
  if (!config) return Error{config.error().code, config.error().message + " ($OCIO names it)"};
  return config;
}

const std::string& ColorConfig::path() const { return impl_->path; }

// --- names -----------------------------------------------------------------------------------------------------------

std::vector<std::string> ColorConfig::spaces() const {
  std::vector<std::string> names;
  for (int i = 0; i < impl_->config->getNumColorSpaces(); ++i) {
    names.emplace_back(impl_->config->getColorSpaceNameByIndex(i));
  }
  return names;
}

std::vector<std::string> ColorConfig::aliases(const std::string& space) const {
  std::vector<std::string> names;
  const auto found = impl_->config->getColorSpace(space.c_str());
  for (std::size_t i = 0; found && i < found->getNumAliases(); ++i) names.emplace_back(found->getAlias(i));
  return names;
}

std::string ColorConfig::description(const std::string& space) const {
  const auto found = impl_->config->getColorSpace(space.c_str());
  return found ? found->getDescription() : "";
}

std::vector<std::string> ColorConfig::displays() const {
  std::vector<std::string> names;
  for (int i = 0; i < impl_->config->getNumDisplays(); ++i) names.emplace_back(impl_->config->getDisplay(i));
  return names;
}

std::vector<std::string> ColorConfig::views(const std::string& display) const {
  std::vector<std::string> names;
  const int count = impl_->config->getNumViews(display.c_str());
  for (int i = 0; i < count; ++i) names.emplace_back(impl_->config->getView(display.c_str(), i));
  return names;
}

namespace {

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (std::size_t i = 0; i < names.size() && i < 40; ++i) list += (i ? ", " : "") + printable(names[i]);
  if (names.size() > 40) list += " and " + std::to_string(names.size() - 40) + " more";
  return list;
}

std::string lower(std::string_view text) {
  std::string result;
  for (const char c : text) result += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

// "no colour space is called 'x' (did you mean 'y'?)", whatever the letters' case.
Error unknown_name(const char* kind, const std::string& name, std::vector<std::string> near,
                   const std::vector<std::string>& all, const std::string& where) {
  std::vector<std::string> folded;
  for (const std::string& one : near) folded.push_back(lower(one));
  const std::vector<std::string_view> views(folded.begin(), folded.end());
  const std::string text = lower(name);
  const std::string_view best = nearest_name(text, views);
  for (std::size_t i = 0; i < near.size() && !best.empty(); ++i) {
    if (folded[i] != best) continue;
    return usage("no " + std::string(kind) + " is called '" + printable(name) + "' in " + where + " (did you mean '" +
                 printable(near[i]) + "'?)");
  }
  return usage("no " + std::string(kind) + " is called '" + printable(name) + "' in " + where +
               "; there are: " + list_of(all));
}

}  // namespace

Result<ColorSpace> ColorConfig::find_space(const std::string& name) const {
  const ocio::ConstConfigRcPtr& config = impl_->config;
  const auto space = config->getColorSpace(name.c_str());
  if (!space) {
    std::vector<std::string> near = spaces();
    for (const std::string& one : spaces()) {
      for (const std::string& alias : aliases(one)) near.push_back(alias);
    }
    for (int i = 0; i < config->getNumRoles(); ++i) near.emplace_back(config->getRoleName(i));
    return unknown_name("colour space", name, near, spaces(), impl_->called());
  }
  // A lookup table that is missing or no table shows only when it is opened.
  for (const auto direction : {ocio::COLORSPACE_DIR_TO_REFERENCE, ocio::COLORSPACE_DIR_FROM_REFERENCE}) {
    const auto transform = space->getTransform(direction);
    if (!transform) continue;
    try {
      impl_->processor(transform);
    } catch (const std::exception& error) {
      return usage("colour space '" + printable(name) + "' of " + impl_->called() +
                   " cannot be used: " + reason(error));
    }
  }
  return ColorSpace{space->getName(), rec709()};
}

Result<ColorView> ColorConfig::find_view(const std::string& display, const std::string& view) const {
  ColorView found;
  const auto same = [](const std::string& a, const std::string& b) { return lower(a) == lower(b); };
  const std::vector<std::string> all = displays();
  if (all.empty()) return usage(impl_->called() + " has no displays");
  found.display = impl_->config->getDefaultDisplay();
  if (!display.empty()) {
    const auto at = std::find_if(all.begin(), all.end(), [&](const std::string& one) { return same(one, display); });
    if (at == all.end()) return unknown_name("display", display, all, all, impl_->called());
    found.display = *at;
  }
  const std::vector<std::string> possible = views(found.display);
  if (possible.empty()) return usage("display '" + printable(found.display) + "' has no views");
  found.view = impl_->config->getDefaultView(found.display.c_str());
  if (!view.empty()) {
    const auto at =
        std::find_if(possible.begin(), possible.end(), [&](const std::string& one) { return same(one, view); });
    if (at == possible.end()) {
      return unknown_name("view", view, possible, possible, "display '" + printable(found.display) + "'");
    }
    found.view = *at;
  }
  return found;
}

std::string ColorConfig::space_from_name(const std::string& path) const {
  try {
    const ocio::ConstConfigRcPtr& config = impl_->config;
    const std::string file = path.substr(path.rfind('/') + 1);
    const auto rules = config->getFileRules();
    bool search = impl_->path.empty();
    if (!search && !config->filepathOnlyMatchesDefaultRule(path.c_str())) {
      std::size_t index = 0;
      const std::string space = config->getColorSpaceFromFilepath(path.c_str(), index);
      // The library looks for names anywhere, "raw" in "drawing/" as well.
      if (std::strcmp(rules->getName(index), ocio::FileRules::FilePathSearchRuleName) != 0) {
        const auto found = config->getColorSpace(space.c_str());
        return found ? found->getName() : "";
      }
      search = true;
    }
    if (!search) return {};
    const std::string text = lower(file.substr(0, file.rfind('.')));
    const auto is_word = [&](std::size_t at, std::size_t size) {
      const auto inside = [&](std::size_t i) {
        return i < text.size() && std::isalnum(static_cast<unsigned char>(text[i]));
      };
      return !(at > 0 && inside(at - 1)) && !inside(at + size);
    };
    std::string best;
    std::size_t longest = 0;
    for (const std::string& space : spaces()) {
      if (is_data({space, rec709()})) continue;
      std::vector<std::string> names = aliases(space);
      names.push_back(space);
      for (const std::string& name : names) {
        const std::string word = lower(name);
        for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
          if (word.size() > longest && is_word(at, word.size())) best = space, longest = word.size();
        }
      }
    }
    return best;
  } catch (const std::exception&) {
    return {};
  }
}

bool ColorConfig::is_data(const ColorSpace& space) const {
  const auto found = impl_->config->getColorSpace(space.name.c_str());
  return !space.name.empty() && found && found->isData();
}

// --- what a space is -------------------------------------------------------------------------------------------------

namespace {

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
    return usage(impl_->called() + " has no role scene_linear, the space to resample in (choose a linear output)");
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
      if (!matrix) return usage("primaries that span no colours");
      group->appendTransform(matrix_transform(*matrix));
    } else {
      std::string name, target = to.name;
      ENVCONV_CHECK(impl_->start_at_name(from, *group, name));
      if (target.empty()) target = impl_->scene_interchange();
      if (target.empty()) return usage(impl_->no_interchange());
      group->appendTransform(space_transform(name, target));
      if (to.name.empty()) {
        const auto matrix = rgb_from_rgb(to.primaries, reference_primaries());
        if (!matrix) return usage("primaries that span no colours");
        group->appendTransform(matrix_transform(*matrix));
      }
    }
    auto processor = std::make_shared<ColorTransform::Processor>();
    processor->cpu = impl_->processor(group);
    processor->linear = linear;
    if (!processor->cpu->isNoOp()) result.processor_ = std::move(processor);
    return result;
  } catch (const std::exception& error) {
    return usage("no way from '" + printable(a.space) + "' to '" + printable(b.space) + "': " + reason(error));
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
    return usage("view '" + printable(to.view) + "' of display '" + printable(to.display) +
                 "' cannot be used: " + reason(error));
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
