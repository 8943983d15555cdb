// SPDX-License-Identifier: Apache-2.0
// Packing: where the faces of a layout sit in one image (or in several files or EXR parts).
#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "image.h"
#include "layout.h"
#include "result.h"

namespace envconv {

/// A registered packing.
struct Packing {
  std::string_view
      name;  ///< as on the command line: "row", "column", "grid", "cross", "vcross", "youtube", "files", "parts"
  std::string_view note;  ///< one line for listings
};

/// All packings.
std::span<const Packing> all_packings();
const Packing* find_packing(std::string_view name);

/// Where one face sits, in pixels of the packed image.
struct Cell {
  int x = 0, y = 0;       ///< top left pixel
  Size size;              ///< of the face itself (before turning)
  int quarter_turns = 0;  ///< the face's picture is turned clockwise by so many quarters in the packed image
};

/// A packed image: its size, and the cell of every face.
struct PackedShape {
  Size size;
  std::vector<Cell> cells;
};

// row, column: faces in order.  grid: the layout's own rows, or where these are one row or column, the most nearly
// square grid without an empty cell (3x2 for six faces).  Unfoldings (cross, vcross, youtube) are pictures: faces go
// where they look, turned as the picture wants them, so that openexr-cube's cross is the same picture as cube's.

/// The packing that the layout's contract names as its default.
const Packing& default_packing(const Layout& layout);
/// True when the packing can hold the layout: crosses and youtube are for the cube family's six square faces.
bool packs(const Packing& packing, const Layout& layout);
/// True when the layout's faces, in their order and as they are turned, are those of a cube map of OpenGL, Vulkan and
/// Direct3D: of the cube family all but openexr-cube.
bool is_cube_map(const Layout& layout);
/// True when all faces have the same size, so that they can be layers of an array.
bool faces_are_alike(const Layout& layout);
/// The shape of a packed image whose face 0 is `height` texels high.  `files` and `parts` have no packed image: error.
Result<PackedShape> packed_shape(const Layout& layout, const Packing& packing, int height);
/// The height of face 0 for which the packed image is exactly `size`, if there is one.
std::optional<int> height_from_packed_size(const Layout& layout, const Packing& packing, Size size);

/// Faces to one image; pixels outside all cells become 0.  A single face is moved, not copied.
Result<Image> pack(const Layout& layout, const Packing& packing, std::vector<Image> faces);
/// One image to faces; the inverse of pack.  A layout of one face takes the image as it is.
Result<std::vector<Image>> unpack(const Layout& layout, const Packing& packing, Image image);

}  // namespace envconv
