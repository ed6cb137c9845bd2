// Where a face's places look, for the choice of who paints them.
#pragma once

#include "nn/body/body.h"

namespace doppel {

// Rows [V,V], each of which sums to one, that make of a body's normals those by which a view is
// told to see a place well. Views have other expressions, and a nose's flanks and the corners of
// eyes, which look aside, would have those of views from aside: half an eye, and a nose with two
// tips. So the middle of the face, to `middle` of its extent, looks where the face does as a whole,
// and one view paints all of it; the sides look where the head does there. Elsewhere, and
// everywhere where middle is 0, normals are as they are.
SparseMatrix viewNormals(const BodyModel& body, double middle);

}  // namespace doppel
