// SPDX-License-Identifier: Apache-2.0
// Pixels: Image, a rectangle of floats; EnvImage, an environment that knows its layout, placement and frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "assertion.h"
#include "geometry.h"
#include "layout.h"
#include "result.h"

namespace envconv {

class MappedMemory;
class Scratch;

/// A rectangle of float pixels, channels interleaved, rows contiguous, top row first: [height][width][channels].
/// Movable, not copyable by accident (see clone()).  New pixels are uninitialised.  Pixels live in memory, or where a
/// Scratch is given in its files.  Constructors throw std::bad_alloc.
class Image {
 public:
  Image() = default;
  Image(int width, int height, int channels, std::shared_ptr<Scratch> scratch = nullptr);
  /// A size and no pixels: empty() is true.
  static Image without_pixels(int width, int height, int channels) {
    Image image;
    image.width_ = width;
    image.height_ = height;
    image.channels_ = channels;
    return image;
  }
  /// The pixels that begin at a mapping, which is undone with the image.  There are `room` bytes of zeros behind them,
  /// so that kernels may load whole vectors at the end.
  static Image adopt(int width, int height, int channels, MappedMemory&& mapping);
  static constexpr std::size_t room = 2 * 64;
  Image(Image&&) noexcept = default;
  Image& operator=(Image&&) noexcept = default;

  int width() const { return width_; }
  int height() const { return height_; }
  int channels() const { return channels_; }
  bool empty() const { return !pixels_; }
  std::size_t pixel_count() const { return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_); }
  std::size_t value_count() const { return pixel_count() * static_cast<std::size_t>(channels_); }

  float* row(int y) { return relieved() + row_start(y); }
  const float* row(int y) const { return relieved() + row_start(y); }
  float* at(int x, int y) { return pixels_.get() + row_start(y) + column_start(x); }
  const float* at(int x, int y) const { return pixels_.get() + row_start(y) + column_start(x); }
  float* data() { return pixels_.get(); }
  const float* data() const { return pixels_.get(); }

  void fill(float value);
  Image clone() const;  ///< lives where this one does

  /// A new image that lives where this one does.
  Image sibling(int width, int height, int channels) const { return {width, height, channels, scratch_}; }
  /// nullptr for images in memory.
  const std::shared_ptr<Scratch>& scratch() const { return scratch_; }
  /// Scratch::relieve(), where that is what this image lives in: for loops over many texels that do not ask for rows,
  /// since row() does it.
  void relieve() const;
  /// The same once in a while, for loops that read some texels here and there: each time the system may map as many
  /// pages as it does about one that is read.
  void texels_touched() const;
  static constexpr std::size_t mapped_about_a_texel = std::size_t{64} << 10;  ///< bytes, on Linux
  /// What the rows above `y` hold is not needed any more: a large image gives their memory back to the system.
  void forget_rows_above(int y);

 private:
  std::size_t row_start(int y) const {
    ENVCONV_ASSERT(!empty() && y >= 0 && y < height_);
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) * static_cast<std::size_t>(channels_);
  }
  float* relieved() const {
    if (pixels_.get_deleter().scratch) row_touched();
    return pixels_.get();
  }
  void row_touched() const;
  std::size_t column_start(int x) const {
    ENVCONV_ASSERT(x >= 0 && x < width_);
    return static_cast<std::size_t>(x) * static_cast<std::size_t>(channels_);
  }
  struct Free {
    Free() {}
    std::size_t mapped = 0;            // bytes of a mapping, or 0
    std::shared_ptr<Scratch> scratch;  // that the pixels are from, or nullptr
    void operator()(float* p) const;
  };
  int width_ = 0, height_ = 0, channels_ = 0;
  std::shared_ptr<Scratch> scratch_;       // for this image or, when it is small, for what is made from it
  std::unique_ptr<float[], Free> pixels_;  // aligned to 64 bytes
};

/// What channels mean.  Radiance is linear, colour associated with (multiplied by) alpha.
struct Channels {
  std::vector<std::string> names;  ///< "R", "G", "B", "A" or "Y" ...; as many as the image has channels
  int alpha = -1;                  ///< index of the alpha channel, or -1

  int count() const { return static_cast<int>(names.size()); }
  /// Y, YA, RGB or RGBA for 1 to 4 channels.
  static Channels standard(int count);
  friend bool operator==(const Channels&, const Channels&) = default;
};

/// An environment: one linear float image per face of a layout.
struct EnvImage {
  const Layout* layout = nullptr;  ///< registered, never owned
  Placement placement = Placement::centre;
  Mat3 consumer_from_world;  ///< the frame the faces were written for, beside the one the layout's name implies
  Channels channels;
  std::vector<Image> faces;  ///< in the layout's order; all with channels.count() channels

  int height() const { return faces.empty() ? 0 : faces.front().height(); }
  std::size_t texel_count() const;
};

/// Width and height in texels.
struct Size {
  int width = 0, height = 0;
  friend bool operator==(const Size&, const Size&) = default;
};

/// Size of a face when face 0 is `height` texels high: texels square in the face's metric and alike at the faces'
/// centres, rounded up (layout contract).  height >= 1.
Size face_size(const Layout& layout, int face, int height);

/// Texels of all faces together.
std::int64_t texel_count(const Layout& layout, int height);

/// World direction of face points to the layout's own axes: frame and implied frame together.
Mat3 layout_from_world(const EnvImage& image);
Mat3 layout_from_world(const Layout& layout, const Mat3& consumer_from_world);

/// Solid angle, in steradians, of the part of a texel that the layout owns.  The texels of all faces add up to 4 pi.
/// `size` is the face's; relative accuracy about 1e-6 away from seams, and where a seam crosses the texel 1/1000 of it.
double texel_solid_angle(const Layout& layout, int face, int i, int j, Size size, Placement placement);

/// Mean radiance over the sphere of each channel: texels weighted by texel_solid_angle.  [channels]
std::vector<double> mean_radiance(const EnvImage& image);

}  // namespace envconv
