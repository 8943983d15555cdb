// SPDX-License-Identifier: Apache-2.0
// The command line as data.  A verb is one Command, built by its own file and named by one line of commands.inc; the
// parser, --help, the manual page and the shells' completions are all made from it.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "result.h"

namespace envconv::tool {

/// One option of a verb.
struct Option {
  std::string names{};                      ///< "-o,--output"
  std::string value{};                      ///< what stands for the value: "PATH"; empty for a switch
  std::string optional_value{};             ///< of a switch that may have one after an equals sign: "N"
  std::string help{};                       ///< a phrase, or sentences, without a full stop at the end
  std::string initial{};                    ///< the default as a person reads it; "" when there is none to tell
  std::vector<std::string_view> choices{};  ///< all values, where they are a closed set: for completion
  /// Takes the value ("" for a switch without one); gives back what is wrong with it, or "".
  std::function<std::string(const std::string& value)> set{};
  std::string group{};  ///< heading in --help and in the manual
};

/// One verb.
struct Command {
  std::string name{};
  std::string summary{};   ///< one line for the list of verbs
  std::string operands{};  ///< "INPUT..."; a word in brackets is optional
  std::size_t min_operands = 0, max_operands = static_cast<std::size_t>(-1);
  std::string description{};                        ///< a paragraph for --help and the manual
  std::vector<std::string_view> operand_choices{};  ///< for completion; empty: file names
  bool reads_files = false;                         ///< the isolated reader is started before anything else
  std::vector<Option> options{};
  /// Does the work; gives back the exit status.  Called once, after every option was set.
  std::function<int(const std::vector<std::string>& operands)> run{};
};

/// Every verb, in the order of commands.inc.
const std::vector<Command>& all_commands();
const Command* find_command(std::string_view name);

/// What the parser found.
struct Invocation {
  bool help = false;
  std::vector<std::string> operands;
};
/// Parses the words after the verb and sets the options.  Errors are ErrorCode::usage.
Result<Invocation> parse(const Command& command, const std::vector<std::string>& words);

/// The longest name of an option: "--output".
std::string long_name(const Option& option);
/// All names of an option: {"-o", "--output"}.
std::vector<std::string> all_names(const Option& option);

/// An exit status of the tool and what it means.
struct ExitStatus {
  int status;
  std::string_view meaning;
};
/// In ascending order; the source of the manual's table.
const std::vector<ExitStatus>& exit_statuses();

}  // namespace envconv::tool
