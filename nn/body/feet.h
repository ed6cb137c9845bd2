// The front of feet, which shoes cover: toes have slits between them, and shoes have none.
#pragma once

#include "nn/body/body.h"

namespace doppel {

// How much of each vertex [V] is of the front of a foot: 0 to 1, less towards the instep.
std::vector<float> toeShares(const BodyModel& body);

// [V,3] What closes the slits between toes, m: their edges go out to the front's convex hull, and
// their walls, of which nobody sees much, after them. Zero elsewhere.
std::vector<float> closedToes(const BodyModel& body);

// Rows [V,V], each of which sums to one, by which a vertex of the front of a foot moves as all do
// that are within some `width` metres of it (a Gaussian's deviation) at rest with these offsets
// [V,3], in space and not along the surface: outlines would draw a shoe's tip by each toe for
// itself, since along the surface one toe is far from the next. Elsewhere each moves as itself
// does.
SparseMatrix movedWithToes(const BodyModel& body, std::span<const float> offsets, double width);

}  // namespace doppel
