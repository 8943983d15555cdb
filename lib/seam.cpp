// SPDX-License-Identifier: Apache-2.0
#include "seam.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>

#include "assertion.h"
#include "face_reader.h"
#include "solid_angle.h"

namespace envconv {

std::span<const SeamKind> all_seam_kinds() {
  static constexpr SeamKind kinds[] = {
      {"none", SeamMethod::none, "true integrals over each texel, for hardware that filters across faces", ""},
      {"average", SeamMethod::average, "texels at an edge become the mean of those that meet there", "WIDTH", 1, 64},
      {"stretch", SeamMethod::stretch, "texel centres lie on the edges, where neighbours are equal", ""},
      {"gutter", SeamMethod::gutter, "each face grows by true radiance from beyond its edges", "TEXELS", 1, 64, true},
  };
  return kinds;
}

Result<Seam> parse_seam(std::string_view text) {
  const std::size_t colon = std::min(text.find(':'), text.size());
  for (const SeamKind& kind : all_seam_kinds()) {
    if (kind.name != text.substr(0, colon)) continue;
    Seam seam{kind.method, 0};
    const std::string name(kind.name);
    if (colon == text.size()) {
      if (kind.number_needed)
        return Error{ErrorCode::usage, "'" + name + "' needs a number (" + name + ":" + std::string(kind.number) + ")"};
      if (!kind.number.empty()) seam.texels = kind.least;
      return seam;
    }
    if (kind.number.empty()) return Error{ErrorCode::usage, "'" + name + "' takes no number"};
    const char* end = text.data() + text.size();
    const std::from_chars_result r = std::from_chars(text.data() + colon + 1, end, seam.texels);
    if (r.ec != std::errc() || r.ptr != end || seam.texels < kind.least || seam.texels > kind.most)
      return Error{ErrorCode::usage, "'" + std::string(text) + "': the number must be a whole one from " +
                                         std::to_string(kind.least) + " to " + std::to_string(kind.most)};
    return seam;
  }
  std::string list;
  for (const SeamKind& kind : all_seam_kinds()) list += (list.empty() ? "" : ", ") + std::string(kind.name);
  return Error{ErrorCode::usage, "'" + std::string(text) + "' is not one of " + list};
}

std::string text_of(const Seam& seam) {
  for (const SeamKind& kind : all_seam_kinds()) {
    if (kind.method != seam.method) continue;
    const bool is_plain = kind.number.empty() || (!kind.number_needed && seam.texels == kind.least);
    return std::string(kind.name) + (is_plain ? "" : ":" + std::to_string(seam.texels));
  }
  return "none";
}

Placement placement_for(const Layout& layout, const Seam& seam) {
  return seam.method == SeamMethod::stretch ? Placement::inclusive : layout.info().placement;
}

LookupScale lookup_scale(int n, Placement placement, int gutter) {
  if (placement == Placement::inclusive) return {(n - 2.0 * gutter - 1) / n, (gutter + 0.5) / n};
  return {(n - 2.0 * gutter) / n, static_cast<double>(gutter) / n};
}

namespace {

// One edge of a face, and its texels.
struct Edge {
  int face, side;  // sides: left, right, top, bottom
  Size size;
  int count() const { return side < 2 ? size.height : size.width; }
  int x(int k, int depth) const { return side == 0 ? depth : side == 1 ? size.width - 1 - depth : k; }
  int y(int k, int depth) const { return side == 2 ? depth : side == 3 ? size.height - 1 - depth : k; }
  // The face point at texel coordinate k along the edge, so many texels inside of it (outside: negative).
  void point(double k, double depth, Placement placement, double& u, double& v) const {
    const int along = count(), across = side < 2 ? size.width : size.height;
    const double a = u_from_texel(k, along, placement), in = depth * texel_extent(across, placement);
    const double b = side == 0 || side == 2 ? in : 1 - in;
    u = side < 2 ? b : a, v = side < 2 ? a : b;
  }
};

std::vector<Edge> edges_of(const EnvImage& image) {
  std::vector<Edge> edges;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int side = 0; side < 4; ++side) edges.push_back({f, side, {face.width(), face.height()}});
  }
  return edges;
}

// Texels that are to have one value: sets that can be joined.
class Groups {
 public:
  explicit Groups(const EnvImage& image) {
    for (const Image& face : image.faces) {
      first_.push_back(static_cast<int>(parent_.size()));
      width_.push_back(face.width());
      parent_.resize(parent_.size() + face.pixel_count());
    }
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int index(int face, int x, int y) const {
    return first_[static_cast<std::size_t>(face)] + y * width_[static_cast<std::size_t>(face)] + x;
  }
  int of(int index) {
    while (parent_[static_cast<std::size_t>(index)] != index) {
      int& parent = parent_[static_cast<std::size_t>(index)];
      parent = parent_[static_cast<std::size_t>(parent)];
      index = parent;
    }
    return index;
  }
  void join(int a, int b) {
    a = of(a), b = of(b);
    if (a != b) parent_[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }

 private:
  std::vector<int> first_, width_, parent_;
};

struct EdgeTexel {
  int face, x, y, index;
};

// Every texel along the faces' edges once.
std::vector<EdgeTexel> edge_texels(const EnvImage& image, const Groups& groups) {
  std::vector<EdgeTexel> texels;
  for (const Edge& edge : edges_of(image))
    for (int k = 0; k < edge.count(); ++k)
      texels.push_back({edge.face, edge.x(k, 0), edge.y(k, 0), groups.index(edge.face, edge.x(k, 0), edge.y(k, 0))});
  std::ranges::sort(texels, {}, &EdgeTexel::index);
  const auto same = [](const EdgeTexel& a, const EdgeTexel& b) { return a.index == b.index; };
  texels.erase(std::unique(texels.begin(), texels.end(), same), texels.end());
  return texels;
}

// Texels centred on one and the same direction: where faces meet whose texels lie on their edges, and at poles.
void join_same_directions(const EnvImage& image, Groups& groups) {
  struct Centre {
    Vec3 d;
    double key;
    int index;
  };
  constexpr double same = 1e-8;
  constexpr Vec3 generic{0.48, 0.13, 0.87};  // along which directions of regular grids hardly tie
  std::vector<Centre> centres;
  for (const EdgeTexel& t : edge_texels(image, groups)) {
    const Image& face = image.faces[static_cast<std::size_t>(t.face)];
    const double u = u_from_texel(t.x, face.width(), image.placement);
    const double v = u_from_texel(t.y, face.height(), image.placement);
    if (!image.layout->owns(t.face, u, v)) continue;
    const Vec3 d = image.layout->direction(t.face, u, v);
    centres.push_back({d, dot(d, generic), t.index});
  }
  std::ranges::stable_sort(centres, {}, &Centre::key);
  for (std::size_t i = 0; i < centres.size(); ++i)
    for (std::size_t j = i + 1; j < centres.size() && centres[j].key - centres[i].key < 2 * same; ++j)
      if (length(centres[j].d - centres[i].d) < same) groups.join(centres[i].index, centres[j].index);
}

// The point just across an edge, on the face that owns it.
Location across(const EnvImage& image, const Edge& edge, double k, double step) {
  double u, v;
  edge.point(k, 0, image.placement, u, v);
  const Vec3 on = image.layout->direction(edge.face, u, v);
  edge.point(k, step, image.placement, u, v);
  const Vec3 in = image.layout->direction(edge.face, u, v);
  return image.layout->locate(on + (on - in));
}

// Joins each texel of an edge with the one across it where the two grids meet texel to texel; tells whether they do.
bool join_across(const EnvImage& image, const Edge& edge, int k, Groups& groups) {
  constexpr double step = 1e-3, off = 0.02;  // texels
  const Location at = across(image, edge, k, step);
  const Image& face = image.faces[static_cast<std::size_t>(at.face)];
  const double x = texel_from_u(at.u, face.width(), image.placement);
  const double y = texel_from_u(at.v, face.height(), image.placement);
  const auto near_end = [&](double t, int n) { return t < -0.5 + off || t > n - 0.5 - off; };
  const auto on_centre = [&](double t) { return std::abs(t - std::round(t)) < off; };
  const bool meets = (near_end(x, face.width()) && on_centre(y)) || (near_end(y, face.height()) && on_centre(x));
  if (!meets) return false;
  const int i = std::clamp(static_cast<int>(std::lround(x)), 0, face.width() - 1);
  const int j = std::clamp(static_cast<int>(std::lround(y)), 0, face.height() - 1);
  groups.join(groups.index(edge.face, edge.x(k, 0), edge.y(k, 0)), groups.index(at.face, i, j));
  return true;
}

using Value = std::vector<double>;

// Where the grids don't meet: the radiance on the edge, halfway between a texel's and that as far beyond it.
struct Lone {
  EdgeTexel texel;
  Value sum;
  int count;
};

// Each group takes its mean, weighted by solid angle.
void merge(EnvImage& image, Groups& groups, const std::vector<EdgeTexel>& texels) {
  const auto channels = static_cast<std::size_t>(image.channels.count());
  std::vector<EdgeTexel> sorted = texels;
  std::ranges::stable_sort(sorted, {}, [&](const EdgeTexel& t) { return groups.of(t.index); });
  for (std::size_t i = 0, end; i < sorted.size(); i = end) {
    for (end = i + 1; end < sorted.size() && groups.of(sorted[end].index) == groups.of(sorted[i].index);) ++end;
    if (end == i + 1) continue;
    Value sum(channels, 0.0);
    double total = 0;
    for (std::size_t m = i; m < end; ++m) {
      const EdgeTexel& t = sorted[m];
      const Image& face = image.faces[static_cast<std::size_t>(t.face)];
      const double w =
          texel_solid_angle(*image.layout, t.face, t.x, t.y, {face.width(), face.height()}, image.placement);
      for (std::size_t c = 0; c < channels; ++c) sum[c] += w * static_cast<double>(face.at(t.x, t.y)[c]);
      total += w;
    }
    if (!(total > 0)) continue;
    for (std::size_t m = i; m < end; ++m) {
      float* to = image.faces[static_cast<std::size_t>(sorted[m].face)].at(sorted[m].x, sorted[m].y);
      for (std::size_t c = 0; c < channels; ++c) to[c] = static_cast<float>(sum[c] / total);
    }
  }
}

// Levels of one texel a face have no edges to agree on but all of them.
void merge_single_texels(EnvImage& image) {
  const std::vector<double> mean = mean_radiance(image);
  for (Image& face : image.faces)
    std::transform(mean.begin(), mean.end(), face.data(), [](double v) { return static_cast<float>(v); });
}

// Corrections of edge texels fade into the faces, linearly over the width; nothing falls below zero by them.
void fade(EnvImage& image, const std::vector<Image>& before, int width) {
  const int channels = image.channels.count();
  for (std::size_t f = 0; f < image.faces.size(); ++f) {
    Image& face = image.faces[f];
    const Image& old = before[f];
    const int w = face.width(), h = face.height();
    tbb::parallel_for(1, std::max(h - 1, 1), [&](int y) {
      for (int x = 1; x < w - 1; ++x) {
        const int depth[4] = {x, w - 1 - x, y, h - 1 - y};
        const int at[4][2] = {{0, y}, {w - 1, y}, {x, 0}, {x, h - 1}};
        double total = 0, weight[4];
        for (int s = 0; s < 4; ++s) total += weight[s] = std::max(0.0, 1 - static_cast<double>(depth[s]) / width);
        if (total == 0) {
          x = std::max(x, w - 1 - width);  // the middle of the row is out of reach
          continue;
        }
        for (int c = 0; c < channels; ++c) {
          double correction = 0;
          for (int s = 0; s < 4; ++s)
            correction +=
                weight[s] * static_cast<double>(face.at(at[s][0], at[s][1])[c] - old.at(at[s][0], at[s][1])[c]);
          const float v = old.at(x, y)[c];
          face.at(x, y)[c] = std::max(v + static_cast<float>(correction / std::max(1.0, total)), std::min(v, 0.0f));
        }
      }
    });
  }
}

void keep_mean(EnvImage& image, const std::vector<double>& mean) {
  const SphereMean after = sphere_mean(image);
  const std::size_t channels = mean.size();
  for (std::size_t c = 0; c < channels; ++c) {
    if (!(after.magnitude[c] > 0)) continue;
    const double share = (mean[c] - after.value[c]) / after.magnitude[c];
    for (Image& face : image.faces)
      for (std::size_t i = c; i < face.value_count(); i += channels)
        face.data()[i] += static_cast<float>(share * static_cast<double>(std::abs(face.data()[i])));
  }
}

void average(EnvImage& image, int width) {
  Groups groups(image);
  std::vector<Lone> lone;
  if (image.placement == Placement::inclusive) {
    join_same_directions(image, groups);
  } else {
    for (const Edge& edge : edges_of(image)) {
      double u, v;
      Vec3 last{};
      for (int k = 0; k < edge.count(); ++k) {
        edge.point(k, 1e-3, image.placement, u, v);
        if (!image.layout->owns(edge.face, u, v)) continue;
        const EdgeTexel texel{edge.face, edge.x(k, 0), edge.y(k, 0),
                              groups.index(edge.face, edge.x(k, 0), edge.y(k, 0))};
        edge.point(k, 0, image.placement, u, v);
        const Vec3 d = image.layout->direction(edge.face, u, v);
        // An edge that is one point of the sphere: all of its texels meet there.
        if (k > 0 && length(d - last) < 1e-9)
          groups.join(texel.index, groups.index(edge.face, edge.x(k - 1, 0), edge.y(k - 1, 0)));
        last = d;
        if (join_across(image, edge, k, groups)) continue;
        Lone one{texel, Value(static_cast<std::size_t>(image.channels.count())), 1};
        read_clamped(image, across(image, edge, k, 0.5), one.sum.data());
        lone.push_back(std::move(one));
      }
    }
  }
  const bool conserve = !lone.empty() || width > 1;
  std::vector<double> mean;
  std::vector<Image> before;
  if (conserve) mean = mean_radiance(image);
  if (width > 1)
    for (const Image& face : image.faces) before.push_back(face.clone());
  const std::vector<EdgeTexel> texels = edge_texels(image, groups);
  // A texel at a corner may stand in the list twice.
  std::ranges::stable_sort(lone, {}, [](const Lone& l) { return l.texel.index; });
  for (std::size_t i = 0, end; i < lone.size(); i = end) {
    float* to = image.faces[static_cast<std::size_t>(lone[i].texel.face)].at(lone[i].texel.x, lone[i].texel.y);
    for (end = i + 1; end < lone.size() && lone[end].texel.index == lone[i].texel.index;) ++end;
    for (std::size_t c = 0; c < lone[i].sum.size(); ++c) {
      double sum = static_cast<double>(to[c]);
      for (std::size_t m = i; m < end; ++m) sum += lone[m].sum[c];
      to[c] = static_cast<float>(sum / (1.0 + static_cast<double>(end - i)));
    }
  }
  merge(image, groups, texels);
  if (width > 1) fade(image, before, width);
  if (conserve) keep_mean(image, mean);
}

}  // namespace

void fix_seams(EnvImage& image, const Seam& seam) {
  if (seam.method == SeamMethod::average) return average(image, seam.texels);
  const bool stretch = seam.method == SeamMethod::stretch;
  if (stretch) ENVCONV_ASSERT(image.placement == Placement::inclusive);
  // Of texels on an edge a face has one half or less; where it is met they are read alone, and gutters don't show.
  const bool whole = seam.gutter() > 0 && image.placement == Placement::inclusive;
  if (!stretch && !whole) return;
  if (std::ranges::all_of(image.faces, [](const Image& face) { return face.pixel_count() == 1; })) {
    if (stretch) merge_single_texels(image);
    return;
  }
  Groups groups(image);
  join_same_directions(image, groups);
  merge(image, groups, edge_texels(image, groups));
}

}  // namespace envconv
