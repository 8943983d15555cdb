// SPDX-License-Identifier: Apache-2.0
// Names of outputs made from a template: {dir} {stem} {ext} {layout} {face} {face_index} {size} {mip} {index}.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "result.h"

namespace envconv::tool {

/// The values of a template's fields.
struct NameFields {
  std::string dir, stem, ext;  ///< of the input
  std::string layout, face;
  int face_index = 0, size = 0, mip = 0, index = 0;
};

/// A parsed template.
class OutputName {
 public:
  /// Errors, of ErrorCode::usage, name the unknown field or the brace that is not closed; {{ and }} stand for braces.
  /// A name that ends in '/' is a folder: {stem}.{ext} goes there, or {stem}_{face}.{ext} when `per_face`.
  static Result<OutputName> parse(std::string_view text, bool per_face);

  bool uses(std::string_view field) const;
  /// True when the name has no field at all.
  bool fixed() const;
  std::string expand(const NameFields& fields) const;
  /// What comes before the first field; {dir} at the very beginning is no field of that sort.
  std::string expand_beginning(const NameFields& fields) const;

 private:
  struct Piece {
    bool is_field;
    std::string text;
  };
  std::vector<Piece> pieces_;
};

/// dir, stem and ext of a path.  A {face} in it, with the separator beside it, is no part of the stem.
NameFields fields_of_input(std::string_view path);

}  // namespace envconv::tool
