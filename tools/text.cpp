// SPDX-License-Identifier: Apache-2.0
#include "text.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "layout.h"
#include "output_file.h"

namespace envconv::tool {
namespace {

int the_verbosity = 0;
int output_errno = 0;  // the first failed write to standard output

// One write for the whole line, so that lines of parallel runs do not mix.
void to_stderr(const std::string& line) {
  std::string_view rest = line;
  while (!rest.empty()) {
    const ssize_t n = write(STDERR_FILENO, rest.data(), rest.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;
    rest.remove_prefix(static_cast<std::size_t>(n));
  }
}

}  // namespace

void set_verbosity(int verbosity) { the_verbosity = verbosity; }
int verbosity() { return the_verbosity; }

std::string visible(std::string_view text) { return printable(std::string(text)); }

void complain(std::string_view line) { to_stderr("envconv: " + visible(line) + "\n"); }

void warn(std::string_view file, std::string_view line) {
  if (the_verbosity < 0) return;
  const std::string prefix = std::string(file) + ": ";
  if (line.starts_with(prefix)) line.remove_prefix(prefix.size());  // the library has named the file
  complain(prefix + "warning: " + std::string(line));
}

void remark(std::string_view line) {
  if (the_verbosity > 0) complain(line);
}

int fail(const Error& error) {
  complain(error.message);
  return static_cast<int>(error.code);
}

void print(std::string_view text) {
  while (!text.empty() && output_errno == 0) {
    const ssize_t n = write(STDOUT_FILENO, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      output_errno = errno;
      return;
    }
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

int finish_output(int status) {
  if (output_errno == 0 || output_errno == EPIPE) return status;
  complain(std::string("standard output: cannot write: ") + std::strerror(output_errno));
  return status == 0 ? static_cast<int>(ErrorCode::output) : status;
}

std::optional<std::int64_t> parse_integer(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<double> parse_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::int64_t> parse_count(std::string_view text) {
  std::int64_t unit = 1;
  if (!text.empty()) {
    switch (text.back()) {
      case 'k': unit = 1000; break;
      case 'M': unit = 1000000; break;
      case 'G': unit = 1000000000; break;
      default: break;
    }
  }
  if (unit != 1) text.remove_suffix(1);
  const auto value = parse_integer(text);
  if (!value || *value < 0 || *value > INT64_MAX / unit) return std::nullopt;
  return *value * unit;
}

std::string number_text(double value, int digits) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  char text[64];
  const auto [end, error] =
      std::to_chars(text, text + sizeof text, value == 0 ? 0.0 : value, std::chars_format::general, digits);
  return std::string(text, end);
}

std::string megabytes(std::size_t bytes) { return std::to_string((bytes + 999999) / 1000000) + " MB"; }

std::string joined(std::span<const std::string_view> words, std::string_view separator) {
  std::string out;
  for (const std::string_view word : words) {
    if (!out.empty()) out += separator;
    out += word;
  }
  return out;
}

std::string did_you_mean(std::string_view word, std::span<const std::string_view> names) {
  const std::string_view near = nearest_name(word, names);
  return near.empty() ? "" : " (did you mean '" + std::string(near) + "'?)";
}

std::string wrapped(std::string_view text, std::size_t indent, std::size_t width) {
  std::string out;
  std::size_t column = indent;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of(" \n"), text.size());
    const std::string_view word = text.substr(0, end);
    if (!word.empty()) {
      if (column > indent && column + 1 + word.size() > width) {
        out += '\n' + std::string(indent, ' ');
        column = indent;
      } else if (column > indent) {
        out += ' ';
        ++column;
      }
      out += word;
      column += word.size();
    }
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return out;
}

std::string table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string out;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i) {
      line += row[i];
      line += std::string(widths[i] - row[i].size() + 2, ' ');
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + '\n';
  }
  return out;
}

}  // namespace envconv::tool
