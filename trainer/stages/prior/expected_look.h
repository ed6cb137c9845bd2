// What a person looks like where no picture shows it, told by people who are known and by what the
// pictures show.
#pragma once

#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/stages/prior/people.h"

namespace doppel {

struct ExpectedLook {
    std::vector<Garment> garments;    // [V] seen ones as they were seen
    std::vector<glm::dvec3> colours;  // [V] sRGB-encoded, of all vertices as if none were seen
    std::vector<float> heights;       // [V] m off the skin
};

// From vertices' colours [V] (sRGB-encoded), each of which is trusted so much (0: not seen; 1: seen
// as well as can be).
//
// What is seen is parted into garments. Whoever of the known people wears the same where it is
// seen, head, trunk, arms, legs and feet each for itself, says what is worn where it is not, and
// how far it stands off. A garment has the mean colour of what is seen of it; of one that is not
// seen, theirs. Skin, and so a face, has their lights and darks besides. A person's cap, which they
// lack, follows what is around.
ExpectedLook expectedLook(const KnownPeople& known, const BodyModel& body,
                          std::span<const glm::dvec3> colours, std::span<const double> trust);

// [V,3] What a body stands off its skin, as offsets.
std::vector<float> offsetsOf(const BodyModel& body, std::span<const float> heights);

}  // namespace doppel
