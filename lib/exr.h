// SPDX-License-Identifier: Apache-2.0
// OpenEXR files.  Internal: not installed.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "decoder.h"
#include "io.h"
#include "output_file.h"
#include "result.h"

namespace envconv {

/// Reads scan lines and tiles, all parts, one level.  Elements are always float32.
Result<std::unique_ptr<Decoder>> open_exr(int fd, const DecoderOptions& options);

/// The compression's name and level: "dwaa:45".  Error: unsupported, listing the names.
Result<Ok> check_exr_compression(const std::string& compression);

/// True when what is written is not what is read, within half a step of the type.
bool exr_compression_is_lossy(const std::string& compression, PixelType type);

/// Writes scan lines, or, with MIP levels, tiles; several pictures become parts.  `report.type` says which type.  With
/// levels, each picture's halve, rounded down, and those that are missing until one texel is left are filled with means
/// of the last.  Fails for what OpenEXR itself refuses (the file remembers its own errors), and, as unsupported, where
/// a level has another size.
Result<Ok> write_exr(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                     WriteReport& report);

/// Number of threads of OpenEXR's pool.  A process must not be forked while there are any: the pool would wait for
/// threads that the new process does not have.
int exr_pool_threads();
void set_exr_pool_threads(int count);

}  // namespace envconv
