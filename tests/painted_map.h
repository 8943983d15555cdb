// SPDX-License-Identifier: Apache-2.0
// Environments made from functions of the direction.
#pragma once

#include <functional>

#include "image.h"

namespace envconv::test {

/// Gives the channels' values in a world direction.
using Radiance = std::function<void(Vec3, float*)>;

/// An environment of `height` whose texels hold f at their centres.
inline EnvImage paint(const Layout& layout, int height, int channels, const Radiance& f, const Mat3& frame = {}) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.consumer_from_world = frame;
  image.channels = Channels::standard(channels);
  const Mat3 world_from_layout = transpose(layout_from_world(image));
  for (int k = 0; k < layout.face_count(); ++k) {
    const Size size = face_size(layout, k, height);
    Image face(size.width, size.height, channels);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        f(world_from_layout * layout.direction(k, u_from_texel(x, size.width, image.placement),
                                               u_from_texel(y, size.height, image.placement)),
          face.at(x, y));
    image.faces.push_back(std::move(face));
  }
  return image;
}

}  // namespace envconv::test
