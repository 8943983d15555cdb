// SPDX-License-Identifier: Apache-2.0
// Words and numbers: messages to people, results to standard output, values from the command line.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "result.h"

namespace envconv::tool {

/// How much the tool tells: -1 with --quiet, 1 with --verbose.
void set_verbosity(int verbosity);
int verbosity();

/// The text with control characters, which file names may hold, escaped.
std::string visible(std::string_view text);
/// Prints "envconv: LINE" to stderr; control characters, which file names may hold, are escaped.
void complain(std::string_view line);
/// The same for warnings, unless --quiet.
void warn(std::string_view file, std::string_view line);
/// A remark on progress, with --verbose only.
void remark(std::string_view line);
/// Complains, and gives back the exit status.
int fail(const Error& error);

/// Writes a verb's result to standard output.  A reader that went away is not an error; what else goes wrong is kept
/// for finish_output().
void print(std::string_view text);
/// The exit status after all output: `status`, or that of a failed write to standard output.
int finish_output(int status);

/// A whole number or nothing: no sign but '-', no spaces, no exponent, all of the text.
std::optional<std::int64_t> parse_integer(std::string_view text);
/// A finite decimal number or nothing; always with a decimal point, whatever the locale.
std::optional<double> parse_number(std::string_view text);
/// A count with an optional suffix k, M or G (powers of 1000).
std::optional<std::int64_t> parse_count(std::string_view text);
/// At most `digits` significant digits, without trailing zeros.
std::string number_text(double value, int digits);

/// "1234 MB": 10^6 bytes, rounded up.
std::string megabytes(std::size_t bytes);

/// "a, b, c".
std::string joined(std::span<const std::string_view> words, std::string_view separator = ", ");
/// " (did you mean 'cube'?)" when a name is near, else "".
std::string did_you_mean(std::string_view word, std::span<const std::string_view> names);
/// `text` broken at spaces to lines of at most `width`, each after the first indented by `indent` spaces.
std::string wrapped(std::string_view text, std::size_t indent, std::size_t width);
/// Columns as wide as their widest cell; the first row is the heading.
std::string table(const std::vector<std::vector<std::string>>& rows);

}  // namespace envconv::tool
