// SPDX-License-Identifier: Apache-2.0
// Bytes of an open file.  Internal: not installed.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "result.h"

namespace envconv {

/// The error of a file whose content cannot be: "truncated or damaged: WHAT".
Error damaged_file(const std::string& what);

/// Reads so many bytes from there on.  Error: input, also where the file ends before.
Result<Ok> read_at(int fd, std::uint64_t position, std::span<std::uint8_t> to);

/// The size of an open file.  Error: input.
Result<std::uint64_t> size_of_file(int fd);

}  // namespace envconv
