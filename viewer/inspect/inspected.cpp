#include "viewer/inspect/inspected.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace doppel {

std::optional<Inspected> inspect(const Avatar& avatar, const SurfacePoint& point) {
    const BodyModel& body = avatar.body;
    if (point.face >= static_cast<size_t>(body.faceCount)) return std::nullopt;
    Inspected found{.point = point};
    const auto most =
        static_cast<size_t>(std::ranges::max_element(point.corners) - point.corners.begin());
    found.vertex = static_cast<size_t>(body.faces[3 * point.face + most]);
    found.part = static_cast<BodyPart>(body.part[found.vertex]);
    const std::vector<float> bounds = clampBounds(body, avatar.preset.mesh.clamps);
    found.bound = double{bounds[found.vertex]};
    for (size_t k = 0; k < 3; ++k) {
        const auto t = static_cast<size_t>(body.uvFaces[3 * point.face + k]);
        found.uv += point.corners[k] * glm::dvec2(body.uvs[2 * t], body.uvs[2 * t + 1]);
    }
    const int size = avatar.textureSize;
    for (int k = 0; k < 2; ++k)
        found.texel[k] = std::clamp(static_cast<int>(std::floor(found.uv[k] * size)), 0, size - 1);
    const auto at = static_cast<size_t>(found.texel.y) * static_cast<size_t>(size) +
                    static_cast<size_t>(found.texel.x);
    if (at < avatar.texelsSeen.size())
        found.origin = static_cast<TexelOrigin>(avatar.texelsSeen[at]);
    return found;
}

const char* partName(BodyPart part) {
    constexpr std::array<const char*, kBodyPartEnd> kNames = {
        "none",         "head",          "torso",      "left upper arm", "right upper arm",
        "left forearm", "right forearm", "left thigh", "right thigh",    "left calf",
        "right calf",   "left foot",     "right foot", "left hand",      "right hand"};
    return kNames.at(part);
}

}  // namespace doppel
