// SPDX-License-Identifier: Apache-2.0
// An environment made ready for reading at any direction, without a copy of it where none is needed.
//
// Places in a face are counted in padded texels: (apron, apron) is the face's first texel, and `apron` texels lie
// beyond every side.  What stands there, and in a face's texels that the layout does not own, is read from across the
// seams on the sphere: the texel's own direction (the layout's formula goes on beyond its faces), looked up where that
// direction is owned.  No table of neighbours exists.  The aprons and a few texels inside of them are kept as strips,
// so that any window of taps lies wholly in the face's pixels or in one strip.
//
// Highlights.  A kernel with negative lobes rings around a sun.  For filters that ask for it (Filter::limited), each
// texel above a threshold T, a few times the mean, is split into a base that its neighbourhood suggests and the excess
// over that: the first goes through the kernel, the second is read bilinearly, which cannot ring, and is scaled so that
// the energy that arrives in the output is exactly the excess's radiance times its texel's solid angle (see
// resample.cpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "assertion.h"
#include "filter.h"
#include "image.h"
#include "layout.h"
#include "solid_angle.h"
#include "window_kernels.h"

namespace envconv {

/// A face of a source.
struct SourceFace {
  Size size;                                               ///< the face's own, without apron
  const Image* image = nullptr;                            ///< to be asked to relieve() itself
  const float* pixels = nullptr;                           ///< the face's first texel; the image's, or an own copy's
  std::ptrdiff_t pitch = 0;                                ///< floats from row to row
  int columns = 0, rows = 0;                               ///< padded texels
  float scale_u = 0, bias_u = 0, scale_v = 0, bias_v = 0;  ///< (u, v) to padded texels
  int blocks = 0;                                          ///< of the highlight map in a row
  std::int32_t first_block = 0;
};

/// A rectangle of padded texels around a face's edge.
struct Strip {
  int x = 0, y = 0;
  Image pixels;
  bool holds(int column, int row) const {
    return column >= x && column < x + pixels.width() && row >= y && row < y + pixels.height();
  }
};

/// Texels of apron on every side that reading with a kernel needs.
int apron_width(Kernel kernel);

/// A set of a block's texels; see Highlights::place().
struct BlockTexels {
  static constexpr int side = 16;  ///< of a block, in padded texels
  std::uint16_t rows[side]{};      ///< bit x of row y
  bool holds(int place) const { return (rows[place / side] >> (place % side) & 1) != 0; }
  void add(int place) { rows[place / side] |= static_cast<std::uint16_t>(1u << (place % side)); }
};

/// The excess of highlights over the threshold, by texel; in blocks, most of which are absent.  Of a texel in eight, at
/// most (and a few about poles), so that they take some bytes a texel of the image even where lamps are everywhere.
struct Highlights {
  static constexpr int side = BlockTexels::side;
  static constexpr double received_unit = 0x1p-50;  ///< of Texel::received, in steradians
  /// A texel of the image, to be reckoned with; up to 6 where lamps are everywhere (4 of Texel, 2 of Block and arrays).
  static constexpr std::size_t usual_bytes = 1;
  struct Texel {
    std::uint64_t received = 0;  ///< solid angle that outputs gave to the texel, in units of 2^-50 sr
    float excess[3]{};           ///< alpha has none
    float base[3]{};             ///< of a split texel: what is left of it
    bool lit() const { return excess[0] != 0 || excess[1] != 0 || excess[2] != 0; }
  };
  class Block {
   public:
    BlockTexels split;    ///< where base is the texel's
    BlockTexels repeats;  ///< where the excess is a copy of its owners', and no energy of its own
    /// The texel at a place, or nullptr.
    Texel* find(int place) { return here_.holds(place) ? &texels_[number_[place]] : nullptr; }
    const Texel* find(int place) const { return here_.holds(place) ? &texels_[number_[place]] : nullptr; }
    /// The texel at a place, without an excess when it is new.  Moves others.
    Texel& add(int place);
    /// Gives back what was reserved for more.
    void shrink() { texels_.shrink_to_fit(); }

   private:
    BlockTexels here_;
    std::uint8_t number_[side * side];  // in texels_, of those that are here
    std::vector<Texel> texels_;
  };
  std::vector<std::int32_t> index;  ///< [first_block + by * blocks + bx]: block number, or -1
  /// The same: 1 where a window of any kernel about a texel of the block may hold an excess.
  std::vector<std::uint8_t> touched;
  /// The same: number of the block's mask, or -1 where no bilinear read meets an excess.
  std::vector<std::int32_t> mask_index;
  /// Of blocks: the texels at which a bilinear read meets one.
  std::vector<BlockTexels> masks;
  std::vector<Block> blocks;
  /// A texel outside its owner's face that repeats owners' excess: where from.
  struct Copy {
    std::int32_t face, x, y;  ///< padded
    std::int32_t from_face, from_x[4], from_y[4];
    float weight[4];
  };
  std::vector<Copy> copies;
  /// A highlight on a texel so thin that ordinary sampling might miss it: where, and the texel's sides in radians.
  struct Sliver {
    Vec3 direction;
    double thin, wide;
  };
  std::vector<Sliver> slivers;
  bool any() const { return !blocks.empty(); }
  /// Index in its block of a padded texel.
  static constexpr int place(int x, int y) { return y % side * side + x % side; }
  /// The block of a padded texel, or nullptr.
  const Block* block_at(const SourceFace& face, int x, int y) const {
    const std::int32_t i = index[block_number(face, x, y)];
    return i < 0 ? nullptr : &blocks[static_cast<std::size_t>(i)];
  }
  /// Of all the arrays by block: the one of padded texel (x, y).
  static std::size_t block_number(const SourceFace& face, int x, int y) {
    ENVCONV_ASSERT(x >= 0 && x < face.columns && y >= 0 && y < face.rows);
    return static_cast<std::size_t>(face.first_block + y / side * face.blocks + x / side);
  }
  /// The mask of the block of padded texel (x, y), or nullptr.
  const BlockTexels* mask_at(const SourceFace& face, int x, int y) const {
    const std::int32_t i = mask_index[block_number(face, x, y)];
    return i < 0 ? nullptr : &masks[static_cast<std::size_t>(i)];
  }
  /// True when a bilinear read at padded texel (x, y) meets a highlight.
  bool reach(const SourceFace& face, int x, int y) const {
    const BlockTexels* mask = mask_at(face, x, y);
    return mask && mask->holds(place(x, y));
  }
  /// True when a window of any kernel about it may.
  bool touch(const SourceFace& face, int x, int y) const { return touched[block_number(face, x, y)] != 0; }
};

/// The radiance times solid angle of a highlight that fell between samples, and where it is (layout's axes).
struct StrandedEnergy {
  Vec3 direction;
  double energy[4];
};

/// The texels that a bilinear read takes, right of and below padded texel (x, y); absent ones are nullptr.  Samples in
/// a row mostly share them.
template <class Texel>
struct HighlightQuad {
  float face = -1;
  int x = 0, y = 0;
  Texel* texel[4] = {};

  bool is_at(float f, const Place& p) const { return f == face && p.x == x && p.y == y; }
  template <class AnyHighlights>
  void move(AnyHighlights& highlights, const SourceFace& source_face, float f, const Place& p) {
    face = f, x = p.x, y = p.y;
    for (int k = 0; k < 4; ++k) {
      const int xx = x + (k & 1), yy = y + (k >> 1);
      const std::int32_t index = highlights.index[Highlights::block_number(source_face, xx, yy)];
      texel[k] =
          index < 0 ? nullptr : highlights.blocks[static_cast<std::size_t>(index)].find(Highlights::place(xx, yy));
    }
  }
  static float weight(int k, const Place& p) { return (k & 1 ? p.fx : 1 - p.fx) * (k >> 1 ? p.fy : 1 - p.fy); }
};

/// Up to four channels of an environment, ready for reading.
class Source {
 public:
  /// Channels [first_channel, first_channel + 4) of the image, whose pixels must outlive the source.
  /// writable: the image, when its texels that no face owns may be overwritten instead of copied with all others, or
  /// nullptr.
  Source(const EnvImage& image, EnvImage* writable, int first_channel, const Filter& filter);

  const Layout& layout() const { return *layout_; }
  const std::vector<SourceFace>& faces() const { return faces_; }
  int channels() const { return channels_; }  ///< floats a texel: 3, or 4 (absent ones are 0)
  int apron() const { return apron_; }
  const FaceMaps& maps() const { return maps_; }
  Placement placement() const { return placement_; }
  /// Means over the sphere of all of the image's channels; for limited filters only.
  const SphereMean& mean() const { return mean_; }
  /// Lowest value of each channel in the image: what a reconstruction must not undercut when it is positive.
  const float* lowest() const { return lowest_; }
  Highlights& highlights() { return highlights_; }
  const Highlights& highlights() const { return highlights_; }

  /// Points windows.first and .pitch at a face's pixels, or at a strip, for windows of the kernel's taps.
  void point(Kernel kernel, int n, const float* face, Windows& windows) const;

  /// Copies `count` padded texels of a row, channels() floats each, highlights replaced by their bases.
  void copy_row(int face, int x, int y, int count, float* out) const;

  /// The same texels where they are, when they lie in one piece and none is a highlight; else nullptr.
  const float* row_in_place(int face, int x, int y, int count) const;

  /// value[4] += the excess read bilinearly at fractions (fx, fy) right of and below padded texel (x, y).
  void add_highlights(int face, int x, int y, float fx, float fy, float* value) const;

  /// Scales every highlight so that what it gave to the output equals its own energy.  Called once, after all outputs'
  /// shares were added to Highlights::Texel::received.  Returns the energy of those that no sample met.
  std::vector<StrandedEnergy> conserve_highlights();

 private:
  // A padded texel that its face does not own, and the place of its direction where it is owned, in padded texels.
  struct Orphan {
    std::int32_t face, x, y;
    std::int32_t from_face;
    double from_x, from_y;
    bool exact = false;  // from a texel's very centre
  };
  // A rectangle of orphans that are texels of one face, side by side there too: a step right, and one down, is a step
  // there.
  struct ExactPatch {
    std::int32_t face, x, y, width, height;
    std::int32_t from_face, from_x, from_y;
    std::int32_t right_x, right_y, down_x, down_y;
    Orphan at(int i, int j) const;
  };
  // A rectangle of orphans whose places in one face are polynomials of theirs: c[n][m] of t^n s^m, where s and t run
  // from -1 to 1 along the rectangle.
  struct SmoothPatch {
    std::int32_t face, x, y, width, height;
    std::int32_t from_face;
    double from_x[4][4], from_y[4][4];
    void row(int j, Orphan* out) const;  // of `width` orphans
  };
  // A rectangle of orphans so far from what their face owns that nothing ever reads them.
  struct UnreadPatch {
    std::int32_t face, x, y, width, height;
  };
  struct Orphans {
    std::vector<UnreadPatch> unread;  // not visited by for_each()
    std::vector<ExactPatch> exact;
    std::vector<SmoothPatch> smooth;
    std::vector<Orphan> others;
    template <class Visit>
    void for_each(const Visit& visit) const {
      for (const ExactPatch& patch : exact)
        for (int j = 0; j < patch.height; ++j)
          for (int i = 0; i < patch.width; ++i) visit(patch.at(i, j));
      std::vector<Orphan> row;
      for (const SmoothPatch& patch : smooth) {
        row.resize(static_cast<std::size_t>(patch.width));
        for (int j = 0; j < patch.height; ++j) {
          patch.row(j, row.data());
          for (const Orphan& orphan : row) visit(orphan);
        }
      }
      for (const Orphan& orphan : others) visit(orphan);
    }
  };
  class Ownership;
  using Texel = std::array<float, 4>;
  void place_faces(const EnvImage& image);
  void hold_pixels(const EnvImage& image, EnvImage* writable, int first_channel);
  // Of a rectangle of a face's texels: the lowest value of each channel, and the largest magnitude of the first three.
  struct RectangleRange {
    int face, x, y, width, height;
    Texel low{};
    float brightest = 0;
  };
  std::vector<RectangleRange> survey(const EnvImage& image);
  void make_strips();
  void split_highlights(const EnvImage& image);
  void spread_highlights();
  struct Origin {
    std::int32_t face;
    double x, y;
  };
  Orphans find_orphans() const;
  Origin origin_of(int face, double x, double y) const;
  Orphan orphan_at(int face, int x, int y) const;
  void find_orphans_in(int face, int x, int y, int width, int height, Orphans& orphans) const;
  bool find_exact_patch(int face, int x, int y, int width, int height, Orphans& orphans) const;
  bool find_smooth_patch(int face, int x, int y, int width, int height, Orphans& orphans) const;
  void adopt(const Orphans& orphans);
  void adopt_patch(const ExactPatch& patch);
  void interpolate(int n, const Orphan* orphans, Texel* values) const;
  void write_texels(int n, const Orphan* orphans, const Texel* values);
  Texel nearest_owned(const Orphan& orphan, const Ownership& ownership) const;
  void copy_highlights(const Orphans& orphans);
  void repeat_highlights();
  void mark_highlights();
  bool in_face(const SourceFace& face, int x, int y) const {
    return x >= apron_ && x < apron_ + face.size.width && y >= apron_ && y < apron_ + face.size.height;
  }
  // A padded texel of the face's own, as stored.
  const float* pixel(const SourceFace& face, int x, int y) const {
    ENVCONV_ASSERT(in_face(face, x, y));
    return face.pixels + (y - apron_) * face.pitch + (x - apron_) * channels_;
  }
  const Strip& strip_at(int face, int x, int y) const;
  WindowField field_about(Kernel kernel, int face, int x, int y) const;
  // The same texels of a rectangle of padded texels, where they are, or copied into `copy`: pitch floats from row to
  // row.
  struct Rectangle {
    const float* texels;
    std::ptrdiff_t pitch;
  };
  Rectangle rectangle(int face, int x, int y, int width, int height, float* copy) const;
  void write_row(int face, int x, int y, int count, const float* texels);
  Highlights::Block* block_at(int face, int x, int y, bool create);
  Highlights::Texel* highlight_at(int face, int x, int y);

  const Layout* layout_;
  Placement placement_;
  int channels_ = 3;
  int apron_;
  std::vector<SourceFace> faces_;
  std::vector<Image> copies_;               // of faces, where the image's pixels cannot be read in place
  std::vector<Image*> writable_;            // by face: copies, or the image's; none where only strips are written
  std::vector<std::vector<Strip>> strips_;  // by face
  FaceMaps maps_;
  SphereMean mean_;
  float lowest_[4];
  float threshold_ = 0;
  Highlights highlights_;
};

}  // namespace envconv
