// SPDX-License-Identifier: Apache-2.0
// Options that several verbs take, and the ways to make one.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "command.h"
#include "filter.h"
#include "io.h"
#include "packing.h"
#include "recognize.h"

namespace envconv::tool {

// Each of these gives an option that stores its value in `target`, which must outlive the command.

Option switch_option(std::string names, bool& target, std::string help);
Option text_option(std::string names, std::string value, std::string& target, std::string help);
/// One of `choices`, by name.
Option choice_option(std::string names, std::string value, std::string& target, std::vector<std::string_view> choices,
                     std::string help);
/// A whole number in [least, most].
Option integer_option(std::string names, std::string value, int& target, int least, int most, std::string help);
/// A count with suffixes k, M and G, in [1, most].
Option count_option(std::string names, std::string value, std::int64_t& target, std::int64_t most, std::string help);
/// A number in [least, most].
Option number_option(std::string names, std::string value, std::optional<double>& target, double least, double most,
                     std::string help);
Option layout_option(std::string names, const Layout*& target, std::string help);
Option packing_option(std::string names, const Packing*& target, std::string help);
Option frame_option(std::string names, const Frame*& target, std::string help);
/// --filter.
Option filter_option(const Filter*& target);
/// --rotate YAW,PITCH,ROLL
Option rotate_option(Rotation& target);
/// --type TYPE: sets `type` and `type_given`.
Option type_option(WriteOptions& target);
/// The same option under a heading, and with a default to show.
Option in_group(Option option, std::string group, std::string initial = "");

/// What all verbs that read files are told.
struct InputOptions {
  InputHints hints;
  ReadOptions read;
};
/// --from and its kin.
void add_input_options(Command& command, InputOptions& target);
/// What a second input is: --from-b, --from-packing-b, --from-frame-b.
void add_second_input_options(Command& command, InputHints& target);
/// -j, -q, -v: for every verb that works on files.
void add_general_options(Command& command, int& threads);

// Names for completion and messages.
std::vector<std::string_view> layout_names();
std::vector<std::string_view> packing_names();
std::vector<std::string_view> frame_names();
std::vector<std::string_view> filter_names();

}  // namespace envconv::tool
