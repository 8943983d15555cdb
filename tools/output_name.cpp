// SPDX-License-Identifier: Apache-2.0
#include "output_name.h"

#include <algorithm>
#include <array>

#include "standard_input.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr std::array<std::string_view, 9> field_names{"dir",        "stem", "ext", "layout", "face",
                                                      "face_index", "size", "mip", "index"};

Error usage(const std::string& text) { return {ErrorCode::usage, "--output: " + text}; }

std::string value_of(std::string_view field, const NameFields& f) {
  if (field == "dir") return f.dir;
  if (field == "stem") return f.stem;
  if (field == "ext") return f.ext;
  if (field == "layout") return f.layout;
  if (field == "face") return f.face;
  if (field == "face_index") return std::to_string(f.face_index);
  if (field == "size") return std::to_string(f.size);
  if (field == "mip") return std::to_string(f.mip);
  return std::to_string(f.index);
}

}  // namespace

Result<OutputName> OutputName::parse(std::string_view text, bool per_face) {
  std::string whole(text);
  if (whole.ends_with('/')) whole += per_face ? "{stem}_{face}.{ext}" : "{stem}.{ext}";
  OutputName name;
  std::string literal;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const char c = whole[i];
    if (c != '{' && c != '}') {
      literal += c;
      continue;
    }
    if (i + 1 < whole.size() && whole[i + 1] == c) {
      literal += c;
      ++i;
      continue;
    }
    const std::size_t end = whole.find('}', i);
    if (c == '}' || end == std::string::npos) {
      return usage("'" + whole + "' has a single '" + c + "' (write " + std::string(2, c) + " for the character)");
    }
    const std::string field = whole.substr(i + 1, end - i - 1);
    if (std::find(field_names.begin(), field_names.end(), field) == field_names.end()) {
      return usage("'{" + field + "}' is not a field" + did_you_mean(field, field_names) +
                   "; there are: " + joined(field_names) + " (write {{ and }} for braces)");
    }
    if (!literal.empty()) name.pieces_.push_back({false, std::move(literal)});
    literal.clear();
    name.pieces_.push_back({true, field});
    i = end;
  }
  if (!literal.empty()) name.pieces_.push_back({false, literal});
  return name;
}

bool OutputName::uses(std::string_view field) const {
  return std::any_of(pieces_.begin(), pieces_.end(),
                     [&](const Piece& piece) { return piece.is_field && piece.text == field; });
}

bool OutputName::fixed() const {
  return std::none_of(pieces_.begin(), pieces_.end(), [](const Piece& piece) { return piece.is_field; });
}

std::string OutputName::expand(const NameFields& fields) const {
  std::string out;
  for (const Piece& piece : pieces_) out += piece.is_field ? value_of(piece.text, fields) : piece.text;
  return out;
}

std::string OutputName::expand_beginning(const NameFields& fields) const {
  std::string out;
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const bool begins_with_dir = i == 0 && pieces_[i].is_field && pieces_[i].text == "dir";
    if (pieces_[i].is_field && !begins_with_dir) break;
    out += begins_with_dir ? fields.dir : pieces_[i].text;
  }
  return out;
}

NameFields fields_of_input(std::string_view path) {
  NameFields fields;
  if (path == standard_input) path = "stdin";
  const std::size_t slash = path.rfind('/');
  fields.dir = slash == std::string_view::npos ? "." : slash == 0 ? "/" : std::string(path.substr(0, slash));
  std::string name(slash == std::string_view::npos ? path : path.substr(slash + 1));
  const std::size_t dot = name.rfind('.');
  if (dot != std::string::npos && dot > 0) {
    fields.ext = name.substr(dot + 1);
    name.resize(dot);
  }
  const std::size_t face = name.find("{face}");
  if (face != std::string::npos) {
    name.erase(face, 6);
    const auto separator = [&](std::size_t i) {
      return i < name.size() && std::string_view("_-.").find(name[i]) != std::string_view::npos;
    };
    if (face > 0 && separator(face - 1)) {
      name.erase(face - 1, 1);
    } else if (face == 0 && separator(0)) {
      name.erase(0, 1);
    }
    if (name.empty()) name = "faces";
  }
  fields.stem = name;
  return fields;
}

}  // namespace envconv::tool
