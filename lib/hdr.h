// SPDX-License-Identifier: Apache-2.0
// Radiance pictures (.hdr): the format most environments come in, so it must not cost the image library's loading time;
// and the image library neither turns pictures stored in another orientation nor applies their exposure.  Internal.
#pragma once

#include <memory>

#include "decoder.h"
#include "io.h"
#include "output_file.h"
#include "result.h"

namespace envconv {

/// Reads RGBE, run-length encoded or flat.  Elements are float32, exposure taken off; the orientation is Exif's.
Result<std::unique_ptr<Decoder>> open_hdr(int fd, const DecoderOptions& options);

/// Writes a picture of 1 (as grey) or 3 channels, run-length encoded.  Negative values become 0 and values above
/// 1.69e38 that, counted in the report.
Result<Ok> write_hdr(OutputFile& file, const Picture& picture, const WriteOptions& options, WriteReport& report);

}  // namespace envconv
