// One avatar of several: the face of one with the clothes of another. All share the body model and
// its atlas, so that what is worn can be taken over vertex by vertex and texel by texel.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/avatar/mix/garments.h"

namespace doppel {

// Who gives what. Those that are null are the base's.
struct MixParts {
    const Avatar* base = nullptr;
    const Avatar* head = nullptr;  // the face and what is skin on head and neck, and its colour
    const Avatar* hair = nullptr;  // null: the head's
    const Avatar* top = nullptr;
    const Avatar* bottom = nullptr;
    const Avatar* shoes = nullptr;
    const Avatar* hands = nullptr;  // what is skin from the wrists on
    const Avatar* shape = nullptr;  // betas, the body under clothes
};

// As the command's flags and the viewer's panel name them.
struct MixPart {
    const char *name, *text;
    const Avatar* MixParts::*giver;
};
inline constexpr std::array<MixPart, 7> kMixParts = {{
    {"head", "Whose face, ears and neck, and whose skin's colour; with the hair", &MixParts::head},
    {"hair", "Whose hair", &MixParts::hair},
    {"top", "Whose shirt, blouse or jacket", &MixParts::top},
    {"bottom", "Whose trousers or skirt", &MixParts::bottom},
    {"shoes", "Whose shoes", &MixParts::shoes},
    {"hands", "Whose hands", &MixParts::hands},
    {"shape", "Whose body under the clothes", &MixParts::shape},
}};

struct Mix {
    Avatar avatar;
    // Parts of the vertices: all that the base has given; then, whoever gave it, skin of the head,
    // hair, top, bottom, shoes, hands; and what none of them has shown, which takes after what is
    // around.
    std::array<double, 7> given{};
    double unseen = 0;
    bool capsWorn = true;  // false: the atlas had no room for their hair or loose cloth
};

// Hair lies over a top, a top over shoes and a bottom. Where two avatars' clothes do not cover
// what was under the base's, skin is shown that one of them shows there, rather that of one who
// wears there what is worn beside it, and else what is around; trousers hang down to shoes and go
// up to a top, and under bare legs there are the socks that were worn with the skirt. Skin of all
// has the colours of the head giver's. Over a seam offsets go over into each other within some 3
// cm; colours change where the upper garment's picture does, within a triangle, and are without
// what pictures had mixed into them of what is not worn here. The light is the base's.
//
// The texture is fixed, of each avatar's baked one where it has one: networks paint one person, and
// the avatar has none. InputError, naming the body's files, where they are not of one body model.
Mix mixAvatars(const MixParts& parts);

}  // namespace doppel
