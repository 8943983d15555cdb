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
  int height = 0;     ///< of face 0
  std::string how;    ///< "from its metadata (envconv:layout)", "2:1 is latlong" ...
  std::vector<std::string> warnings;
};

/// Order: what the user said, then metadata, then the container (the envmap attribute, part names, a cube map, the
/// number of layers), then the aspect ratio.  Ambiguity is an error that lists the candidates.  What the user or
/// envconv's metadata says and the size contradicts is an error too; an envmap attribute that the size contradicts is
/// ignored with a warning.  Pictures without pixels (headers) will do; a cross is then presumed to be one.
Result<Recognition> recognize(const PictureFile& file, const InputHints& hints);

/// What a file that recognize() finds ambiguous could be: layouts, each with its packing in brackets where that is not
/// the layout's own.  Empty for every other file.
std::vector<std::string> candidates(const PictureFile& file, const InputHints& hints);

/// The environment in a file; the file's pixels are moved.  Several files (one per face, in the layout's order) are
/// given as one PictureFile of several pictures.
Result<EnvImage> to_environment(PictureFile file, const Recognition& recognition);

/// The attributes that record an environment in a file (envconv:layout, -:packing, -:frame, -:rotation; envmap where
/// its meaning holds exactly and the format is EXR).
Metadata metadata_of(const Layout& layout, const Packing& packing, const Frame& frame, const Rotation& rotation);

}  // namespace envconv
