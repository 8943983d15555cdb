// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>

#include "bmp_rle.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const int fd = ::memfd_create("fuzz", MFD_CLOEXEC);
  if (fd < 0 || ::ftruncate(fd, 0) != 0 || ::pwrite(fd, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  const auto unpacked = envconv::unpack_bmp(fd);
  // Never more than the file could tell of, and a header.
  if (unpacked && unpacked->size() > 54 + 4 * 256 + 4 * 256 * size) std::abort();
  return 0;
}
