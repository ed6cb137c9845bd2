// Heads apart from the bodies that carry them.
#pragma once

#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/data/pose.h"

namespace doppel {

// Turns neck and head of each pose until the head looks where that of `looks`, as many, does; the
// neck takes half of the way. A head that would have to turn by more than 1.2 rad stays: then it is
// `looks` that is not to be believed.
void aimHeads(const BodyModel& body, std::span<const Theta> looks, std::vector<Theta>& theta);

}  // namespace doppel
