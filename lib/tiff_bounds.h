// SPDX-License-Identifier: Apache-2.0
// Whether a TIFF file was cut off behind its pixels.  Internal: not installed.
#pragma once

namespace envconv {

/// True when a directory of the TIFF or BigTIFF file `fd`, or the values of one of its fields, lie behind the file's
/// end: readers leave such fields out, as if they had never been.  (TIFF 6.0, section 2; BigTIFF the same with 64
/// bits.)
bool tiff_fields_cut_off(int fd);

}  // namespace envconv
