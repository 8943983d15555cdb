// SPDX-License-Identifier: Apache-2.0
// Khronos textures: KTX2 and its predecessor.  Sources: Khronos, "KTX File Format Specification" 2.0 and 1.1; "Khronos
// Data Format Specification" 1.3.  Internal.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "decoder.h"
#include "io.h"
#include "output_file.h"
#include "result.h"
#include "texture_file.h"

namespace envconv {

/// Reads a cube map, an array or a picture with all its levels, packed with Zstandard or zlib or not at all: what
/// write_ktx2() writes, and 8-, 16- and 32-bit RGB and RGBA, BC6H.  The data format descriptor must be that of the
/// format; what it says of sRGB and of alpha holds.
Result<std::unique_ptr<Decoder>> open_ktx2(int fd, const DecoderOptions& options);

/// Writes a cube map (six faces) or an array or, of one picture, neither.  Errors: those of shape_of().
Result<Ok> write_ktx2(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                      const TextureCompression& compression, WriteReport& report);

/// The same of version 1, which knows no compression of files.
Result<std::unique_ptr<Decoder>> open_ktx1(int fd, const DecoderOptions& options);
Result<Ok> write_ktx1(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                      const TextureCompression& compression, WriteReport& report);

}  // namespace envconv
