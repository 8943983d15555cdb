// SPDX-License-Identifier: Apache-2.0
// Prefiltered texels of a source, made block by block when they are first read.
//
// A prefiltered copy of a whole panorama would be memory to fetch from the system and to walk through four times.  A
// block of it fits into a core's cache: its rows are copied from the source, with a margin in which the recursions
// forget where they began, filtered along rows and columns, and read by all samples nearby.  Every thread keeps blocks
// of its own; what a block holds does not depend on who made it, nor when.
//
// Most tiles of an output see a small rectangle of the source.  Just that is filtered for them, over the one of the
// tile before: memory that never leaves the cache.  Blocks serve tiles that see a pole or lie across seams.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "image.h"
#include "source.h"
#include "tile_plan.h"
#include "window_kernels.h"

namespace envconv {

/// Blocks of one source.  Not for several threads at once, unless all blocks were made before (make_all()).
class SourceBlocks {
 public:
  /// `source`, made for `kernel`, must outlive the blocks.  At most `most` blocks are kept, or as many as one tile
  /// needs.
  SourceBlocks(const Source& source, Kernel kernel, std::size_t most);

  /// Blocks that were read before may be replaced from now on.
  /// view: what the tile is about to read.
  void next_tile(const SourceView& view) {
    ++tile_;
    view_.block = -1;
    wanted_.reset();
    if (view.face >= 0) wanted_ = view;
  }

  /// Makes all blocks; point() then changes nothing.
  void make_all();

  /// Points windows.first and .pitch at prefiltered texels, for windows of the kernel.
  void point(int n, const float* face, Windows& windows);
  void point(int n, const float* face, Windows& windows) const;  ///< after make_all()

  /// Blocks that a thread profits from keeping: as many as a row of tiles crosses that meets every block of a face's
  /// row, as at a pole, and 8 at least, within so many bytes, and no more than there are.
  static std::size_t worth_keeping(const EnvImage& image, Kernel kernel, std::size_t memory);
  /// Bytes that one block takes.
  static std::size_t bytes(Kernel kernel, int channels);

 private:
  static constexpr int side = 64;                 // texels of a block
  static constexpr int largest_view = 320 * 320;  // texels; near poles, where blocks would be more; commonly a sixth
  struct Grid {
    int across = 0, down = 0;
    std::int32_t first = 0;  // block
  };
  struct Slot {
    std::vector<float> texels;
    std::ptrdiff_t pitch = 0;  // floats from row to row
    std::int32_t block = -1;
    std::int64_t tile = -1;    // that read it last
    int x = 0, y = 0;          // padded texel of the first one that is meant to be read
    std::ptrdiff_t first = 0;  // float where that one lies
  };
  std::int32_t block_of(int face, int x, int y) const;
  Slot& slot_of(std::int32_t block);
  void make(std::int32_t block, Slot& slot);
  void make_view();
  void filter(int face, int x, int y, int width, int height, Slot& slot);
  template <class Find>
  void point_at(int n, const float* face, Windows& windows, const Find& find) const;

  const Source* source_;
  Kernel kernel_;
  Prefilter prefilter_;
  int reach_;  // texels beyond each of a block's sides
  std::size_t most_;
  std::vector<Grid> grids_;            // by face
  std::vector<std::int32_t> slot_of_;  // by block: slot, or -1
  std::vector<Slot> slots_;
  std::int64_t tile_ = 0;
  std::optional<SourceView> wanted_;  // not made yet
  Slot view_;                         // of the tile; view_.block is its face, or -1
  int view_width_ = 0, view_height_ = 0;
  std::vector<float> rows_, work_;  // of a block being made
};

}  // namespace envconv
