// SPDX-License-Identifier: Apache-2.0
// What a file of pictures is as an environment: layout, packing, frame, and how that was recognised.
#pragma once

#include <string>
#include <vector>

#include "geometry.h"
#include "image.h"
#include "io.h"
#include "packing.h"
#include "result.h"
#include "seam.h"

namespace envconv {

/// What the user said of an input; unset fields are recognised.
struct InputHints {
  const Layout* layout = nullptr;
  const Packing* packing = nullptr;
  const Frame* frame = nullptr;
};

/// An input understood.
struct Recognition {
  const Layout* layout = nullptr;
  const Packing* packing = nullptr;
  const Frame* frame = nullptr;
  Rotation rotation;  ///< as the metadata records it; already in the pixels
  int height = 0;     ///< of face 0, without gutters
  Seam seam;          ///< as the metadata records it
  /// Sizes of the faces as they are stored, where the height does not imply them: with gutters, or a MIP level.
  std::vector<Size> stored;
  bool first_only = false;  ///< of the file's pictures only the first is the environment
  std::string how;          ///< "from its metadata (envconv:layout)", "2:1 is latlong" ...
  std::vector<std::string> warnings;
};

/// Order: what the user said, then metadata, then the container (the envmap attribute, part names, a cube map, the
/// number of layers), then the aspect ratio.  Ambiguity is an error that lists the candidates.  What the user or
/// envconv's metadata says and the size contradicts is an error too; an envmap attribute that the size contradicts is
/// ignored with a warning.  Of an OpenEXR file whose parts are not faces the first is taken, with a warning that names
/// the others.  Pictures without pixels (headers) will do; a cross is then presumed to be one.
Result<Recognition> recognize(const PictureFile& file, const InputHints& hints);

/// What a file that recognize() finds ambiguous could be: layouts, each with its packing in brackets where that is not
/// the layout's own.  Empty for every other file.
std::vector<std::string> candidates(const PictureFile& file, const InputHints& hints);

/// The environment in a file; the file's pixels are moved.  Several files (one per face, in the layout's order) are
/// given as one PictureFile of several pictures.  Gutters are cut off; `grown`, when not null, gets the faces with
/// them.
Result<EnvImage> to_environment(PictureFile file, const Recognition& recognition, std::vector<Image>* grown = nullptr);

/// Where texel centres of a recognised file lie.
Placement placement_of(const Recognition& recognition);

/// What is recorded of an environment's seams and levels.
struct RecordedLevels {
  Seam seam;
  int height = 0;  ///< of face 0 of level 0, without gutters; 0: not recorded, since the image's size implies it
  int level = 0;   ///< of the file's first image
};

/// The attributes that record an environment in a file (envconv:layout, -:packing, -:frame, -:rotation; -:seam, -:size
/// and -:level where there is something to tell; envmap where its meaning holds exactly and the format is EXR).
Metadata metadata_of(const Layout& layout, const Packing& packing, const Frame& frame, const Rotation& rotation,
                     const RecordedLevels& levels = {});

}  // namespace envconv
