// SPDX-License-Identifier: Apache-2.0
#include "image.h"

#include <sys/mman.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <utility>

#include "assertion.h"
#include "mapped_memory.h"
#include "scratch.h"
#include "solid_angle.h"

namespace envconv {

namespace {
// Large images lie on huge pages: random reads of a panorama otherwise miss the address translation cache.
constexpr std::size_t huge_page = std::size_t{2} << 20, large_bytes = 4 * huge_page;
}  // namespace

void Image::Free::operator()(float* p) const {
  if (scratch) {
    scratch->release(p);
  } else if (mapped > 0) {
    ::munmap(p, mapped);
  } else {
    std::free(p);
  }
}

Image Image::adopt(int width, int height, int channels, MappedMemory&& mapping) {
  Image image = without_pixels(width, height, channels);
  ENVCONV_ASSERT(mapping.size() >= image.value_count() * sizeof(float) + room);
  image.pixels_.get_deleter().mapped = mapping.size();
  image.pixels_.reset(static_cast<float*>(mapping.release()));
  return image;
}

Image::Image(int width, int height, int channels, std::shared_ptr<Scratch> scratch)
    : width_(width), height_(height), channels_(channels), scratch_(std::move(scratch)) {
  ENVCONV_ASSERT(width >= 0 && height >= 0 && channels >= 0);
  // One vector more than the pixels, so that kernels may load whole vectors at the end.
  const std::size_t bytes = (value_count() * sizeof(float) + room - 1) / 64 * 64;
  if (scratch_ && bytes >= Scratch::least_bytes) {
    pixels_.reset(static_cast<float*>(scratch_->allocate(bytes)));
    pixels_.get_deleter().scratch = scratch_;
    return;
  }
  const bool large = bytes >= large_bytes;
  const std::size_t alignment = large ? huge_page : 64;
  pixels_.reset(static_cast<float*>(std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment)));
  if (!pixels_) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
  if (large) madvise(pixels_.get(), bytes, MADV_HUGEPAGE);
#endif
  // What such loads find there must be numbers.
  std::fill(pixels_.get() + value_count(), pixels_.get() + bytes / sizeof(float), 0.0f);
}

void Image::relieve() const {
  if (scratch_) scratch_->relieve();
}

void Image::texels_touched() const {
  if (scratch_) scratch_->touched(mapped_about_a_texel);
}

void Image::row_touched() const {
  scratch_->touched(static_cast<std::size_t>(width_) * static_cast<std::size_t>(channels_) * sizeof(float));
}

void Image::forget_rows_above(int y) {
  ENVCONV_ASSERT(!empty() && y >= 0 && y <= height_);
  const std::size_t row_bytes = static_cast<std::size_t>(width_) * static_cast<std::size_t>(channels_) * sizeof(float);
  // Whole huge pages: a part of one would stay.
  const std::size_t bytes = static_cast<std::size_t>(y) * row_bytes / huge_page * huge_page;
  if (bytes == 0 || value_count() * sizeof(float) < large_bytes) return;
  forget_pages(pixels_.get(), bytes);
}

void Image::fill(float value) { std::fill_n(data(), value_count(), value); }

Image Image::clone() const {
  Image copy = sibling(width_, height_, channels_);
  std::memcpy(copy.data(), data(), value_count() * sizeof(float));
  return copy;
}

Channels Channels::standard(int count) {
  switch (count) {
    case 1: return {{"Y"}, -1};
    case 2: return {{"Y", "A"}, 1};
    case 3: return {{"R", "G", "B"}, -1};
    case 4: return {{"R", "G", "B", "A"}, 3};
    default: break;
  }
  Channels channels;
  for (int i = 0; i < count; ++i) channels.names.push_back("channel" + std::to_string(i));
  return channels;
}

std::size_t EnvImage::texel_count() const {
  std::size_t n = 0;
  for (const Image& face : faces) n += face.pixel_count();
  return n;
}

Size face_size(const Layout& layout, int face, int height) {
  ENVCONV_ASSERT(face >= 0 && face < layout.face_count() && height >= 1);
  const Face& f = layout.info().faces[static_cast<std::size_t>(face)];
  // Rounded up, but not by the last bits of a product that is whole in truth.
  constexpr double most = std::numeric_limits<int>::max();
  const auto up = [most](double x) { return static_cast<int>(std::clamp(std::ceil(x - 1e-7), 1.0, most)); };
  const double h = f.scale * height;
  return {up(f.aspect * h), up(h)};
}

std::int64_t texel_count(const Layout& layout, int height) {
  std::int64_t n = 0;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size s = face_size(layout, f, height);
    n += static_cast<std::int64_t>(s.width) * s.height;
  }
  return n;
}

Mat3 layout_from_world(const Layout& layout, const Mat3& consumer_from_world) {
  const Frame* implied = find_frame(layout.info().frame);
  return implied ? implied->consumer_from_world * consumer_from_world : consumer_from_world;
}

Mat3 layout_from_world(const EnvImage& image) { return layout_from_world(*image.layout, image.consumer_from_world); }

double texel_solid_angle(const Layout& layout, int face, int i, int j, Size size, Placement placement) {
  double value;
  texel_solid_angles(layout, face, size, placement, i, j, 1, 1, &value);
  return value;
}

}  // namespace envconv
