// What places of a person may look like that no picture shows.
#pragma once

#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/stages/prior/expected_look.h"

namespace doppel {

// [V] Colours of a person's vertices from those that were seen (sRGB-encoded, [V]), each of which
// is trusted so much (0: not seen; 1: seen as well as can be). They make the least of how much
// colours change over the surface (the integral of the gradient's square, by linear elements) and
// of what vertices are off by, trusted: one sparse system. Clothes end around limbs, and so does
// hair: a change along a bone costs a hundredth of one around it, and one at the rim of the face
// next to nothing. A vertex from which no edges lead to a seen one keeps its colour; `reached` says
// [V] which are not of these.
struct UnseenColours {
    std::vector<glm::dvec3> colours;
    std::vector<char> reached;
};
//
// Where a look is expected, colours pass over from one of its garments to another hardly at all,
// and far from what was seen, a decimetre or two, they become the expected; what was seen in the
// colour of another garment is not spread.
UnseenColours unseenColours(const BodyModel& body, std::span<const glm::dvec3> seen,
                            std::span<const double> trust, const ExpectedLook* look = nullptr);

}  // namespace doppel
