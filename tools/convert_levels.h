// SPDX-License-Identifier: Apache-2.0
// Levels and seams of `convert`: their options, what formats can hold of them, and how they are made.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command.h"
#include "io.h"
#include "mip.h"
#include "packing.h"
#include "seam.h"

namespace envconv::tool {

/// What is wanted of levels and seams.
struct LevelOptions {
  static constexpr int as_usual = -1;  ///< the whole chain where the format is one for engines, else level 0 alone
  int mips = as_usual;                 ///< levels, level 0 included; 0: the whole chain
  MipOptions how;
  Seam seam;
  std::optional<double> max_seam;
};
void add_level_options(Command& command, LevelOptions& target);

/// Where levels go.
struct LevelPlace {
  const Layout* layout = nullptr;
  const Packing* packing = nullptr;
  std::string output;         ///< its extension tells the format
  bool file_a_level = false;  ///< {mip} is in the name
};

/// How many levels will be made when face 0 is `height` texels high; at least 1.
int levels_to_make(const LevelOptions& options, const LevelPlace& place, int height);

/// An error where a file would hold levels whose sizes do not halve: gutters, or faces of odd sizes in one image.
Result<Ok> check_levels(const LevelOptions& options, const LevelPlace& place, int height);

/// Size of a level's stored image: of one face where faces are apart, else of all of them.
Result<Size> stored_size(const LevelOptions& options, const LevelPlace& place, int height, int level, int face);

/// Bytes for levels and seams, besides level 0 and its packed image.
struct LevelBytes {
  std::size_t images = 0;   ///< pixels of the levels
  std::size_t working = 0;  ///< besides these while they are made
  std::size_t seams = 0;    ///< a copy of level 0 while its seams are fixed
  std::size_t gutters = 0;  ///< level 0 grown by its gutters, while it is written
};
LevelBytes level_bytes(const LevelOptions& options, const LevelPlace& place, int height, int channels);

/// Level 0, with its seams fixed, and after it all others.  `level0` has the placement that the method asks for.
Result<std::vector<EnvImage>> make_levels(const LevelOptions& options, const LevelPlace& place, EnvImage level0,
                                          int threads);

/// The largest seam error of any level, and which one that is.
struct WorstSeam {
  double error = 0;
  int level = 0;
};
WorstSeam worst_seam(const LevelOptions& options, const std::vector<EnvImage>& levels);

/// What one file holds: its levels, each of them its pictures; and the level that its first one is.
struct LevelFile {
  std::vector<std::vector<Picture>> levels;
  int first_level = 0;
};
/// The files in the order of their names: for each level, where every level has a file of its own, the files of its
/// faces, where they have some.
std::vector<LevelFile> level_files(const LevelOptions& options, const LevelPlace& place, std::vector<EnvImage> levels,
                                   PixelType type);

}  // namespace envconv::tool
