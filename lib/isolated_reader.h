// SPDX-License-Identifier: Apache-2.0
// Decoding in a process of its own: the codecs have known holes, and a hostile file must neither crash the tool nor
// hang it nor eat its memory.  Internal: not installed.
#pragma once

#include <memory>
#include <string>

#include "decoder.h"
#include "result.h"

namespace envconv {

/// As open_decoder(), in a process that is forked for this file and ends with it.  What that process says is held
/// against the limits before anything is allocated.  A crash, a hang or too much memory is ErrorCode::input.
Result<std::unique_ptr<PixelSource>> open_isolated(const std::string& format, int fd, const DecoderOptions& options);

}  // namespace envconv
