// SPDX-License-Identifier: Apache-2.0
// Reads JPEG files (ITU-T T.81) by libjpeg.  Internal: not installed.
#pragma once

#include <memory>

#include "decoder.h"
#include "result.h"

namespace envconv {

/// Opens a file of grey, YCbCr or RGB whose metadata are understood here; null for others.  What libjpeg warns of is an
/// error.  Orientation, description and colour are Exif's, a comment's and an ICC profile's.
Result<std::unique_ptr<Decoder>> open_jpeg(int fd, const DecoderOptions& options);

}  // namespace envconv
