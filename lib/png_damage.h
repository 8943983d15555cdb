// SPDX-License-Identifier: Apache-2.0
// Damage of PNG files that the image library does not report.  Internal: not installed.
#pragma once

#include "result.h"

namespace envconv {

/// Error: input, unless the PNG file is whole: every chunk's checksum is right, the last one is IEND, and the stream of
/// its pixels has the size that its header needs and ends with its own checksum (PNG, third edition, sections 5.3, 7.2
/// and 10.1).  Reads all of the file, and unpacks it into nothing.
Result<Ok> check_png(int fd);

}  // namespace envconv
