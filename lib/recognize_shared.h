// SPDX-License-Identifier: Apache-2.0
// What the parts of recognize.h share: what a file's metadata says, and what a picture's size can mean.
// Internal: not installed.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "recognize.h"

namespace envconv {

/// "64x32", and numbers without trailing zeros.
std::string text(Size size);
std::string text(double number);
inline std::string text(std::string_view word) { return std::string(word); }
/// With commas between them.
std::string joined(const std::vector<std::string>& words);

/// What envconv wrote into a file; unset where it did not.
struct Recorded {
  const Layout* layout = nullptr;
  const Packing* packing = nullptr;
  const Frame* frame = nullptr;
  Rotation rotation;
  RecordedLevels levels;
};
/// Words that this version does not know are reported and otherwise as if they were not there.
Recorded read_metadata(const Metadata& metadata, std::vector<std::string>& warnings);

/// True for packings whose faces are pictures of their own.
bool is_apart(const Packing& packing);

/// A way to read one picture.
struct Fit {
  const Layout* layout;
  const Packing* packing;
  int height;
};
/// Nothing where the size is another.
std::optional<Fit> fit(const Layout& layout, const Packing& packing, Size size);
/// In whichever packing of one image it fits.
std::optional<Fit> fit_any(const Layout& layout, Size size);

/// All that a picture of a size could be, with their names.
struct Possible {
  std::vector<Fit> fits;
  std::vector<std::string> names;
};
/// `told` is the packing that it must have, or nullptr.
Possible possible_fits(Size size, const Packing* told);

/// "6:1", or "1.843:1" where it is no ratio of small numbers.
std::string ratio(const Layout& layout, const Packing& packing);
/// "6:1 (row), 1:6 (column), 3:2 (grid, youtube)"
std::string expected_shapes(const Layout& layout);

/// True when all pixels outside the cells have one and the same value.
bool unused_cells_are_constant(const Image& image, const PackedShape& shape);

}  // namespace envconv
