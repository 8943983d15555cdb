// SPDX-License-Identifier: Apache-2.0
// Templates of output names: the first line is a template, the second the name of an input.
#include <cstdint>
#include <cstdlib>
#include <string>

#include "output_name.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace envconv::tool;
  const std::string text(reinterpret_cast<const char*>(data), size);
  const std::size_t end = text.find('\n');
  const std::string pattern = text.substr(0, end);
  NameFields fields = fields_of_input(end == std::string::npos ? "" : text.substr(end + 1));
  // Names of files come apart at slashes and nowhere else.
  if (fields.stem.find('/') != std::string::npos || fields.ext.find('/') != std::string::npos) std::abort();
  fields.layout = "cube";
  fields.face = "px";
  for (const bool per_face : {false, true}) {
    const auto name = OutputName::parse(pattern, per_face);
    if (!name) continue;
    const std::string whole = name->expand(fields);
    if (!whole.starts_with(name->expand_beginning(fields))) std::abort();
    if (name->fixed() && whole != name->expand({})) std::abort();
  }
  return 0;
}
