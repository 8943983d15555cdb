// SPDX-License-Identifier: Apache-2.0
// How many bytes LZW and PackBits streams of TIFF unpack to, which is all the redundancy that they have.
// Internal: not installed.
#pragma once

#include <cstdint>
#include <span>

namespace envconv {

/// Whether a stream unpacks to so many bytes, of which a code ends at one of `size` or, where a last strip was filled
/// up, at `full`; what follows is not looked at.  TIFF 6.0, sections 13 (LZW) and 9 (PackBits).  Of the bits of LZW the
/// highest of a byte come first; streams of the older order are taken as they are.
bool lzw_unpacks_to(std::span<const std::uint8_t> stream, std::uint64_t size, std::uint64_t full);
bool packbits_unpacks_to(std::span<const std::uint8_t> stream, std::uint64_t size, std::uint64_t full);

}  // namespace envconv
