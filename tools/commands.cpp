// SPDX-License-Identifier: Apache-2.0
#include "command.h"

namespace envconv::tool {

#define ENVCONV_COMMAND(name) Command name##_command();
#include "commands.inc"
#undef ENVCONV_COMMAND

const std::vector<Command>& all_commands() {
  static const std::vector<Command> commands{
#define ENVCONV_COMMAND(name) name##_command(),
#include "commands.inc"
#undef ENVCONV_COMMAND
  };
  return commands;
}

const Command* find_command(std::string_view name) {
  for (const Command& command : all_commands()) {
    if (command.name == name) return &command;
  }
  return nullptr;
}

std::vector<std::string> all_names(const Option& option) {
  std::vector<std::string> names;
  for (std::size_t at = 0; at < option.names.size();) {
    const std::size_t end = std::min(option.names.find(',', at), option.names.size());
    names.push_back(option.names.substr(at, end - at));
    at = end + 1;
  }
  return names;
}

std::string long_name(const Option& option) { return all_names(option).back(); }

const std::vector<ExitStatus>& exit_statuses() {
  static const std::vector<ExitStatus> statuses{
      {0, "done"},
      {1, "a comparison or a threshold failed; nothing else did"},
      {2, "the command line is wrong; nothing was read"},
      {3, "an input is missing, unreadable, damaged or not what it was said to be"},
      {4, "an output could not be written; no partial file is left"},
      {5, "the combination is not supported (a file format that cannot hold it, say)"},
      {6, "the memory cap or a limit on image size would be exceeded"},
      {7, "a batch in which some files failed and --keep-going was given"},
      {70, "a bug in envconv"},
      {130, "interrupted by SIGINT; finished outputs stay, the unfinished one is removed"},
      {143, "ended by SIGTERM; likewise"},
  };
  return statuses;
}

}  // namespace envconv::tool
