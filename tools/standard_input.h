// SPDX-License-Identifier: Apache-2.0
// The input that is named "-".
#pragma once

#include <string>

#include "result.h"

namespace envconv::tool {

inline constexpr char standard_input[] = "-";

/// Where what standard input holds can be read as a file, as often as is wanted: it is nothing before
/// keep_standard_input() has succeeded.
std::string standard_input_path();

/// Reads standard input to its end into memory, unless it is a file that is read from its beginning; once, whoever
/// calls it.  Error: input; limit, for more than three quarters of the memory that is available.
Result<Ok> keep_standard_input();

/// `message` with standard input's path as the user named it.
std::string with_standard_input_named(std::string message);

}  // namespace envconv::tool
