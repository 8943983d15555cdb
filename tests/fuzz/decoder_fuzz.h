// SPDX-License-Identifier: Apache-2.0
// What fuzz targets of readers share: bytes to a file, and all that a reader can be asked of it.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "decoder.h"

namespace envconv {

using OpenFunction = Result<std::unique_ptr<Decoder>> (*)(int fd, const DecoderOptions& options);

// Every picture of the first two levels.
inline void decode_everything(OpenFunction open, const std::uint8_t* data, std::size_t size) {
  // The image library is not what is tried here: without its module, what it would read is refused.
  static const bool alone = ::setenv("ENVCONV_MODULE_PATH", "/nonexistent", 1) == 0;
  static const int fd = alone ? ::memfd_create("fuzz", MFD_CLOEXEC) : -1;
  if (fd < 0 || ::ftruncate(fd, 0) != 0 || ::pwrite(fd, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  for (const int level : {0, 1}) {
    const auto decoder = open(fd, {.max_pixels = 1 << 16, .level = level});
    if (!decoder) return;
    const FileSpec& spec = (*decoder)->spec();
    if (level >= spec.levels) return;
    for (std::size_t i = 0; i < spec.pictures.size(); ++i) {
      const PictureSpec& p = spec.pictures[i];
      std::vector<char> pixels(static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height) *
                               static_cast<std::size_t>(p.channels.count()) * size_of(p.element));
      (void)(*decoder)->decode(static_cast<int>(i), pixels.data());
    }
  }
}

}  // namespace envconv
