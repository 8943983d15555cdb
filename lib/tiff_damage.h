// SPDX-License-Identifier: Apache-2.0
// Damage of TIFF files that their readers do not report.  Internal: not installed.
#pragma once

#include "result.h"

namespace envconv {

/// Error: input, unless all strips and tiles of all pictures of the TIFF file are in it, and those of the picture
/// number `picture` match their checksums, if deflated, or unpack to their size, by LZW and PackBits: libtiff stops
/// once it has a strip's rows.  Not `checksums`: those that are deflated are unpacked elsewhere, to the end.
/// Throws std::bad_alloc.
Result<Ok> check_tiff(int fd, int picture, bool checksums);

}  // namespace envconv
