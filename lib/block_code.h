// SPDX-License-Identifier: Apache-2.0
// Reads blocks of 4x4 texels of integers: BC1 to BC5 and BC7 (BC6H is bc6h.h's).  Sources: Microsoft, "Texture Block
// Compression in Direct3D 11" and "BC7 Format"; Khronos Data Format Specification, "S3TC", "RGTC" and "BPTC compressed
// texture image formats".  Internal: not installed.
#pragma once

#include <cstdint>

namespace envconv {

/// How blocks are coded, and what they hold.
enum class BlockCode : std::uint8_t {
  none,
  bc1,  ///< RGB and one bit of alpha
  bc2,  ///< RGBA
  bc3,  ///< RGBA
  bc4,  ///< one channel, unsigned or signed
  bc5,  ///< two channels, unsigned or signed
  bc7   ///< RGBA
};

/// "bc1" and so on, "" for none.
const char* name_of(BlockCode code);

/// Decodes blocks[ceil(height/4)][ceil(width/4)][8 or 16] of any code but none and any content to
/// elements[height][width][channels]: the first `channels` of those the code has, uint8; or signed ones (bc4 and bc5
/// alone) as float in [-1, 1].  What lies halfway between two codes of 8 bits is rounded to the nearest.  Reserved
/// codes of BC7 decode to 0.
void decode_blocks(const std::uint8_t* blocks, BlockCode code, bool is_signed, int width, int height, int channels,
                   void* elements);

}  // namespace envconv
