// SPDX-License-Identifier: Apache-2.0
#include "deflate.h"

#include <zlib.h>

#include <new>
#include <stdexcept>

namespace envconv {
namespace {

constexpr std::size_t window = 32768;  // of deflate

// Whether zlib stands between two blocks, and how many bits of the byte before the next one are not used yet.
bool between_blocks(const z_stream& z) { return z.data_type & 128; }
int unused_bits(const z_stream& z) { return z.data_type & 7; }

// Clears the mark of a whole stream's last block, and ends it at a byte.  libdeflate cannot do so, and tells not where
// blocks begin: zlib finds that out.
void open_end(std::vector<std::uint8_t>& stream, std::vector<std::uint8_t>& inflated) {
  inflated.resize(window);
  z_stream z{};
  if (inflateInit2(&z, -15) != Z_OK) throw std::bad_alloc();
  const std::unique_ptr<z_stream, int (*)(z_stream*)> end(&z, inflateEnd);
  z.next_in = stream.data();
  z.avail_in = static_cast<uInt>(stream.size());
  std::size_t byte = 0;
  int bit = 0;  // where the block begins
  for (bool last = false; !last;) {
    last = stream[byte] >> bit & 1;
    if (last) stream[byte] = static_cast<std::uint8_t>(stream[byte] & ~(1u << bit));
    do {
      z.next_out = inflated.data();
      z.avail_out = static_cast<uInt>(inflated.size());
      // Without progress where a block ended with the bits that it has already.
      const int told = inflate(&z, Z_BLOCK);
      if (told == Z_MEM_ERROR) throw std::bad_alloc();
      if (told != Z_OK && !(told == Z_BUF_ERROR && between_blocks(z)))
        throw std::runtime_error("deflated bytes that cannot be inflated");
    } while (!between_blocks(z));
    const int unused = unused_bits(z);
    byte = static_cast<std::size_t>(z.next_in - stream.data()) - (unused > 0 ? 1 : 0);
    bit = unused > 0 ? 8 - unused : 0;
  }
  // A stored block of no bytes: three bits 0, more up to a byte's end, and its size twice, the second time inverted.
  stream.resize(byte + (bit > 0 ? 1 : 0));
  if (bit > 0) stream.back() = static_cast<std::uint8_t>(stream.back() & ((1u << bit) - 1));
  if (bit == 0 || bit > 5) stream.push_back(0);
  stream.insert(stream.end(), {0, 0, 0xFF, 0xFF});
}

}  // namespace

libdeflate_compressor* Deflater::compressor(int level) {
  if (!compressor_ || level_ != level) {
    compressor_.reset(libdeflate_alloc_compressor(level));
    if (!compressor_) throw std::bad_alloc();
    level_ = level;
  }
  return compressor_.get();
}

std::size_t Deflater::zlib(std::span<const std::uint8_t> from, int level, std::span<std::uint8_t> to) {
  return libdeflate_zlib_compress(compressor(level), from.data(), from.size(), to.data(), to.size());
}

void Deflater::part(std::span<const std::uint8_t> from, int level, bool last, std::vector<std::uint8_t>& to) {
  libdeflate_compressor* c = compressor(level);
  to.resize(libdeflate_deflate_compress_bound(c, from.size()));
  to.resize(libdeflate_deflate_compress(c, from.data(), from.size(), to.data(), to.size()));
  if (!last) open_end(to, inflated_);
}

}  // namespace envconv
