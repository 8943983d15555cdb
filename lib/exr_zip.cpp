// SPDX-License-Identifier: Apache-2.0
#include "exr_zip.h"

#include <algorithm>
#include <cstddef>
#include <new>

#include "row_kernels.h"

namespace envconv {

std::span<const std::uint8_t> ZipCodec::pack(std::span<const std::uint8_t> chunk, int level) {
  split_.resize(chunk.size());
  packed_.resize(chunk.size());
  split_bytes(chunk.data(), chunk.size(), split_.data());
  // A chunk of its own size is one that is not deflated.
  const std::size_t room = chunk.empty() ? 0 : chunk.size() - 1;
  const std::size_t size = deflater_.zlib(split_, level, {packed_.data(), room});
  return size == 0 ? chunk : std::span<const std::uint8_t>(packed_.data(), size);
}

bool ZipCodec::unpack(std::span<const std::uint8_t> packed, std::span<std::uint8_t> chunk) {
  if (!decompressor_) decompressor_.reset(libdeflate_alloc_decompressor());
  if (!decompressor_) throw std::bad_alloc();
  split_.resize(chunk.size());
  // Without a place for the size made, fewer bytes are an error.
  std::size_t taken = 0;
  if (libdeflate_zlib_decompress_ex(decompressor_.get(), packed.data(), packed.size(), split_.data(), split_.size(),
                                    &taken, nullptr) != LIBDEFLATE_SUCCESS ||
      taken != packed.size()) {
    return false;
  }
  join_bytes(split_.data(), split_.size(), chunk.data());
  return true;
}

bool ZipCodec::unpack_runs(std::span<const std::uint8_t> packed, std::span<std::uint8_t> chunk) {
  split_.resize(chunk.size());
  std::span<std::uint8_t> to = split_;
  while (!packed.empty()) {
    // 0 to 127: the next byte, once more than that; -1 to -128: so many bytes as they are.
    const auto code = static_cast<std::int8_t>(packed[0]);
    const std::size_t count = static_cast<std::size_t>(code < 0 ? -code : code + 1), taken = code < 0 ? count : 1;
    packed = packed.subspan(1);
    if (count > to.size() || taken > packed.size()) return false;
    if (code < 0)
      std::copy_n(packed.begin(), count, to.begin());
    else
      std::fill_n(to.begin(), count, packed[0]);
    packed = packed.subspan(taken);
    to = to.subspan(count);
  }
  if (!to.empty()) return false;
  join_bytes(split_.data(), split_.size(), chunk.data());
  return true;
}

}  // namespace envconv
