// SPDX-License-Identifier: Apache-2.0
// Reads TIFF files (TIFF 6.0 and its technical notes) by libtiff and libdeflate, on several threads.  Internal: not
// installed.
#pragma once

#include <memory>

#include "decoder.h"
#include "result.h"

namespace envconv {

/// Opens a file of strips or tiles of grey or RGB with any further channels, of 8 or 16 bits or of floating point in 16
/// or 32, which are not compressed or by Deflate or LZW, and whose metadata are understood here; null for
/// others.  Several pictures are levels where the first one says so (PixarTextureFormat).
Result<std::unique_ptr<Decoder>> open_tiff(int fd, const DecoderOptions& options);

}  // namespace envconv
