// Where an atlas is cut: an edge of the mesh that two charts have, each in a place of its own.
#pragma once

#include "nn/body/body.h"
#include "nn/core/sparse.h"

namespace doppel {

// What the texture [size,size,C] shows on one side of the seams less what it shows on the other,
// one row for each texel along them: rows [N, size size]. Bilinear, as it is drawn.
SparseMatrix seamDifferences(const BodyModel& body, int size);

}  // namespace doppel
