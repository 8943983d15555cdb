// SPDX-License-Identifier: Apache-2.0
// Line charts as SVG: for a file of its own, and to stand inside a page.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace envconv::tool {

/// One curve.  Points that are not finite, or not above 0 on a logarithmic axis, are gaps in it.
struct Series {
  std::string name;          ///< in the legend; "" for none
  std::vector<double> x, y;  ///< as many of both; with `steps` one x more: y[i] holds from x[i] to x[i + 1]
  bool steps = false;        ///< a histogram: steps, with the area below them tinted
};

struct Axis {
  std::string label;  ///< with its unit: "latitude (degrees)"
  bool logarithmic = false;
  std::vector<double> ticks{};  ///< where to label; empty: round numbers
};

struct Chart {
  std::string title;
  Axis x, y;
  std::vector<Series> series;
  int width = 720, height = 420;  ///< in CSS pixels, the legend included
};

/// An <svg> element: readable on light and on dark screens (it follows the reader's colour scheme), without scripts and
/// without references to anything outside.  The same chart gives the same bytes.
std::string svg_of(const Chart& chart);

/// The text with what XML gives a meaning (& < > " ') escaped, and characters that it forbids replaced by '?'.
std::string xml_escaped(std::string_view text);

}  // namespace envconv::tool
