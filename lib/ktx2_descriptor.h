// SPDX-License-Identifier: Apache-2.0
// KTX2's formats and their data format descriptors (Khronos Data Format Specification 1.3, section 5).  Internal.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "result.h"
#include "texel_format.h"

namespace envconv {

/// VkFormat of what is written in a format that texel_format() gives.
std::uint32_t vk_format(const TexelFormat& format);
/// The format of a VkFormat, or nullptr.
const TexelFormat* format_of_vk(std::uint32_t number);
/// Bytes of the numbers that a texel is made of, which a big-endian machine would turn around.
std::uint32_t type_size(const TexelFormat& format);

/// The descriptor with its size in front, in 32-bit words.  `primaries` is KHR_DF_PRIMARIES_*: 1 is BT.709, 0 none.
std::vector<std::uint32_t> make_descriptor(const TexelFormat& format, bool premultiplied, std::uint32_t primaries = 1);

/// What a descriptor adds to its format.
struct DescriptorFacts {
  bool srgb = false;
  bool premultiplied = false;
  std::uint32_t primaries = 0;
};
/// Checks that a descriptor, size in front, is one of the format.  Error: input.
Result<DescriptorFacts> check_descriptor(std::span<const std::uint8_t> bytes, const TexelFormat& format);

}  // namespace envconv
