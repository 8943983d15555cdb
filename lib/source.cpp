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
#include "texel_kernels.h"

namespace envconv {

int apron_width(Kernel kernel) {
  const int reach = taps(kernel) / 2 + 1;
  return is_prefiltered(kernel) ? prefilter_of(kernel).margin + reach : std::max(reach, 4);
}

Source::Source(const EnvImage& image, EnvImage* writable, int first_channel, const Filter& filter)
    : layout_(image.layout), placement_(image.placement) {
  ENVCONV_ASSERT(image.faces.size() == layout_->info().faces.size() && first_channel < image.channels.count());
  ENVCONV_ASSERT(faces_.size() <= most_faces);
  apron_ = apron_width(filter.kernel);
  place_faces(image);
  hold_pixels(image, writable, first_channel);
  if (filter.limited) {
    split_highlights(image);
    if (highlights_.any()) spread_highlights();
  }
  make_strips();
  const Orphans orphans = find_orphans();
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

// Three or four channels are read where they are, unless the layout has texels to be adopted inside its faces and these
// may not be written to.
void Source::hold_pixels(const EnvImage& image, EnvImage* writable, int first_channel) {
  const int stored = image.channels.count(), count = std::min(4, stored - first_channel);
  channels_ = count == 3 ? 3 : 4;
  const bool adopts = layout_->info().domain != Domain::square;
  const bool in_place = stored == channels_ && (writable || !adopts);
  copies_.reserve(faces_.size());
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    SourceFace& s = faces_[f];
    s.pitch = static_cast<std::ptrdiff_t>(s.size.width) * channels_;
    const Image& face = image.faces[f];
    s.image = &face;
    if (in_place) {
      s.pixels = face.data();
      if (adopts) writable_.push_back(&writable->faces[f]);
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
    if (adopts) writable_.push_back(&copies_.back());
  }
}

// The image's mean, and ranges of rectangles of texels, from one walk through its memory.
std::vector<Source::RectangleRange> Source::survey(const EnvImage& image) {
  constexpr int side = visit_side;
  std::vector<RectangleRange> ranges;
  std::vector<std::size_t> first;  // of a face's
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    first.push_back(ranges.size());
    const Size size = faces_[f].size;
    for (int y = 0; y < size.height; y += side)
      for (int x = 0; x < size.width; x += side)
        ranges.push_back({static_cast<int>(f), x, y, std::min(side, size.width - x), std::min(side, size.height - y)});
  }
  mean_ = sphere_mean(image, [&](int f, int x, int y, int width, int height) {
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    if (x == 0) s.image->relieve();  // once for some rows
    const auto number = static_cast<std::size_t>(y / side * ((s.size.width + side - 1) / side) + x / side);
    RectangleRange& range = ranges[first[static_cast<std::size_t>(f)] + number];
    float high[4];
    value_range(channels_, width, height, s.pixels + y * s.pitch + x * channels_, s.pitch, range.low.data(), high);
    for (std::size_t c = 0; c < 3; ++c) range.brightest = std::max({range.brightest, high[c], -range.low[c]});
  });
  return ranges;
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
        s.image->texels_touched();
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
      if (block->split.holds(k)) std::copy_n(block->find(k)->base, 3, out + (i - x) * channels_);
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

Source::Rectangle Source::rectangle(int face, int x, int y, int width, int height, float* copy) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  if (!highlights_.any()) {
    if (in_face(s, x, y) && in_face(s, x + width - 1, y + height - 1)) return {pixel(s, x, y), s.pitch};
    for (const Strip& strip : strips_[static_cast<std::size_t>(face)])
      if (strip.holds(x, y) && strip.holds(x + width - 1, y + height - 1))
        return {strip.pixels.at(x - strip.x, y - strip.y),
                static_cast<std::ptrdiff_t>(strip.pixels.width()) * channels_};
  }
  const std::ptrdiff_t pitch = static_cast<std::ptrdiff_t>(width) * channels_;
  for (int j = 0; j < height; ++j) copy_row(face, x, y + j, width, copy + j * pitch);
  return {copy, pitch};
}

}  // namespace envconv
