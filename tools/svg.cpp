// SPDX-License-Identifier: Apache-2.0
#include "svg.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "colormap.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr double font_size = 12, letter = 0.58 * font_size;  // mean advance of a sans-serif letter
constexpr int colours = 8;                                   // then the dashes change
constexpr int dash_patterns = 4;

std::string coordinate(double x) { return number_text(std::round(x * 100) / 100, 7); }

// One axis in its own space: logarithms on a logarithmic axis.
class Scale {
 public:
  Scale(const Axis& axis, std::vector<double> values, double begin, double end)
      : axis_(axis), begin_(begin), end_(end) {
    std::erase_if(values, [&](double v) { return !shown(v); });
    const auto [low, high] = std::ranges::minmax_element(values);
    low_ = values.empty() ? (axis.logarithmic ? 1 : 0) : *low;
    high_ = values.empty() ? low_ + 1 : *high;
    if (low_ == high_) widen();
    if (axis.logarithmic) {
      const double margin = std::pow(high_ / low_, 0.03);  // curves then do not touch the frame
      low_ /= margin, high_ *= margin;
    }
    if (axis.ticks.empty()) {
      choose_ticks();
    } else {
      ticks_ = axis.ticks;
    }
  }
  bool shown(double v) const { return std::isfinite(v) && (!axis_.logarithmic || v > 0); }
  double position(double v) const {
    return begin_ + (inner(v) - inner(low_)) / (inner(high_) - inner(low_)) * (end_ - begin_);
  }
  const std::vector<double>& ticks() const { return ticks_; }
  const std::vector<double>& minor_ticks() const { return minor_; }

 private:
  double inner(double v) const { return axis_.logarithmic ? std::log10(v) : v; }
  void widen() {
    if (axis_.logarithmic) {
      low_ /= 2, high_ *= 2;
    } else {
      const double half = low_ == 0 ? 1 : std::abs(low_) / 2;
      low_ -= half, high_ += half;
    }
  }
  void choose_ticks() {
    if (axis_.logarithmic && high_ / low_ >= 5)
      choose_decades();
    else
      choose_round();
  }
  // 1, 2 and 5 times powers of ten; over many decades, the powers alone, or each n-th of them.
  void choose_decades() {
    const int first = static_cast<int>(std::floor(std::log10(low_) + 1e-9));
    const int last = static_cast<int>(std::ceil(std::log10(high_) - 1e-9));
    const int every = (last - first + 7) / 8;
    for (int k = first; k <= last; ++k) {
      const double power = std::pow(10, k);
      for (int m = 1; m <= 9; ++m) {
        const double tick = m * power;
        if (tick < low_ * (1 - 1e-9) || tick > high_ * (1 + 1e-9)) continue;
        const bool labelled = m == 1 ? (k - first) % every == 0 : (last - first <= 2 && (m == 2 || m == 5));
        (labelled ? ticks_ : minor_).push_back(tick);
      }
    }
  }
  // 4 to 9 multiples of 1, 2 or 5 times a power of ten; the axis ends at a multiple when it is not logarithmic.
  void choose_round() {
    const double power = std::pow(10, std::floor(std::log10((high_ - low_) / 4)));
    double step = power;
    for (const double m : {1.0, 2.0, 5.0, 10.0}) {
      if ((high_ - low_) / (m * power) >= 3.9) step = m * power;
    }
    if (!axis_.logarithmic) {
      low_ = step * std::floor(low_ / step + 1e-9);
      high_ = step * std::ceil(high_ / step - 1e-9);
    }
    const auto first = static_cast<std::int64_t>(std::ceil(low_ / step - 1e-9));
    const auto last = static_cast<std::int64_t>(std::floor(high_ / step + 1e-9));
    for (std::int64_t i = first; i <= last; ++i) ticks_.push_back(static_cast<double>(i) * step);
  }

  const Axis& axis_;
  double begin_, end_, low_, high_;
  std::vector<double> ticks_, minor_;
};

std::string hex(const Rgb& color) {
  constexpr char digits[] = "0123456789abcdef";
  std::string out = "#";
  for (const double v : color) {
    const auto byte = static_cast<unsigned>(std::lround(255 * v));
    out += digits[byte / 16];
    out += digits[byte % 16];
  }
  return out;
}

// Classes s0 ... s7 colour a curve and its markers.  Neighbours in the list are far apart in hue.
std::string palette(double lightness) {
  std::string out;
  for (int i = 0; i < colours; ++i) {
    const std::string color = hex(srgb_from_oklch(lightness, 0.15, 25 + 360.0 / colours * (i * 3 % colours)));
    out += ".s" + std::to_string(i) + "{color:" + color + "}";
  }
  return out;
}

std::string style() {
  return "<style>svg.chart{font:" + number_text(font_size, 3) +
         "px sans-serif}.chart .back{fill:#fff}.chart text{fill:#222}.chart .grid{stroke:#ddd;fill:none}"
         ".chart .frame{stroke:#666;fill:none}.chart .curve{stroke:currentColor;stroke-width:1.8;fill:none;"
         "stroke-linejoin:round}.chart .dot{fill:currentColor}.chart .area{fill:currentColor;fill-opacity:.25}" +
         palette(0.55) +
         "@media(prefers-color-scheme:dark){.chart .back{fill:#16181c}.chart text{fill:#ddd}"
         ".chart .grid{stroke:#333}.chart .frame{stroke:#999}" +
         palette(0.75) + "}</style>\n";
}

std::string text_at(double x, double y, std::string_view anchor, std::string_view words, std::string_view more = "") {
  return "<text x=\"" + coordinate(x) + "\" y=\"" + coordinate(y) + "\" text-anchor=\"" + std::string(anchor) + "\"" +
         std::string(more) + ">" + xml_escaped(words) + "</text>\n";
}

std::string line(double x0, double y0, double x1, double y1, std::string_view kind) {
  return "<line class=\"" + std::string(kind) + "\" x1=\"" + coordinate(x0) + "\" y1=\"" + coordinate(y0) + "\" x2=\"" +
         coordinate(x1) + "\" y2=\"" + coordinate(y1) + "\"/>\n";
}

// "class=... stroke-dasharray=..." of the i-th curve.
std::string curve_look(std::size_t i) {
  constexpr const char* dashes[dash_patterns] = {"", "7 4", "2 3", "9 3 2 3"};
  const std::string dash = dashes[i / colours % dash_patterns];
  return "class=\"curve s" + std::to_string(i % colours) + "\"" +
         (dash.empty() ? "" : " stroke-dasharray=\"" + dash + "\"");
}

std::string dot(double x, double y, std::size_t i) {
  return "<circle class=\"dot s" + std::to_string(i % colours) + "\" cx=\"" + coordinate(x) + "\" cy=\"" +
         coordinate(y) + "\" r=\"2.6\"/>\n";
}

std::string steps_of(const Series& s, std::size_t i, const Scale& x, const Scale& y, double floor) {
  std::string path;
  double first = 0, last = 0;
  for (std::size_t k = 0; k < s.y.size(); ++k) {
    if (!x.shown(s.x[k]) || !x.shown(s.x[k + 1])) continue;
    const double top = y.shown(s.y[k]) ? std::min(y.position(s.y[k]), floor) : floor;
    last = x.position(s.x[k + 1]);
    if (path.empty()) first = x.position(s.x[k]);
    path +=
        (path.empty() ? "M" : "L") + coordinate(x.position(s.x[k])) + " " + coordinate(top) + "H" + coordinate(last);
  }
  if (path.empty()) return "";
  const std::string area = path + "V" + coordinate(floor) + "H" + coordinate(first) + "Z";
  return "<path class=\"area s" + std::to_string(i % colours) + "\" d=\"" + area + "\"/>\n<path " + curve_look(i) +
         " d=\"" + path + "\"/>\n";
}

std::string curve_of(const Series& s, std::size_t i, const Scale& x, const Scale& y) {
  constexpr std::size_t most_dots = 32;  // more would hide the curve
  std::string path, dots;
  bool gap = true;
  for (std::size_t k = 0; k < s.x.size(); ++k) {
    if (!x.shown(s.x[k]) || !y.shown(s.y[k])) {
      gap = true;
      continue;
    }
    const double px = x.position(s.x[k]), py = y.position(s.y[k]);
    path += (gap ? "M" : "L") + coordinate(px) + " " + coordinate(py);
    gap = false;
    if (s.x.size() <= most_dots) dots += dot(px, py, i);
  }
  return path.empty() ? "" : "<path " + curve_look(i) + " d=\"" + path + "\"/>\n" + dots;
}

std::vector<double> all_values(const Chart& chart, std::vector<double> Series::*values) {
  std::vector<double> all;
  for (const Series& s : chart.series) all.insert(all.end(), (s.*values).begin(), (s.*values).end());
  return all;
}

std::size_t longest_name(const Chart& chart) {
  std::size_t most = 0;
  for (const Series& s : chart.series) most = std::max(most, s.name.size());
  return most;
}

}  // namespace

std::string xml_escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      case '\'': out += "&#39;"; break;
      default: out += static_cast<unsigned char>(c) < ' ' && c != '\n' && c != '\t' ? '?' : c;
    }
  }
  return out;
}

std::string svg_of(const Chart& chart) {
  const std::size_t name_length = longest_name(chart);
  const double legend = name_length > 0 ? 44 + letter * static_cast<double>(name_length) : 16;
  const double left = 72, right = chart.width - legend, top = chart.title.empty() ? 14 : 36, bottom = chart.height - 50;
  std::vector<double> ys = all_values(chart, &Series::y);
  // Areas stand on 0.
  if (!chart.y.logarithmic && std::ranges::any_of(chart.series, &Series::steps)) ys.push_back(0);
  const Scale x(chart.x, all_values(chart, &Series::x), left, right), y(chart.y, std::move(ys), bottom, top);
  const std::string width = std::to_string(chart.width), height = std::to_string(chart.height);
  std::string out = "<svg class=\"chart\" xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" width=\"" + width +
                    "\" height=\"" + height + "\" viewBox=\"0 0 " + width + " " + height + "\">\n<title>" +
                    xml_escaped(chart.title) + "</title>\n" + style() + "<rect class=\"back\" width=\"" + width +
                    "\" height=\"" + height + "\"/>\n";
  if (!chart.title.empty())
    out += text_at((left + right) / 2, 22, "middle", chart.title, " font-size=\"14\" font-weight=\"bold\"");
  for (const double t : x.minor_ticks()) out += line(x.position(t), bottom, x.position(t), bottom - 4, "frame");
  for (const double t : y.minor_ticks()) out += line(left, y.position(t), left + 4, y.position(t), "frame");
  for (const double t : x.ticks()) {
    out += line(x.position(t), top, x.position(t), bottom, "grid");
    out += text_at(x.position(t), bottom + 17, "middle", number_text(t, 6));
  }
  for (const double t : y.ticks()) {
    out += line(left, y.position(t), right, y.position(t), "grid");
    out += text_at(left - 7, y.position(t) + 4, "end", number_text(t, 6));
  }
  out += "<rect class=\"frame\" x=\"" + coordinate(left) + "\" y=\"" + coordinate(top) + "\" width=\"" +
         coordinate(right - left) + "\" height=\"" + coordinate(bottom - top) + "\"/>\n";
  out += text_at((left + right) / 2, bottom + 38, "middle", chart.x.label);
  const std::string middle = coordinate((top + bottom) / 2);
  out += text_at(16, (top + bottom) / 2, "middle", chart.y.label, " transform=\"rotate(-90 16 " + middle + ")\"");
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const Series& s = chart.series[i];
    out += s.steps ? steps_of(s, i, x, y, bottom) : curve_of(s, i, x, y);
  }
  for (std::size_t i = 0; i < chart.series.size() && name_length > 0; ++i) {
    const double at = top + 8 + 17 * static_cast<double>(i);
    out += "<path " + curve_look(i) + " d=\"M" + coordinate(right + 10) + " " + coordinate(at) + "h24\"/>\n" +
           dot(right + 22, at, i) + text_at(right + 40, at + 4, "start", chart.series[i].name);
  }
  return out + "</svg>\n";
}

}  // namespace envconv::tool
