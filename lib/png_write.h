// SPDX-License-Identifier: Apache-2.0
// Writing PNG (PNG, third edition, W3C 2025): rows are filtered and deflated in bands, on all threads, which libpng
// cannot do.  Internal: not installed.
#pragma once

#include "io.h"
#include "output_file.h"

namespace envconv {

/// Writes a picture of 1 to 4 channels as report.type, uint8 or uint16.  `level`: of deflate, 0 to 9.  The bytes do not
/// depend on the number of threads.  Throws std::bad_alloc.  Error: unsupported, a row of more than 1 GiB.
Result<Ok> write_png(OutputFile& file, const Picture& picture, int level, const WriteOptions& options,
                     WriteReport& report);

}  // namespace envconv
