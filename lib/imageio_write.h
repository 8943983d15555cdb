// SPDX-License-Identifier: Apache-2.0
// Writing through the image library's module.  Internal: not installed.
#pragma once

#include <string>

#include "io.h"
#include "output_file.h"

namespace envconv {

/// A format, as far as the module must know it.
struct ImageioFormat {
  const char* name;         ///< the image library's
  const char* extension;    ///< for messages
  const char* attribute;    ///< where our line of metadata goes, or "" when it cannot
  std::string compression;  ///< the image library's text, or "" for the usual one
};

/// Writes a picture.  Errors: output; unsupported when there is no module.
Result<Ok> write_imageio(OutputFile& file, const Picture& picture, const ImageioFormat& format,
                         const WriteOptions& options, WriteReport& report);

}  // namespace envconv
