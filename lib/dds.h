// SPDX-License-Identifier: Apache-2.0
// DirectDraw Surface files: header, DX10 extension, then for each face or layer all its levels, largest first.
// Source: Microsoft, "Programming Guide for DDS", DDS_HEADER, DDS_HEADER_DXT10, "DDS File Layout for Cubic Environment
// Maps".  Internal.
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

/// Reads cube maps, arrays and single pictures with all their levels: what write_dds() writes, further DX10 formats of
/// 8, 16 and 32 bits and BC1 to BC7, the older header with FourCC 36, 113 and 116, those of BC1 to BC5, and masks of 8
/// bits.  Eight-bit values are sRGB unless a DX10 format says that they are not or, as for BC4 and BC5, there is no
/// format that says they are.
Result<std::unique_ptr<Decoder>> open_dds(int fd, const DecoderOptions& options);

/// Writes a cube map (six faces) or an array or, of one picture, neither, with a DX10 header.  Of the metadata, all
/// but the rotation goes into the header's reserved words, which readers skip, as far as there is room.  Errors:
/// those of shape_of().
Result<Ok> write_dds(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                     const TextureCompression& compression, WriteReport& report);

}  // namespace envconv
