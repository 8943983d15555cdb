// SPDX-License-Identifier: Apache-2.0
// Where libtiff's messages go: not to stderr, and not through handlers that a whole process shares.
// Internal: not installed.
#pragma once

#include <tiffio.h>

#include <cstdio>
#include <memory>
#include <new>
#include <string>

namespace envconv {

using TiffOptions = std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)>;

/// Options for opening a file whose last error will be in `message`, which must outlive it; warnings are dropped.
/// Throws std::bad_alloc.
inline TiffOptions tiff_messages_to(std::string& message) {
  TiffOptions options(TIFFOpenOptionsAlloc(), TIFFOpenOptionsFree);
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetErrorHandlerExtR(
      options.get(),
      [](TIFF*, void* to, const char*, const char* format, va_list arguments) {
        char text[512];
        std::vsnprintf(text, sizeof text, format, arguments);
        static_cast<std::string*>(to)->assign(text);
        return 1;
      },
      &message);
  TIFFOpenOptionsSetWarningHandlerExtR(
      options.get(), [](TIFF*, void*, const char*, const char*, va_list) { return 1; }, nullptr);
  return options;
}

}  // namespace envconv
