// SPDX-License-Identifier: Apache-2.0
#include "source_blocks.h"

#include <algorithm>

#include "assertion.h"
#include "texel_kernels.h"

namespace envconv {

namespace {

constexpr int abreast = 8;  // rows in prefilter_rows()

// Texels around a sample's that its window takes, and one more, for rounding.
constexpr int reach_of(Kernel kernel) { return taps(kernel) / 2 + 1; }

}  // namespace

SourceBlocks::SourceBlocks(const Source& source, Kernel kernel, std::size_t most)
    : source_(&source), kernel_(kernel), prefilter_(prefilter_of(kernel)), reach_(reach_of(kernel)), most_(most) {
  std::int32_t blocks = 0;
  for (const SourceFace& face : source.faces()) {
    const Grid grid{(face.size.width + side - 1) / side, (face.size.height + side - 1) / side, blocks};
    blocks += grid.across * grid.down;
    grids_.push_back(grid);
  }
  slot_of_.assign(static_cast<std::size_t>(blocks), -1);
  slots_.reserve(std::min<std::size_t>(most, slot_of_.size()));
}

std::size_t SourceBlocks::worth_keeping(const EnvImage& image, Kernel kernel, std::size_t memory) {
  std::size_t all = 0, across = 0;
  for (const Image& face : image.faces) {
    const auto columns = static_cast<std::size_t>((face.width() + side - 1) / side);
    all += columns * static_cast<std::size_t>((face.height() + side - 1) / side);
    across = std::max(across, columns);
  }
  const std::size_t fit = memory / bytes(kernel, image.channels.count() == 3 ? 3 : 4);
  return std::min(all, std::clamp<std::size_t>(across + across / 3, 8, std::max<std::size_t>(fit, 8)));
}

std::size_t SourceBlocks::bytes(Kernel kernel, int channels) {
  const int wide = side + 2 * reach_of(kernel), texels = wide * (wide + 2 * prefilter_of(kernel).margin);
  return static_cast<std::size_t>(texels * channels) * sizeof(float);
}

// A sample on the very edge may be nearest to a texel of the apron: the block inside is wide enough for it.
std::int32_t SourceBlocks::block_of(int face, int x, int y) const {
  const Grid& grid = grids_[static_cast<std::size_t>(face)];
  const int apron = source_->apron();
  const int column = std::clamp((x - apron) / side, 0, grid.across - 1);
  const int row = std::clamp((y - apron) / side, 0, grid.down - 1);
  return grid.first + row * grid.across + column;
}

SourceBlocks::Slot& SourceBlocks::slot_of(std::int32_t block) {
  std::int32_t& index = slot_of_[static_cast<std::size_t>(block)];
  if (index >= 0) return slots_[static_cast<std::size_t>(index)];
  std::size_t free = slots_.size();
  if (slots_.size() >= most_) {
    // The one that was not read for the longest time, if this tile can do without it.
    for (std::size_t i = 0; i < slots_.size(); ++i)
      if (slots_[i].tile < tile_ && (free == slots_.size() || slots_[i].tile < slots_[free].tile)) free = i;
  }
  if (free == slots_.size()) {
    slots_.emplace_back();
  } else if (slots_[free].block >= 0) {
    slot_of_[static_cast<std::size_t>(slots_[free].block)] = -1;
  }
  index = static_cast<std::int32_t>(free);
  make(block, slots_[free]);
  return slots_[free];
}

void SourceBlocks::make(std::int32_t block, Slot& slot) {
  int f = 0;
  while (static_cast<std::size_t>(f) + 1 < grids_.size() && grids_[static_cast<std::size_t>(f) + 1].first <= block) ++f;
  const Grid& grid = grids_[static_cast<std::size_t>(f)];
  const SourceFace& face = source_->faces()[static_cast<std::size_t>(f)];
  const int apron = source_->apron();
  const int column = (block - grid.first) % grid.across * side, row = (block - grid.first) / grid.across * side;
  slot.block = block;
  filter(f, column + apron - reach_, row + apron - reach_, std::min(side, face.size.width - column) + 2 * reach_,
         std::min(side, face.size.height - row) + 2 * reach_, slot);
}

// A rectangle of padded texels.
void SourceBlocks::filter(int f, int left, int top, int width, int height, Slot& slot) {
  const SourceFace& face = source_->faces()[static_cast<std::size_t>(f)];
  const int channels = source_->channels();
  const int wide = width + 2 * prefilter_.margin, high = height + 2 * prefilter_.margin;
  const int x = left - prefilter_.margin, y = top - prefilter_.margin;
  ENVCONV_ASSERT(x >= 0 && y >= 0 && x + wide <= face.columns && y + high <= face.rows);
  // Loads reach past a window, stores past a row.
  const std::size_t pitch = (static_cast<std::size_t>(width) * static_cast<std::size_t>(channels) + 31) / 16 * 16;
  const std::size_t floats = pitch * static_cast<std::size_t>(high + abreast);
  if (slot.texels.size() < floats) slot.texels.assign(floats, 0.0f);
  slot.pitch = static_cast<std::ptrdiff_t>(pitch);
  slot.x = left, slot.y = top;
  slot.first = prefilter_.margin * slot.pitch;
  const std::size_t row_floats = (static_cast<std::size_t>(wide) * static_cast<std::size_t>(channels) + 31) / 16 * 16;
  rows_.resize(std::max(rows_.size(), abreast * row_floats));
  work_.resize(std::max(work_.size(), static_cast<std::size_t>(wide) * 4 * abreast));
  for (int j = 0; j < high; j += abreast) {
    const float* in[abreast];
    float* out[abreast];
    for (int k = 0; k < abreast; ++k) {
      face.image->texels_touched();
      const int row_y = y + std::min(j + k, high - 1);
      in[k] = source_->row_in_place(f, x, row_y, wide);
      if (!in[k]) {
        float* to = rows_.data() + static_cast<std::size_t>(k) * row_floats;
        source_->copy_row(f, x, row_y, wide, to);
        in[k] = to;
      }
      out[k] = slot.texels.data() + static_cast<std::size_t>(j + k) * pitch;
    }
    // The next rows of the source, pages apart, come while these are filtered.
    for (int k = j + abreast; k < std::min(j + 2 * abreast, high); ++k)
      if (const float* next = source_->row_in_place(f, x, y + k, wide))
        for (int at = 0; at < wide * channels; at += 16) __builtin_prefetch(next + at, 0, 2);
    prefilter_rows(prefilter_, channels, wide, in, out, work_.data());
  }
  prefilter_columns(prefilter_, width * channels, high, slot.pitch, slot.texels.data());
}

void SourceBlocks::make_view() {
  const SourceView& view = *wanted_;
  // The windows of samples there, and a texel more: views are found at some of a tile's points only.
  const SourceFace& face = source_->faces()[static_cast<std::size_t>(view.face)];
  const auto bounded = [&](double at, int texels) {
    return std::clamp(static_cast<int>(std::clamp(std::floor(at), -1e6, 1e8)) + source_->apron(), prefilter_.margin,
                      texels - prefilter_.margin);
  };
  const int left = bounded(view.left - reach_, face.columns), right = bounded(view.right + reach_ + 1, face.columns);
  const int top = bounded(view.top - reach_, face.rows), bottom = bounded(view.bottom + reach_ + 1, face.rows);
  const auto texels = [&](int from, int to) { return static_cast<std::int64_t>(to) - from + 2 * prefilter_.margin; };
  if (right > left && bottom > top && texels(left, right) * texels(top, bottom) <= largest_view) {
    view_.block = view.face;
    view_width_ = right - left, view_height_ = bottom - top;
    filter(view.face, left, top, view_width_, view_height_, view_);
  }
  wanted_.reset();
}

void SourceBlocks::make_all() {
  most_ = slot_of_.size();
  for (std::size_t block = 0; block < slot_of_.size(); ++block) slot_of(static_cast<std::int32_t>(block));
}

// Neighbouring samples mostly lie in one block: `find` is asked only when one does not.
template <class Find>
void SourceBlocks::point_at(int n, const float* face, Windows& windows, const Find& find) const {
  const int channels = source_->channels(), apron = source_->apron(), before = taps_before(kernel_);
  // The samples whose nearest texels are [left, right) x [top, bottom) of a slot's.
  const auto field_of = [&](const Slot& slot, int left, int top, int right, int bottom) {
    return WindowField{slot.x + left,
                       slot.y + top,
                       slot.x + right,
                       slot.y + bottom,
                       slot.texels.data() + slot.first - (slot.y + before) * slot.pitch - (slot.x + before) * channels,
                       slot.pitch};
  };
  WindowField view{};
  if (view_.block >= 0) view = field_of(view_, before, before, view_width_ - before, view_height_ - before);
  const auto in_view = [&](int i) {
    return static_cast<float>(view_.block) == face[i] && windows.x[i] >= view.left && windows.x[i] < view.right &&
           windows.y[i] >= view.top && windows.y[i] < view.bottom;
  };
  for (int i = 0; i < n;) {
    if (in_view(i)) {
      i = point_windows(view, channels, face, i, n, windows);
      continue;
    }
    const Slot& slot = find(block_of(static_cast<int>(face[i]), windows.x[i], windows.y[i]));
    WindowField field = field_of(slot, reach_, reach_, reach_ + side, reach_ + side);
    // A sample on the very edge may be nearest to a texel of the apron.
    const SourceFace& f = source_->faces()[static_cast<std::size_t>(face[i])];
    if (field.right >= apron + f.size.width) field.right = apron + f.size.width + 1;
    if (field.bottom >= apron + f.size.height) field.bottom = apron + f.size.height + 1;
    if (field.left == apron) --field.left;
    if (field.top == apron) --field.top;
    i = point_windows(field, channels, face, i, n, windows);
  }
}

void SourceBlocks::point(int n, const float* face, Windows& windows) {
  if (wanted_) make_view();
  point_at(n, face, windows, [&](std::int32_t block) -> const Slot& {
    Slot& slot = slot_of(block);
    slot.tile = tile_;
    return slot;
  });
}

void SourceBlocks::point(int n, const float* face, Windows& windows) const {
  point_at(n, face, windows, [&](std::int32_t block) -> const Slot& {
    return slots_[static_cast<std::size_t>(slot_of_[static_cast<std::size_t>(block)])];
  });
}

}  // namespace envconv
