// SPDX-License-Identifier: Apache-2.0
// Writing JPEG (ITU-T T.81) through libjpeg, which is on the disk wherever the image library is, and takes a
// thousandth of its time to load.  Internal: not installed.
#pragma once

#include "io.h"
#include "output_file.h"

namespace envconv {

/// Writes a picture of 1 or 3 channels as uint8, colour at half the resolution; our line of metadata is a comment and
/// Exif's ImageDescription.  `quality`: 1 to 100.  Errors: output and unsupported, with libjpeg's words.  After a
/// failure of the disk, which OutputFile remembers and tells, there may be none.  Throws std::bad_alloc.
Result<Ok> write_jpeg(OutputFile& file, const Picture& picture, int quality, const WriteOptions& options,
                      WriteReport& report);

}  // namespace envconv
