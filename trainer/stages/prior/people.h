// People who are known before one is seen: what they wear where on the body, its colours, and how
// far it stands off the skin.
#pragma once

#include <filesystem>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "nn/body/body.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/mix/garments.h"

namespace doppel {

// As people take of somebody by hand: what such pictures do not tell has to be told otherwise.
inline constexpr size_t kFewPictures = 4;

// One of them, on the vertices of the body model [V].
struct KnownPerson {
    std::vector<Garment> garments;
    std::vector<glm::dvec3> colours;  // sRGB-encoded
    std::vector<float> heights;       // m, of what is worn, along the normal; none below the skin
};

struct KnownPeople {
    std::vector<KnownPerson> people;  // empty: nobody is
    std::string digest;               // of all that is known of them; empty: of nobody
};

// Each of `from` is "cast" (fifty synthetic people, assets/body/cast.npz; "cast-7-19" is the cast
// without its members 7 and 19, counted from 0), an avatar's folder, a person's, with avatar/ in
// it, or a folder that holds such. `but`, an avatar's folder that is being written, is none of
// those in a folder. InputError, naming `where` and which, for anything else, for `but` itself, and
// for people of another body model.
KnownPeople readPeople(const std::vector<std::string>& from, const BodyModel& body,
                       const std::string& where, const std::filesystem::path& but = {});

// [V] Unit normals of the body without anything worn.
std::vector<glm::dvec3> skinNormals(const BodyModel& body);

// An avatar as one of them: its garments by segmentGarments(), its heights from its offsets. It
// needs a texture.
KnownPerson personOf(const Avatar& avatar);

}  // namespace doppel
