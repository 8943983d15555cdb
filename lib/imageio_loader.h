// SPDX-License-Identifier: Apache-2.0
// Finds and loads the image library's module.  Internal: not installed.
#pragma once

#include <memory>
#include <string>

#include "decoder.h"
#include "imageio_module.h"
#include "result.h"

namespace envconv {

/// True for the formats whose files, or some of them, only the image library reads.
bool needs_imageio(const std::string& format);

/// Loads the module, once; about a quarter of a second.  It is looked for in $ENVCONV_MODULE_PATH (a folder or the
/// file), next to the library or program, in lib/envconv beside and above it, and where the library was configured to
/// be installed.  Error: unsupported.
Result<const EnvconvImageio*> load_imageio();

/// Opens a file through the module.
Result<std::unique_ptr<Decoder>> open_imageio(const std::string& format, int fd, const DecoderOptions& options);

}  // namespace envconv
