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

// The modified Bessel function of the first kind, order 0, to rounding for |x| <= 8: its power series.
double bessel_i0(double x) {
  const double q = 0.25 * x * x;
  double sum = 1, term = 1;
  for (int k = 1; k < 28; ++k) term *= q / (k * k), sum += term;
  return sum;
}

// Interpolating kernel for texels read from across seams: sinc under a Kaiser window (beta 7.5), eight taps.
constexpr int adopt_taps = 8;
std::array<float, adopt_taps> adopt_weights(double f) {
  std::array<double, adopt_taps> w;
  double sum = 0;
  const double sine = std::sin(M_PI * f);  // of pi t, but for the sign
  for (int k = 0; k < adopt_taps; ++k) {
    const double t = k - (adopt_taps / 2 - 1) - f;
    const double r = t / (adopt_taps / 2);
    double value = 0;
    if (std::abs(r) < 1)
      value = bessel_i0(7.5 * std::sqrt(1 - r * r)) * (t == 0 ? 1.0 : (k % 2 ? -sine : sine) / (M_PI * t));
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
    for (std::size_t i = 0; i <= 512; ++i) {
      const auto row = adopt_weights(static_cast<double>(i) / 1024);
      std::reverse_copy(row.begin(), row.end(), rows[1024 - i].begin());
      rows[i] = row;
    }
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
    split_highlights(image);
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
  highlights_.touched.assign(static_cast<std::size_t>(blocks), 0);
  highlights_.mask_index.assign(static_cast<std::size_t>(blocks), -1);
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
    s.image = &face;
    if (in_place) {
      s.pixels = face.data();
      continue;
    }
    Image copy = face.sibling(s.size.width, s.size.height, channels_);
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

// The image's mean, and every row's range by face, from one walk through its memory.
std::vector<std::vector<Source::RowRange>> Source::survey(const EnvImage& image) {
  std::vector<std::vector<RowRange>> rows;
  for (const SourceFace& s : faces_) {
    RowRange none;
    none.low.fill(std::numeric_limits<float>::max());
    none.brightest = 0;
    rows.emplace_back(static_cast<std::size_t>(s.size.height), none);
  }
  mean_ = sphere_mean(image, [&](int f, int x0, int y0, int width, int height) {
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    if (x0 == 0) s.image->relieve();  // once for some rows
    for (int y = y0; y < y0 + height; ++y) {
      float low[4], high[4];
      value_range(channels_, width, s.pixels + y * s.pitch + x0 * channels_, low, high);
      RowRange& range = rows[static_cast<std::size_t>(f)][static_cast<std::size_t>(y)];
      for (int c = 0; c < channels_; ++c) {
        float& to = range.low[static_cast<std::size_t>(c)];
        to = std::min(to, low[c]);
        if (c < 3) range.brightest = std::max({range.brightest, high[c], -low[c]});
      }
    }
  });
  return rows;
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
  // Pieces are searched in parallel, and their finds joined in order.
  constexpr int length = 256;
  struct Piece {
    int x, y, width, height;
  };
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    std::vector<Piece> pieces;
    const auto cut = [&](int x, int y, int width, int height) {
      for (int j = 0; j < height; j += length)
        for (int i = 0; i < width; i += length)
          pieces.push_back({x + i, y + j, std::min(length, width - i), std::min(length, height - j)});
    };
    if (layout_->info().domain == Domain::square) {
      cut(0, 0, s.columns, apron_);
      cut(0, apron_, apron_, s.size.height);
      cut(apron_ + s.size.width, apron_, apron_, s.size.height);
      cut(0, apron_ + s.size.height, s.columns, apron_);
    } else {
      cut(0, 0, s.columns, s.rows);
    }
    std::vector<std::vector<Orphan>> found(pieces.size());
    tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
      const Piece& p = pieces[i];
      find_orphans_in(static_cast<int>(f), p.x, p.y, p.width, p.height, found[i]);
    });
    for (const auto& some : found) orphans.insert(orphans.end(), some.begin(), some.end());
  }
}

Source::Orphan Source::orphan_at(int face, int x, int y) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const Location at = layout_->locate(layout_->direction(face, u_from_texel(x - apron_, s.size.width, placement_),
                                                         u_from_texel(y - apron_, s.size.height, placement_)));
  const SourceFace& o = faces_[static_cast<std::size_t>(at.face)];
  Orphan orphan{face,
                x,
                y,
                at.face,
                texel_from_u(at.u, o.size.width, placement_) + apron_,
                texel_from_u(at.v, o.size.height, placement_) + apron_};
  const double nearest_x = std::round(orphan.from_x), nearest_y = std::round(orphan.from_y);
  orphan.exact = std::abs(orphan.from_x - nearest_x) < on_texel && std::abs(orphan.from_y - nearest_y) < on_texel;
  return orphan;
}

// Many seams join texel to texel (latlong's all do): where a rectangle's corners and its middle are texels of one face
// at the distances that they have here, all in between are, and need no formula.
void Source::find_orphans_in(int face, int x, int y, int width, int height, std::vector<Orphan>& orphans) const {
  constexpr int small = 8;
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const bool whole = layout_->info().domain == Domain::square;
  if (width <= small && height <= small) {
    for (int j = y; j < y + height; ++j)
      for (int i = x; i < x + width; ++i) {
        if (!whole && in_face(s, i, j) &&
            layout_->owns(face, u_from_texel(i - apron_, s.size.width, placement_),
                          u_from_texel(j - apron_, s.size.height, placement_)))
          continue;
        orphans.push_back(orphan_at(face, i, j));
      }
    return;
  }
  if (whole) {
    const Orphan first = orphan_at(face, x, y);
    const auto rounded = [](double a, double b) { return static_cast<int>(std::lround(a - b)); };
    if (first.exact) {
      const Orphan right = orphan_at(face, x + width - 1, y), below = orphan_at(face, x, y + height - 1);
      // Steps along the owner's axes for a step right, and for a step down.
      const int wide = std::max(width - 1, 1), high = std::max(height - 1, 1);
      const int right_x = rounded(right.from_x, first.from_x) / wide,
                right_y = rounded(right.from_y, first.from_y) / wide;
      const int down_x = rounded(below.from_x, first.from_x) / high,
                down_y = rounded(below.from_y, first.from_y) / high;
      const auto agrees = [&](const Orphan& o) {
        const int i = o.x - x, j = o.y - y;
        return o.exact && o.from_face == first.from_face &&
               rounded(o.from_x, first.from_x) == i * right_x + j * down_x &&
               rounded(o.from_y, first.from_y) == i * right_y + j * down_y;
      };
      if (agrees(right) && agrees(below) && agrees(orphan_at(face, x + width - 1, y + height - 1)) &&
          agrees(orphan_at(face, x + width / 2, y + height / 2)) &&
          agrees(orphan_at(face, x + width / 3, y + height / 4))) {
        for (int j = 0; j < height; ++j)
          for (int i = 0; i < width; ++i)
            orphans.push_back({face, x + i, y + j, first.from_face, first.from_x + i * right_x + j * down_x,
                               first.from_y + i * right_y + j * down_y, true});
        return;
      }
    }
  }
  const int left = width > height ? width / 2 : width, top = width > height ? height : height / 2;
  find_orphans_in(face, x, y, left, top, orphans);
  if (left < width)
    find_orphans_in(face, x + left, y, width - left, height, orphans);
  else
    find_orphans_in(face, x, y + top, width, height - top, orphans);
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
        if (pass == 0) values[i] = nearest_owned(o);
        if (pass == 0 || o.exact) continue;
        const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
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
    for (std::size_t i = 0; i < orphans.size(); ++i)
      if (pass == 0 || !orphans[i].exact) write(orphans[i], values[i]);
    if (std::ranges::all_of(orphans, &Orphan::exact)) break;
  }
}

}  // namespace envconv
