// SPDX-License-Identifier: Apache-2.0
// A picture of a layout's distortion.
#pragma once

#include "image.h"
#include "layout.h"
#include "result.h"

namespace envconv {

/// Two heat maps over the layout's faces in its own packing, with their scales, as linear RGB: the anisotropy (largest
/// over smallest stretch), and the density (solid angle per area of the face, relative to 4 pi over all area stored).
/// Over both lie Tissot's indicatrices: the pictures of equal small circles of the sphere.  What the layout does not
/// own is grey.  Face 0 is `height` pixels high, 64 at least.
/// Errors: limit, when the picture would have more than 2^27 pixels.
Result<Image> distortion_picture(const Layout& layout, int height);

}  // namespace envconv
