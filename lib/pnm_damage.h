// SPDX-License-Identifier: Apache-2.0
// Damage of PNM and PFM files that the image library does not report.  Internal: part of the image library's module.
#pragma once

#include <string>

namespace envconv {

/// What is wrong with a PNM or PFM file, or "" where the largest value or the scale in its header can be, and no row
/// more follows the last one.  Another picture may follow, as these formats allow.
std::string damage_of_pnm(int fd);

}  // namespace envconv
