// SPDX-License-Identifier: Apache-2.0
#include "source.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "assertion.h"
#include "solid_angle.h"
#include "source_blocks.h"

namespace envconv {
namespace {

// Pixel position whose fraction is a rounding error counts as the pixel itself.
constexpr double on_texel = 1e-6;

// Interpolating kernel for texels read from across seams: sinc under a Kaiser window (beta 7.5), eight taps.
constexpr int adopt_taps = 8;
std::array<float, adopt_taps> adopt_weights(double f) {
  std::array<double, adopt_taps> w;
  double sum = 0;
  for (int k = 0; k < adopt_taps; ++k) {
    const double t = k - (adopt_taps / 2 - 1) - f;
    const double r = t / (adopt_taps / 2);
    double value = 0;
    if (std::abs(r) < 1)
      value = std::cyl_bessel_i(0.0, 7.5 * std::sqrt(1 - r * r)) * (t == 0 ? 1.0 : std::sin(M_PI * t) / (M_PI * t));
    w[static_cast<std::size_t>(k)] = value;
    sum += value;
  }
  std::array<float, adopt_taps> out;
  for (std::size_t k = 0; k < adopt_taps; ++k) out[k] = static_cast<float>(w[k] / sum);
  return out;
}

// The same from a table: 1024 steps, linear between them.
struct AdoptTable {
  std::array<std::array<float, adopt_taps>, 1025> rows;
  AdoptTable() {
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = adopt_weights(static_cast<double>(i) / 1024);
  }
  std::array<float, adopt_taps> at(double f) const {
    const double x = f * 1024;
    const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(x), 1023);
    const float t = static_cast<float>(x - static_cast<double>(i));
    std::array<float, adopt_taps> w;
    for (std::size_t k = 0; k < adopt_taps; ++k) w[k] = rows[i][k] + t * (rows[i + 1][k] - rows[i][k]);
    return w;
  }
};

}  // namespace

int apron_width(Kernel kernel) {
  const int reach = taps(kernel) / 2 + 1;
  return kernel == Kernel::band_limited ? SourceBlocks::margin + reach : std::max(reach, 4);
}

Source::Source(const EnvImage& image, int first_channel, const Filter& filter)
    : layout_(image.layout), placement_(image.placement) {
  ENVCONV_ASSERT(image.faces.size() == layout_->info().faces.size() && first_channel < image.channels.count());
  ENVCONV_ASSERT(faces_.size() <= most_faces);
  apron_ = apron_width(filter.kernel);
  place_faces(image);
  copy_pixels(image, first_channel);
  if (filter.limited) {
    split_highlights();
    if (highlights_.any()) spread_highlights();
  }
  make_strips();
  std::vector<Orphan> orphans;
  find_orphans(orphans);
  adopt(orphans);
  if (highlights_.any()) copy_highlights(orphans);
}

void Source::place_faces(const EnvImage& image) {
  std::int64_t blocks = 0;
  for (int f = 0; f < layout_->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    ENVCONV_ASSERT(!face.empty() && face.channels() == image.channels.count());
    SourceFace s;
    s.size = {face.width(), face.height()};
    s.columns = s.size.width + 2 * apron_;
    s.rows = s.size.height + 2 * apron_;
    const auto affine = [&](int n, float& scale, float& bias) {
      bias = static_cast<float>(texel_from_u(0.0, n, placement_) + apron_);
      scale = static_cast<float>(texel_from_u(1.0, n, placement_) - texel_from_u(0.0, n, placement_));
    };
    affine(s.size.width, s.scale_u, s.bias_u);
    affine(s.size.height, s.scale_v, s.bias_v);
    s.blocks = (s.columns + Highlights::side - 1) / Highlights::side;
    s.first_block = static_cast<std::int32_t>(blocks);
    blocks += static_cast<std::int64_t>(s.blocks) * ((s.rows + Highlights::side - 1) / Highlights::side);
    if (blocks > std::numeric_limits<std::int32_t>::max()) throw std::length_error("the source has too many texels");
    const auto i = static_cast<std::size_t>(f);
    maps_.scale_u[i] = s.scale_u, maps_.bias_u[i] = s.bias_u;
    maps_.scale_v[i] = s.scale_v, maps_.bias_v[i] = s.bias_v;
    faces_.push_back(s);
  }
  highlights_.index.assign(static_cast<std::size_t>(blocks), -1);
  highlights_.reachable.assign(static_cast<std::size_t>(blocks), 0);
}

// Three or four channels are read where they are, unless the layout has texels to be adopted inside its faces.
void Source::copy_pixels(const EnvImage& image, int first_channel) {
  const int stored = image.channels.count(), count = std::min(4, stored - first_channel);
  channels_ = count == 3 ? 3 : 4;
  const bool in_place = stored == channels_ && layout_->info().domain == Domain::square;
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    SourceFace& s = faces_[f];
    s.pitch = static_cast<std::ptrdiff_t>(s.size.width) * channels_;
    const Image& face = image.faces[f];
    if (in_place) {
      s.pixels = face.data();
      continue;
    }
    Image copy(s.size.width, s.size.height, channels_);
    tbb::parallel_for(0, s.size.height, [&](int y) {
      const float* from = face.row(y) + first_channel;
      float* to = copy.row(y);
      for (int x = 0; x < s.size.width; ++x, from += stored, to += channels_) {
        for (int c = 0; c < count; ++c) to[c] = from[c];
        for (int c = count; c < channels_; ++c) to[c] = 0;
      }
    });
    s.pixels = copy.data();
    copies_.push_back(std::move(copy));
  }
}

// Lanes take channels in turn: four texels of three channels are twelve floats, three of four as well.
Source::RowRange Source::range_of(const SourceFace& face, int row) const {
  const float* from = face.pixels + row * face.pitch;
  float low[12], high[12];
  std::fill_n(low, 12, std::numeric_limits<float>::max());
  std::fill_n(high, 12, std::numeric_limits<float>::lowest());
  const std::ptrdiff_t n = face.pitch, whole = n / 12 * 12;
  for (std::ptrdiff_t i = 0; i < whole; i += 12)
    for (int l = 0; l < 12; ++l) {
      low[l] = from[i + l] < low[l] ? from[i + l] : low[l];
      high[l] = from[i + l] > high[l] ? from[i + l] : high[l];
    }
  for (std::ptrdiff_t i = whole; i < n; ++i) {
    low[i - whole] = std::min(low[i - whole], from[i]);
    high[i - whole] = std::max(high[i - whole], from[i]);
  }
  RowRange range;
  range.low.fill(std::numeric_limits<float>::max());
  range.brightest = 0;
  for (int l = 0; l < 12; ++l) {
    float& to = range.low[static_cast<std::size_t>(l % channels_)];
    to = std::min(to, low[l]);
    if (l % channels_ < 3) range.brightest = std::max({range.brightest, high[l], -low[l]});
  }
  return range;
}

// Above, below, left and right of the face, with some texels of it: a window that is not wholly in the face is wholly
// in one of them.  A small face is one strip.
void Source::make_strips() {
  constexpr int inside = 8, small = 64;
  static_assert(inside >= taps(Kernel::lanczos3) + 2);
  strips_.resize(faces_.size());
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    const auto add = [&](int x, int y, int width, int height) {
      Strip strip{x, y, Image(width, height, channels_)};
      strip.pixels.fill(0);
      for (int j = std::max(y, apron_); j < std::min(y + height, apron_ + s.size.height); ++j) {
        const int begin = std::max(x, apron_), end = std::min(x + width, apron_ + s.size.width);
        if (begin < end) copy_row(static_cast<int>(f), begin, j, end - begin, strip.pixels.at(begin - x, j - y));
      }
      strips_[f].push_back(std::move(strip));
    };
    if (s.size.width < small || s.size.height < small) {
      add(0, 0, s.columns, s.rows);
      continue;
    }
    const int band = apron_ + inside;
    add(0, 0, s.columns, band);
    add(0, s.rows - band, s.columns, band);
    add(0, 0, band, s.rows);
    add(s.columns - band, 0, band, s.rows);
  }
}

const Strip& Source::strip_at(int face, int x, int y) const {
  const std::vector<Strip>& strips = strips_[static_cast<std::size_t>(face)];
  for (const Strip& strip : strips)
    if (strip.holds(x, y)) return strip;
  ENVCONV_ASSERT(false);
  return strips.front();
}

void Source::point(Kernel kernel, int n, const float* face, Windows& windows) const {
  for (int i = 0; i < n;) {
    const WindowField field = field_about(kernel, static_cast<int>(face[i]), windows.x[i], windows.y[i]);
    i = point_windows(field, channels_, face, i, n, windows);
  }
}

// The face's own pixels or the strip that hold the kernel's window about padded texel (x, y).
WindowField Source::field_about(Kernel kernel, int face, int x, int y) const {
  const int before = taps_before(kernel), after = taps(kernel) - 1 - before;
  const auto field = [&](int left, int top, int width, int height, const float* pixels, std::ptrdiff_t pitch) {
    return WindowField{left + before,
                       top + before,
                       left + width - after,
                       top + height - after,
                       pixels - (top + before) * pitch - (left + before) * channels_,
                       pitch};
  };
  const auto holds = [&](const WindowField& f) { return x >= f.left && x < f.right && y >= f.top && y < f.bottom; };
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const WindowField inside = field(apron_, apron_, s.size.width, s.size.height, s.pixels, s.pitch);
  if (holds(inside)) [[likely]]
    return inside;
  for (const Strip& strip : strips_[static_cast<std::size_t>(face)]) {
    const WindowField f = field(strip.x, strip.y, strip.pixels.width(), strip.pixels.height(), strip.pixels.data(),
                                static_cast<std::ptrdiff_t>(strip.pixels.width()) * channels_);
    if (holds(f)) return f;
  }
  ENVCONV_ASSERT(false);
  return inside;
}

void Source::copy_row(int face, int x, int y, int count, float* out) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const auto texels = [&](int n) { return static_cast<std::size_t>(n * channels_) * sizeof(float); };
  int at = x;
  const int end = x + count;
  while (at < end) {
    float* to = out + (at - x) * channels_;
    if (in_face(s, at, y)) {
      const int n = std::min(end, apron_ + s.size.width) - at;
      std::memcpy(to, pixel(s, at, y), texels(n));
      at += n;
    } else {
      const Strip& strip = strip_at(face, at, y);
      const int stop =
          at < apron_ && y >= apron_ && y < apron_ + s.size.height ? apron_ : strip.x + strip.pixels.width();
      const int n = std::min(end, stop) - at;
      std::memcpy(to, strip.pixels.at(at - strip.x, y - strip.y), texels(n));
      at += n;
    }
  }
  if (!highlights_.any() || y < apron_ || y >= apron_ + s.size.height) return;
  constexpr int side = Highlights::side;
  for (int block_x = x / side * side; block_x < end; block_x += side) {
    const Highlights::Block* block = highlights_.block_at(s, block_x, y);
    if (!block) continue;
    for (int i = std::max(x, block_x); i < std::min(end, block_x + side); ++i) {
      const int k = Highlights::place(i, y);
      if (block->split[k]) std::copy_n(block->base[k], channels_, out + (i - x) * channels_);
    }
  }
}

const float* Source::row_in_place(int face, int x, int y, int count) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  if (!in_face(s, x, y) || !in_face(s, x + count - 1, y)) return nullptr;
  if (highlights_.any())
    for (int block_x = x / Highlights::side * Highlights::side; block_x < x + count; block_x += Highlights::side)
      if (highlights_.block_at(s, block_x, y)) return nullptr;
  return pixel(s, x, y);
}

Source::Texel Source::read(int face, int x, int y) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  Texel texel{};
  if (!in_face(s, x, y)) {
    const Strip& strip = strip_at(face, x, y);
    std::copy_n(strip.pixels.at(x - strip.x, y - strip.y), channels_, texel.data());
    return texel;
  }
  std::copy_n(pixel(s, x, y), channels_, texel.data());
  if (highlights_.any()) {
    const Highlights::Block* block = highlights_.block_at(s, x, y);
    const int k = Highlights::place(x, y);
    if (block && block->split[k]) std::copy_n(block->base[k], channels_, texel.data());
  }
  return texel;
}

// To the own copy when it is inside the face, and to every strip that holds it.
void Source::write(const Orphan& orphan, const Texel& value) {
  const auto f = static_cast<std::size_t>(orphan.face);
  const SourceFace& s = faces_[f];
  if (in_face(s, orphan.x, orphan.y))
    std::copy_n(value.data(), channels_, copies_[f].at(orphan.x - apron_, orphan.y - apron_));
  for (Strip& strip : strips_[f])
    if (strip.holds(orphan.x, orphan.y))
      std::copy_n(value.data(), channels_, strip.pixels.at(orphan.x - strip.x, orphan.y - strip.y));
}

void Source::find_orphans(std::vector<Orphan>& orphans) const {
  // Rows are searched in parallel, and their finds joined in order.
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    std::vector<std::vector<Orphan>> rows(static_cast<std::size_t>(s.rows));
    const bool whole = layout_->info().domain == Domain::square;
    tbb::parallel_for(0, s.rows, [&](int y) {
      const bool inside_row = y >= apron_ && y < apron_ + s.size.height;
      for (int x = 0; x < s.columns; ++x) {
        if (inside_row && whole && x == apron_) x += s.size.width;  // all owned
        const double u = u_from_texel(x - apron_, s.size.width, placement_);
        const double v = u_from_texel(y - apron_, s.size.height, placement_);
        if (inside_row && x >= apron_ && x < apron_ + s.size.width && layout_->owns(static_cast<int>(f), u, v))
          continue;
        const Location at = layout_->locate(layout_->direction(static_cast<int>(f), u, v));
        const SourceFace& o = faces_[static_cast<std::size_t>(at.face)];
        rows[static_cast<std::size_t>(y)].push_back({static_cast<std::int32_t>(f), x, y, at.face,
                                                     texel_from_u(at.u, o.size.width, placement_) + apron_,
                                                     texel_from_u(at.v, o.size.height, placement_) + apron_});
      }
    });
    for (const auto& row : rows) orphans.insert(orphans.end(), row.begin(), row.end());
  }
}

void Source::adopt(const std::vector<Orphan>& orphans) {
  static const AdoptTable table;
  // Taps may fall on orphans themselves, near seams' ends: the first pass takes the nearest owned texel, the next ones
  // refine.  Each pass reads the one before only, so that the order (and the thread count) does not matter.
  std::vector<std::vector<bool>> orphaned;  // by face, inside it
  if (layout_->info().domain != Domain::square) {
    for (const SourceFace& s : faces_)
      orphaned.emplace_back(static_cast<std::size_t>(s.size.width) * static_cast<std::size_t>(s.size.height));
    for (const Orphan& o : orphans) {
      const SourceFace& s = faces_[static_cast<std::size_t>(o.face)];
      if (in_face(s, o.x, o.y))
        orphaned[static_cast<std::size_t>(o.face)]
                [static_cast<std::size_t>(o.y - apron_) * static_cast<std::size_t>(s.size.width) +
                 static_cast<std::size_t>(o.x - apron_)] = true;
    }
  }
  const auto nearest_owned = [&](const Orphan& o) {
    const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
    int best_x = -1, best_y = -1;
    double best_distance = 1e30;
    const int cx = static_cast<int>(std::lround(o.from_x)), cy = static_cast<int>(std::lround(o.from_y));
    for (int radius = 0; radius <= 3 && best_x < 0; ++radius)
      for (int y = cy - radius; y <= cy + radius; ++y)
        for (int x = cx - radius; x <= cx + radius; ++x) {
          const int xx = std::clamp(x, apron_, apron_ + s.size.width - 1),
                    yy = std::clamp(y, apron_, apron_ + s.size.height - 1);
          if (!orphaned.empty() &&
              orphaned[static_cast<std::size_t>(o.from_face)]
                      [static_cast<std::size_t>(yy - apron_) * static_cast<std::size_t>(s.size.width) +
                       static_cast<std::size_t>(xx - apron_)])
            continue;
          const double distance = (xx - o.from_x) * (xx - o.from_x) + (yy - o.from_y) * (yy - o.from_y);
          if (distance < best_distance) best_distance = distance, best_x = xx, best_y = yy;
        }
    return best_x < 0 ? Texel{} : read(o.from_face, best_x, best_y);
  };
  std::vector<Texel> values(orphans.size());
  for (int pass = 0; pass < 4; ++pass) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, orphans.size(), 256), [&](const auto& range) {
      for (std::size_t i = range.begin(); i != range.end(); ++i) {
        const Orphan& o = orphans[i];
        const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
        const double nearest_x = std::round(o.from_x), nearest_y = std::round(o.from_y);
        const bool exact = std::abs(o.from_x - nearest_x) < on_texel && std::abs(o.from_y - nearest_y) < on_texel;
        if (pass == 0 || exact) {
          values[i] = nearest_owned(o);
          continue;
        }
        const int x0 = static_cast<int>(std::floor(o.from_x)), y0 = static_cast<int>(std::floor(o.from_y));
        const auto wx = table.at(o.from_x - x0), wy = table.at(o.from_y - y0);
        Texel sum{};
        for (int j = 0; j < adopt_taps; ++j) {
          const int y = std::clamp(y0 + j - (adopt_taps / 2 - 1), 0, s.rows - 1);
          Texel row{};
          for (int k = 0; k < adopt_taps; ++k) {
            const int x = std::clamp(x0 + k - (adopt_taps / 2 - 1), 0, s.columns - 1);
            const Texel t = read(o.from_face, x, y);
            for (std::size_t c = 0; c < 4; ++c) row[c] += wx[static_cast<std::size_t>(k)] * t[c];
          }
          for (std::size_t c = 0; c < 4; ++c) sum[c] += wy[static_cast<std::size_t>(j)] * row[c];
        }
        values[i] = sum;
      }
    });
    for (std::size_t i = 0; i < orphans.size(); ++i) write(orphans[i], values[i]);
  }
}

}  // namespace envconv
