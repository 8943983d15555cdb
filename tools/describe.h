// SPDX-License-Identifier: Apache-2.0
// Layouts in words, for the listing, the manual and the README alike.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "envconv.h"

namespace envconv::tool {

/// "2:1", "3.56:1" ...: each different aspect of the layout's faces once.
std::string aspect_text(const Layout& layout);
/// The headings of the table of layouts, and a layout's row.
std::vector<std::string> layout_columns();
std::vector<std::string> layout_row(const Layout& layout);

/// The layouts of these names, all for none.  Errors: usage, for a name that no layout has.
Result<std::vector<const Layout*>> layouts_named(const std::vector<std::string>& names);

/// JSON has no infinity.
nlohmann::ordered_json finite_or_null(double value);

}  // namespace envconv::tool
