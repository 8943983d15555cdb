// SPDX-License-Identifier: Apache-2.0
// Damage of JPEG files that the image library does not report.  Internal: part of the image library's module.
#pragma once

#include <string>

namespace envconv {

/// What is wrong with a JPEG file, or "" where libjpeg can decode all of it to its end mark without a guess: where
/// entropy-coded data end early, do not end with the picture or cannot be, libjpeg warns and makes up the rest.  Reads
/// all of the file, up to the end mark.
std::string damage_of_jpeg(int fd);

}  // namespace envconv
