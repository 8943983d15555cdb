// SPDX-License-Identifier: Apache-2.0
// A comparison as one page that needs nothing else: no scripts, no other files, no network.
#pragma once

#include <string>
#include <vector>

#include "figures.h"
#include "input.h"
#include "metrics.h"
#include "result.h"

namespace envconv::tool {

struct ReportInput {
  const LoadedMap &a, &b;
  const Comparison& comparison;
  const std::vector<Failure>& failed;
  int threads = 0;
};
/// HTML 5.  Pictures are embedded: both maps as lat-longs, toned by the same curve, and the error map; below them a
/// table of the figures and plots of the error against latitude and of its distribution.  The same comparison gives the
/// same bytes.  Errors: those of resample() and compare_maps().
Result<std::string> report_page(const ReportInput& input);

}  // namespace envconv::tool
