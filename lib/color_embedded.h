// SPDX-License-Identifier: Apache-2.0
// The configuration for runs without one.  Internal: not installed.
#pragma once

#include <OpenColorIO/OpenColorIO.h>

#include "geometry.h"

namespace envconv {

/// Made anew by each call, in well under a millisecond.  Throws what OpenColorIO throws, which would be a bug.
OCIO_NAMESPACE::ConstConfigRcPtr embedded_config();

/// A 3x3 matrix as OpenColorIO's transform.
OCIO_NAMESPACE::MatrixTransformRcPtr matrix_transform(const Mat3& matrix);

}  // namespace envconv
