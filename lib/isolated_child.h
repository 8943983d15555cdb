// SPDX-License-Identifier: Apache-2.0
// The process that decodes one file under limits, and ends.  Internal: not installed.
#pragma once

#include <string>

#include "decoder.h"

namespace envconv {

constexpr int kOpenSeconds = 20;  ///< of processor time, to understand a header

/// Seconds of processor time that a thread of a decoder may take for all pictures.
int decode_seconds(const FileSpec& spec);

/// All of the process's life: sets its limits, says over `socket` that it has started and what is in the file, and
/// decodes what the caller asks for.  `hook` is how a test makes it misbehave.
[[noreturn]] void run_child(int socket, int file, const std::string& format, const DecoderOptions& options,
                            const std::string& hook);

}  // namespace envconv
