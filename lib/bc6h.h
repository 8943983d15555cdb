// SPDX-License-Identifier: Apache-2.0
// BC6H: blocks of 4x4 texels of unsigned or signed half RGB in 16 bytes (Direct3D's BC6H_UF16 and BC6H_SF16, OpenGL's
// and Vulkan's BPTC float).  Sources: Khronos Data Format Specification, "BPTC compressed texture image formats"
// (BC6H), and Microsoft's "BC6H Format".
#pragma once

#include <cstddef>
#include <cstdint>

#include "image.h"

namespace envconv {

/// How hard encode_bc6h searches.
enum class Bc6hEffort { fast, normal, best };

/// Bytes of an image's blocks: 16 for each 4x4 texels, partial blocks included.  width, height >= 1.
std::size_t bc6h_bytes(int width, int height);

/// Encodes as unsigned BC6H.  blocks: [ceil(height/4)][ceil(width/4)][16], bc6h_bytes(width, height) of them.  The
/// image's first three channels are R, G, B; with fewer than three the first one is repeated.  Negative values and NaN
/// count as 0, values above 65504 as 65504; partial blocks continue the last column and row.  The bytes do not depend
/// on `threads` (0: as many as the processor has).
void encode_bc6h(const Image& image, Bc6hEffort effort, int threads, std::uint8_t* blocks);

/// Decodes blocks laid out as above to rgb[height][width][3].  Blocks of the four reserved modes decode to 0, as the
/// specification has it.
void decode_bc6h(const std::uint8_t* blocks, int width, int height, bool is_signed, float* rgb);

}  // namespace envconv
