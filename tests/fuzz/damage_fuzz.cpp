// SPDX-License-Identifier: Apache-2.0
// The checks of files that the image library reads, chosen by the first bytes.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <new>
#include <string_view>

#include "block_damage.h"
#include "png_damage.h"
#include "tiff_damage.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const int fd = ::memfd_create("fuzz", MFD_CLOEXEC);
  if (fd < 0 || ::ftruncate(fd, 0) != 0 || ::pwrite(fd, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  const std::string_view start(reinterpret_cast<const char*>(data), size < 4 ? size : 4);
  const auto check = [&] {
    if (start == "\x89PNG") return envconv::check_png(fd);
    if (start == std::string_view("II*\0", 4) || start == std::string_view("MM\0*", 4))
      return envconv::check_tiff(fd, 0, true);
    if (start.starts_with("GIF")) return envconv::check_gif(fd);
    if (start.starts_with("BM")) return envconv::check_bmp(fd);
    if (start.starts_with("\x01\xda")) return envconv::check_sgi(fd);
    if (start == "\xff\x4f\xff\x51" || start == std::string_view("\0\0\0\x0c", 4)) return envconv::check_jpeg2000(fd);
    return envconv::check_targa(fd);
  };
  try {
    (void)check();
  } catch (const std::bad_alloc&) {
  }
  return 0;
}
