// Caps (nn/body/body_caps.h) of several avatars on one: somebody's hair with another's skirt.
#pragma once

#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/avatar/mix/garments.h"

namespace doppel {

// The avatar on its model alone, without cap: its texels are where they were. The avatar itself
// where it has none.
Avatar withoutCap(const Avatar& avatar);

// Pieces of a cap that hang together, by the number of a face: those that are hair, for they touch
// the head, that belong to a bottom, for they touch the legs, or else to a top.
struct CapPiece {
    Garment garment = Garment::Hair;
    std::vector<size_t> faces;  // of the body
};
std::vector<CapPiece> capPieces(const BodyModel& body);

// Puts pieces onto an avatar that has no cap, each where it hangs on its giver's body, its texels
// into the empty parts of the atlas. What finds no room is left out; false then.
struct WornPiece {
    const Avatar* giver = nullptr;
    CapPiece piece;
};
bool wearCaps(Avatar& avatar, const std::vector<WornPiece>& pieces);

}  // namespace doppel
