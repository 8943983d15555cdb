// SPDX-License-Identifier: Apache-2.0
// Damage that shows in how the blocks of a file follow each other, where image libraries stop reading once they have
// the pixels, or make them up.  Internal: not installed.
#pragma once

#include "result.h"

namespace envconv {

/// Error: input, unless the blocks of a GIF lead to its trailer (GIF89a, section 27).
Result<Ok> check_gif(int fd);

/// Error: input, unless the pixels of a Targa file are those that its header claims, and nothing but the areas that a
/// footer ends follows them (Truevision TGA 2.0).
Result<Ok> check_targa(int fd);

/// Error: input, unless the pixels of a BMP file lie behind its header and palette and fill the file, but for less than
/// a row or an ICC profile (Windows' BITMAPINFOHEADER and BITMAPV5HEADER).
Result<Ok> check_bmp(int fd);

/// Error: input, unless the rows of an SGI file are in it and unpack to their width (the SGI image file format 1.0).
Result<Ok> check_sgi(int fd);

/// Error: input, unless the tile-parts of a JPEG 2000 codestream, in a JP2 file or on its own, follow each other up to
/// its end (ISO/IEC 15444-1, annex A).
Result<Ok> check_jpeg2000(int fd);

}  // namespace envconv
