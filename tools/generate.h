// SPDX-License-Identifier: Apache-2.0
// Documents made from the commands and the registries.
#pragma once

#include <string>
#include <string_view>

#include "command.h"
#include "result.h"

namespace envconv::tool {

/// `envconv --help`: fits 24 lines of 80.
std::string general_help();
/// `envconv VERB --help`.
std::string command_help(const Command& command);
/// A shell's completion script, or "" for a shell that is not known.
std::string completion_script(std::string_view shell);
/// The shells for which there is a script.
extern const std::vector<std::string_view> completion_shells;

/// A document from its template: lines @NAME@ are replaced by what they name.  `kind` is "man", "layouts-man" or
/// "readme" (where the text between markers is replaced, so that the document is its own template).
Result<std::string> generate(std::string_view kind, const std::string& template_path);

}  // namespace envconv::tool
