// SPDX-License-Identifier: Apache-2.0
// Configurations: where they come from, and the names in them.
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <locale>
#include <mutex>
#include <new>

#include "color_impl.h"

namespace envconv {

namespace ocio = OCIO_NAMESPACE;

Error color_usage(std::string what) { return {ErrorCode::usage, std::move(what)}; }

namespace {

// OpenColorIO's text in one line.
std::string color_reason(const std::exception& error) {
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

}  // namespace

Error color_failure(std::string what, const std::exception& error) {
  // The library wraps the exceptions of its parts in its own.
  const std::string reason = color_reason(error);
  if (reason.find("bad_alloc") != std::string::npos) {
    return {ErrorCode::limit, "not enough memory for the colour configuration"};
  }
  return color_usage(std::move(what) + reason);
}

namespace {

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

ocio::ConstCPUProcessorRcPtr ColorConfig::Impl::processor(const ocio::ConstTransformRcPtr& transform) const {
  const Silence silence;
  return config->getProcessor(transform)->getOptimizedCPUProcessor(kOptimization);
}

ColorConfig ColorConfig::embedded() {
  auto impl = std::make_shared<Impl>();
  impl->config = embedded_config();
  return ColorConfig(std::move(impl));
}

Result<ColorConfig> ColorConfig::from_file(const std::string& path) {
  if (path.compare(0, 7, "ocio://") != 0) {  // names of configurations inside newer versions of the library
    struct stat status {};
    if (::stat(path.c_str(), &status) != 0) return color_usage(cannot_be_read(path, std::strerror(errno)));
    if (!S_ISREG(status.st_mode)) return color_usage(cannot_be_read(path, "not a regular file"));
  }
  if (std::use_facet<std::numpunct<char>>(std::locale()).decimal_point() != '.') {
    return color_usage(cannot_be_read(path, "this program's C++ locale \"" + std::locale().name() +
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
    return color_failure(cannot_be_read(path, ""), error);
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
    return color_usage("no " + std::string(kind) + " is called '" + printable(name) + "' in " + where +
                       " (did you mean '" + printable(near[i]) + "'?)");
  }
  return color_usage("no " + std::string(kind) + " is called '" + printable(name) + "' in " + where +
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
      return color_failure("colour space '" + printable(name) + "' of " + impl_->called() + " cannot be used: ", error);
    }
  }
  return ColorSpace{space->getName(), rec709()};
}

Result<ColorView> ColorConfig::find_view(const std::string& display, const std::string& view) const {
  ColorView found;
  const auto same = [](const std::string& a, const std::string& b) { return lower(a) == lower(b); };
  const std::vector<std::string> all = displays();
  if (all.empty()) return color_usage(impl_->called() + " has no displays");
  found.display = impl_->config->getDefaultDisplay();
  if (!display.empty()) {
    const auto at = std::find_if(all.begin(), all.end(), [&](const std::string& one) { return same(one, display); });
    if (at == all.end()) return unknown_name("display", display, all, all, impl_->called());
    found.display = *at;
  }
  const std::vector<std::string> possible = views(found.display);
  if (possible.empty()) return color_usage("display '" + printable(found.display) + "' has no views");
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
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception&) {
    return {};
  }
}

bool ColorConfig::is_data(const ColorSpace& space) const {
  const auto found = impl_->config->getColorSpace(space.name.c_str());
  return !space.name.empty() && found && found->isData();
}

}  // namespace envconv
