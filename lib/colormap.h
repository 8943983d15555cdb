// SPDX-License-Identifier: Apache-2.0
// Colours for pictures of numbers, made from a formula in a perceptually uniform space.
//
// The space is OKLab (B. Ottosson, A perceptual color space for image processing, 2020): equal distances look equally
// different.  In polar form: lightness in [0,1], chroma (0 is grey, 0.3 as strong as screens show), hue in degrees.
#pragma once

#include <array>

namespace envconv {

/// Red, green, blue.
using Rgb = std::array<double, 3>;

/// Linear sRGB of a colour of OKLab; outside [0,1] where screens cannot show it.
Rgb linear_from_oklab(double lightness, double a, double b);

/// sRGB as it is encoded for screens, in [0,1], of a lightness, chroma and hue; the chroma is reduced where screens
/// cannot show it.
Rgb srgb_from_oklch(double lightness, double chroma, double degrees);

/// The colour, in linear sRGB, that stands for t in [0,1] (beyond: the nearest end; NaN: the low end): from a dark
/// violet over blue and green to a light yellow.  Lightness rises throughout, so that it reads in grey and to the
/// colour-blind, and equal steps of t are equal distances in OKLab.
Rgb scale_color(double t);

}  // namespace envconv
