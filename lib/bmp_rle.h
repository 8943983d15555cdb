// SPDX-License-Identifier: Apache-2.0
// Run-length encoded BMP files, of which the image library refuses those that end their last line as well as the
// bitmap. Internal: not installed.
#pragma once

#include <cstdint>
#include <vector>

#include "result.h"

namespace envconv {

/// The same picture as a BMP file of bytes that are not encoded: of a file `fd` with BI_RLE8 or BI_RLE4 (Microsoft,
/// "Bitmap Compression").  Nothing for other files.  Pixels that the file leaves out have index 0.  Error: input,
/// without the file's name.
Result<std::vector<std::uint8_t>> unpack_bmp(int fd);

}  // namespace envconv
