// SPDX-License-Identifier: Apache-2.0
// Samples tiles of the output: see resample.cpp for the three ways that there are.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "creases.h"
#include "grid_kernels.h"
#include "grid_tables.h"
#include "scattered_windows.h"
#include "source.h"
#include "source_blocks.h"
#include "tile_map.h"
#include "tile_plan.h"
#include "window_kernels.h"

namespace envconv {

/// What a tile has to do with highlights.
struct TileHighlights {
  TexelMask met;           ///< texels that receive of them, or may
  TexelMask slivers;       ///< texels near to those on slivers
  int sliver_samples = 1;  ///< that these take a side, at least
};

/// What a thread needs for its tiles.
struct Workspace {
  Workspace(const Source& source, Kernel kernel, std::size_t most_blocks) {
    if (is_prefiltered(kernel)) blocks.emplace(source, kernel, most_blocks);
  }
  std::optional<SourceBlocks> blocks;
  Windows windows;
  alignas(64) float u[batch_room], v[batch_room], x[batch_room], y[batch_room], z[batch_room], face[batch_room],
      su[batch_room], sv[batch_room], weight[batch_room];
  alignas(64) float samples[batch_room * 4];  // of a batch
  float total[batch_room];
  alignas(64) float row[largest_tile * 4];
  ScatteredWindows scattered;
  // Of the grid: the last rows of samples, four floats each, and their densities; and those combined to a row.
  std::vector<float> samples_rows, density_rows, combined, combined_density;
  std::vector<float> weight4;  // of the grid's texels in a row, each four times
};

/// visit(s) for every sample that reads an excess.  Neighbours mostly share a block.
template <class Visit>
void for_each_near_highlight(const Source& source, const Workspace& w, int n, const Visit& visit) {
  constexpr int side = Highlights::side;
  int block_x = -1, block_y = -1;
  float face = -1;
  const BlockTexels* mask = nullptr;
  for (int s = 0; s < n; ++s) {
    const Place p = place_of(w.windows, s);
    if (p.x / side != block_x || p.y / side != block_y || w.face[s] != face) {
      block_x = p.x / side, block_y = p.y / side, face = w.face[s];
      mask = source.highlights().mask_at(source.faces()[static_cast<std::size_t>(face)], p.x, p.y);
    }
    if (mask && (mask->rows[p.y % side] >> (p.x % side) & 1)) visit(s);
  }
}

/// One source, up to four channels of it, on its way to one output.  For several threads, each with its own workspace.
class TileSampler {
 public:
  /// All must outlive the sampler.  image: of which `source` reads channels from first_channel on.
  TileSampler(const EnvImage& image, Source& source, int first_channel, EnvImage& out, const Mat3& source_from_out,
              const Filter& filter, const ResampleOptions& options, GridTables& tables);

  /// Writes the tile, without highlights, and counts what its texels receive of these.  lights: nothing, or the
  /// slivers that are known; afterwards nothing, unless texels receive any.
  void first_pass(Workspace& w, const Tile& tile, std::unique_ptr<TileHighlights>& lights);

  /// Adds the highlights, as Source::conserve_highlights() left them, to the texels that met them.
  void second_pass(Workspace& w, const Tile& tile, const TileHighlights& lights);

 private:
  struct Run {
    int begin, end;  // texels of a tile's row
  };
  void sample(Workspace& w, const Tile& tile, const TilePlan& tile_plan, TexelMask& met);
  void find_windows(Kernel kernel, Workspace& w, int count) const;
  void point(Kernel kernel, Workspace& w, int count) const;
  void gather(Kernel kernel, Workspace& w, int count) const;
  void read(Kernel kernel, Workspace& w, int count, float* out) const;
  void point_pass(Workspace& w, const Tile& tile, const TilePlan& plan, TexelMask& met);
  void texel_pass(Workspace& w, const Tile& tile, const TilePlan& tile_plan, const TexelMask* only, bool on_crease,
                  TexelMask& met);
  bool on_grid(Workspace& w, const Tile& tile, const TilePlan& tile_plan, bool creased, Kernel kernel, TexelMask& met);
  bool grid_pass(Workspace& w, const Tile& tile, const TilePlan& plan, bool creased, Kernel kernel,
                 const GridQuadrature& qu, const GridQuadrature& qv, TexelMask& met);
  template <class Visit>
  void sample_row(Kernel kernel, const Tile& tile, const TilePlan& plan, const Quadrature& qu, const Quadrature& qv,
                  const TileMap* map, int j, Run run, Workspace& w, const Visit& visit) const;
  template <class Visit>
  void sample_rim_texel(const Tile& tile, const TilePlan& plan, int i, int j, Workspace& w, const Visit& visit) const;
  template <class Visit>
  void sample_creased_texel(const Tile& tile, const TilePlan& plan, int i, int j, Workspace& w,
                            const Visit& visit) const;
  void find_batch(Kernel kernel, const Tile& tile, Workspace& w, int count) const;
  void store_run(Workspace& w, const Tile& tile, int j, Run run);
  template <class Visit>
  void sample_met(Workspace& w, const Tile& tile, const TileHighlights& lights, const Visit& visit);
  bool receive(Workspace& w, const Tile& tile, const TileHighlights& lights);
  std::optional<TileMap> map(const Tile& tile, const TilePlan& plan, double reach) const {
    return TileMap::find(source_, out_, source_from_out_, tile, plan, reach);
  }
  TilePlan plan(const Tile& tile) const { return plan_tile(image_, out_, source_from_out_, filter_, options_, tile); }

  const EnvImage& image_;
  Source& source_;
  int first_channel_, channels_;  // of the output's, that are written
  EnvImage& out_;
  Mat3 source_from_out_;
  float matrix_[9];
  const Filter& filter_;
  const ResampleOptions& options_;
  GridTables& tables_;
  float lowest_[4];  // values are not below
};

}  // namespace envconv
