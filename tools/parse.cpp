// SPDX-License-Identifier: Apache-2.0
// From words to options.  The only file that includes CLI11, whose headers take seconds to compile; what it says and
// the statuses it wants are replaced by our own.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iterator>

#include "command.h"
#include "text.h"

namespace envconv::tool {
namespace {

Error usage(const Command& command, const std::string& text) {
  // One advice is enough.
  if (text.ends_with(')')) return {ErrorCode::usage, text};
  return {ErrorCode::usage, text + " (see 'envconv " + command.name + " --help')"};
}

Error unknown_option(const Command& command, const std::string& word) {
  const std::string name = word.substr(0, word.find('='));
  std::vector<std::string> names{"--help"};
  for (const Option& option : command.options) {
    for (std::string& n : all_names(option)) names.push_back(std::move(n));
  }
  const std::vector<std::string_view> views(names.begin(), names.end());
  return usage(command, name + ": no such option of '" + command.name + "'" + did_you_mean(name, views));
}

}  // namespace

Result<Invocation> parse(const Command& command, const std::vector<std::string>& words) {
  Invocation found;
  CLI::App app;
  app.set_help_flag();
  app.allow_extras();  // so that we name what is unknown, and what is near it
  app.add_flag("-h,--help", found.help);
  app.add_option("operands", found.operands);

  struct Given {
    CLI::Option* parsed;
    const Option* option;
  };
  std::vector<Given> given;
  for (const Option& option : command.options) {
    if (option.value.empty()) {
      given.push_back({app.add_flag(option.names), &option});
    } else {
      CLI::Option* parsed = app.add_option(option.names, [](const CLI::results_t&) { return true; });
      parsed->type_name(option.value)->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
      given.push_back({parsed, &option});
    }
  }

  // What follows "--" is operands, whatever it looks like.
  const auto end = std::find(words.begin(), words.end(), "--");
  try {
    app.parse(std::vector<std::string>(std::make_reverse_iterator(end), words.rend()));
  } catch (const CLI::ArgumentMismatch&) {
    // The word it stumbled over is the last one: an option that wants a value and stands at the end.
    const std::string last = end == words.begin() ? "" : *(end - 1);
    return usage(command, last + ": a value must follow");
  } catch (const CLI::ParseError& error) {
    return usage(command, error.what());
  }
  if (found.help) return found;
  for (const std::string& word : app.remaining()) {
    if (word.size() > 1 && word.front() == '-') return unknown_option(command, word);
    found.operands.push_back(word);
  }
  if (end != words.end()) found.operands.insert(found.operands.end(), end + 1, words.end());
  for (const auto& [parsed, option] : given) {
    if (parsed->count() == 0) continue;
    std::string value = option->value.empty() && option->optional_value.empty() ? "" : parsed->results().back();
    if (!option->optional_value.empty() && value == "true") value.clear();  // what a switch alone gives
    const std::string wrong = option->set(value);
    if (!wrong.empty()) return usage(command, long_name(*option) + ": " + wrong);
  }
  if (found.operands.size() < command.min_operands) {
    return usage(command, command.name + ": " + command.operands + " is missing");
  }
  if (found.operands.size() > command.max_operands) {
    return usage(command, found.operands[command.max_operands] + ": one word too many");
  }
  return found;
}

}  // namespace envconv::tool
