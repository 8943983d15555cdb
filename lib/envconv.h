// SPDX-License-Identifier: Apache-2.0
// The whole public interface of the library, in reading order.
#pragma once

#include "analyze.h"         // figures of a layout
#include "color.h"           // colour management
#include "color_encoding.h"  // primaries and curves
#include "discrepancy.h"     // evenness of points
#include "distortion.h"      // a picture of a layout's distortion
#include "filter.h"          // reconstruction filters
#include "geometry.h"        // coordinate systems, frames, placements
#include "image.h"           // pixels, environments
#include "io.h"              // files
#include "layout.h"          // faces, direction, locate
#include "luminance.h"       // how bright, and where
#include "metrics.h"         // errors between environments
#include "mip.h"             // levels
#include "packing.h"         // faces in one image
#include "pattern.h"         // test cards
#include "recognize.h"       // files to environments
#include "resample.h"        // from one environment to another
#include "result.h"          // errors as values
#include "sampler.h"         // radiance of a direction and a footprint
#include "scratch.h"         // pixels in files instead of memory
#include "seam.h"            // edges of faces
#include "texel_figures.h"   // figures of texels at one size
