// SPDX-License-Identifier: Apache-2.0
#include "report.h"

#include <algorithm>
#include <cmath>

#include "error_picture.h"
#include "pixels.h"
#include "png.h"
#include "resample.h"
#include "svg.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr int picture_height = 384;
constexpr const char* style =
    "<style>:root{color-scheme:light dark}body{font:15px/1.45 sans-serif;max-width:110em;margin:1.5em auto;"
    "padding:0 1em;background:#fff;color:#222}h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}"
    "figure{margin:0}figure img{display:block;width:100%;height:auto}figcaption{padding:.3em 0 1em}"
    ".pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(24em,1fr));gap:0 1em}"
    ".scroll{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
    "th,td{padding:.25em .8em;text-align:right;border-bottom:1px solid #ccc}th:first-child{text-align:left}"
    "tr.total{font-weight:bold}.bad{color:#b00020}.plots{display:flex;flex-wrap:wrap;gap:1em}"
    ".plots svg{max-width:100%;height:auto}"
    "@media(prefers-color-scheme:dark){body{background:#16181c;color:#ddd}th,td{border-color:#444}.bad{color:#ff8a80}}"
    "</style>\n";

// The map as a lat-long of three channels: its first three colours, or one of them three times.
Result<Image> panorama(const EnvImage& map, int threads) {
  EnvImage finite;
  finite.layout = map.layout;
  finite.placement = map.placement;
  finite.consumer_from_world = map.consumer_from_world;
  finite.channels = map.channels;
  for (const Image& face : map.faces) {
    finite.faces.push_back(face.clone());
    if (count_nonfinite(face) > 0) repair_nonfinite(finite.faces.back());
  }
  ResampleOptions options;
  options.layout = find_layout("latlong");
  options.height = picture_height;
  options.threads = threads;
  ENVCONV_TRY(const EnvImage out, resample(finite, options));
  std::vector<int> colors;
  for (int c = 0; c < out.channels.count(); ++c)
    if (c != out.channels.alpha) colors.push_back(c);
  const Image& face = out.faces.front();
  Image picture(face.width(), face.height(), 3);
  for (std::size_t i = 0; i < face.pixel_count(); ++i)
    for (std::size_t c = 0; c < 3; ++c)
      picture.data()[3 * i + c] = face.data()[i * static_cast<std::size_t>(face.channels()) +
                                              static_cast<std::size_t>(colors[colors.size() >= 3 ? c : 0])];
  return picture;
}

// The value that is shown as white: what 19 of 20 values of the reference stay below, so that a sun does not darken the
// rest.
float white_of(const Image& picture) {
  std::vector<float> values(picture.data(), picture.data() + picture.value_count());
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 19 / 20);
  std::nth_element(values.begin(), at, values.end());
  return *at > 0 ? *at : 1.0f;
}

std::string embedded(const Image& picture, const std::string& alternative, const std::string& caption) {
  return "<figure><img width=\"" + std::to_string(picture.width()) + "\" height=\"" + std::to_string(picture.height()) +
         "\" alt=\"" + xml_escaped(alternative) + "\" src=\"data:image/png;base64," + base64(png_of(picture)) +
         "\">\n<figcaption>" + xml_escaped(caption) + "</figcaption></figure>\n";
}

std::string map_caption(char letter, const LoadedMap& map) {
  const Size size = face_size(*map.recognition.layout, 0, map.recognition.height);
  const int faces = map.recognition.layout->face_count();
  return std::string(1, letter) + ": " + visible(map.name) + " (" + std::string(map.recognition.layout->name()) +
         (faces > 1 ? ", " + std::to_string(faces) + " faces of " : ", ") + std::to_string(size.width) + "x" +
         std::to_string(size.height) + ")";
}

std::string table_row(const std::string& name, const std::vector<std::string>& cells, const char* cell,
                      const char* attributes) {
  std::string out = "<tr" + std::string(attributes) + "><th scope=\"row\">" + xml_escaped(name) + "</th>";
  for (const std::string& text : cells)
    out += "<" + std::string(cell) + ">" + xml_escaped(text) + "</" + std::string(cell) + ">";
  return out + "</tr>\n";
}

std::string figures_table(const Comparison& c) {
  std::string out = "<div class=\"scroll\"><table>\n<thead>" + table_row("channel", figure_headings(), "th", "") +
                    "</thead>\n<tbody>";
  for (std::size_t i = 0; i < c.channels.size(); ++i)
    out += table_row(visible(c.channels[i]), figure_cells(c.figures[i]), "td", "");
  return out + table_row("total", figure_cells(c.total), "td", " class=\"total\"") + "</tbody>\n</table></div>\n";
}

std::string paragraph(const std::string& text, bool bad = false) {
  return (bad ? "<p class=\"bad\">" : "<p>") + xml_escaped(text) + "</p>\n";
}

std::string remarks(const ReportInput& in) {
  const Comparison& c = in.comparison;
  std::string out;
  if (c.total.max_error > 0)
    out += paragraph("The largest error, " + figure_text(c.total.max_error) + ", is at " +
                     direction_text(c.total.max_error_direction) + ".");
  out += paragraph("PSNR's peak is " + figure_text(c.peak) + ". Values are linear.");
  for (const auto& [letter, count] : {std::pair{"A", c.nonfinite_a}, std::pair{"B", c.nonfinite_b}})
    if (count > 0) out += paragraph(std::string(letter) + ": " + nonfinite_text(count) + ".", true);
  if (c.excluded > 0)
    out += paragraph(number_text(100 * c.excluded, 4) + " % of the sphere could not be compared.", true);
  for (const Failure& failure : in.failed) out += paragraph(failure_text(c, failure), true);
  return out;
}

std::string plots(const ErrorProfile& profile) {
  Series by_latitude, distribution;
  for (int i = 0; i < ErrorProfile::bands; ++i) {
    by_latitude.x.push_back(90 - (i + 0.5) * 180 / ErrorProfile::bands);
    by_latitude.y.push_back(profile.rmse_by_latitude[static_cast<std::size_t>(i)]);
  }
  distribution.steps = true;
  distribution.x = profile.edges;
  for (const double share : profile.share) distribution.y.push_back(100 * share);
  Chart latitude{.title = "Error against latitude",
                 .x = {"latitude (degrees)", false, {-90, -60, -30, 0, 30, 60, 90}},
                 .y = {"root mean square error"},
                 .series = {by_latitude},
                 .width = 570,
                 .height = 380};
  Chart histogram{.title = "Distribution of the error",
                  .x = {"error", true, {}},
                  .y = {"share of the sphere (%)"},
                  .series = {distribution},
                  .width = 570,
                  .height = 380};
  return "<div class=\"plots\">\n" + svg_of(latitude) + svg_of(histogram) + "</div>\n" +
         (profile.equal_share > 0
              ? paragraph("On " + number_text(100 * profile.equal_share, 4) + " % of the sphere there is no error.")
              : "");
}

}  // namespace

Result<std::string> report_page(const ReportInput& in) {
  const EnvImage &a = in.a.image, &b = in.b.image;
  ENVCONV_TRY(Image picture_a, panorama(a, in.threads));
  ENVCONV_TRY(Image picture_b, panorama(b, in.threads));
  const float exposure = 1 / white_of(picture_a);
  for (Image* picture : {&picture_a, &picture_b}) scale_color(*picture, -1, exposure);
  ENVCONV_TRY(const EnvImage errors, error_map(a, b, *find_layout("latlong"), picture_height, in.threads));
  ENVCONV_TRY(const Image map,
              error_picture(errors, *find_packing("row"), error_scale(errors), "root mean square error"));
  ENVCONV_TRY(const ErrorProfile profile, error_profile(a, b, in.threads));
  const std::string title = "Comparison of " + visible(in.a.name) + " and " + visible(in.b.name);
  const std::string white = number_text(static_cast<double>(1 / exposure), 4);
  std::string page = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n";
  page +=
      "<meta name=\"viewport\" content=\"width=device-width\">\n<title>" + xml_escaped(title) + "</title>\n" + style;
  page += "</head>\n<body>\n<h1>" + xml_escaped(title) + "</h1>\n<div class=\"pictures\">\n";
  page += embedded(picture_a, "map A", map_caption('A', in.a)) + embedded(picture_b, "map B", map_caption('B', in.b));
  page += "</div>\n" + paragraph("Both maps are drawn as lat-longs, " + white + " as white.");
  page += embedded(map, "error map", "Root mean square error over the colour channels, as a lat-long.");
  page += "<h2>Figures</h2>\n" + figures_table(in.comparison) + remarks(in);
  return page + "<h2>Where and how much</h2>\n" + plots(profile) + "</body>\n</html>\n";
}

}  // namespace envconv::tool
