#include "trainer/avatar/rig.h"

namespace doppel {

Rig::Rig(const BodyModel& shaped, const Betas& betas) : body(shaped) {
    const std::vector<double> joints =
        restJoints(body, std::vector<double>(betas.begin(), betas.end()));
    for (size_t j = 0; j < rest.size(); ++j)
        rest[j] = {joints[3 * j], joints[3 * j + 1], joints[3 * j + 2]};
}

Placement Rig::place(const Theta& theta) const {
    Placement placed;
    for (size_t j = 0; j < rest.size(); ++j) {
        placed.turn[j] = jointRotation(theta, j);
        placed.origin[j] = rest[j];
        if (body.parents[j] < 0) continue;
        const auto parent = static_cast<size_t>(body.parents[j]);
        placed.turn[j] = placed.turn[parent] * placed.turn[j];
        placed.origin[j] = placed.origin[parent] + placed.turn[parent] * (rest[j] - rest[parent]);
    }
    return placed;
}

Rig::Blend Rig::skin(const Placement& placed, size_t v) const {
    Blend blend;
    for (size_t j = 0; j < rest.size(); ++j) {
        const double weight = body.weights[rest.size() * v + j];
        if (weight == 0) continue;
        blend.turn += weight * glm::mat3_cast(placed.turn[j]);
        blend.move += weight * (placed.origin[j] - placed.turn[j] * rest[j]);
    }
    return blend;
}

std::vector<float> areaNormals(std::span<const float> verts, std::span<const int32_t> faces) {
    std::vector<double> sums(verts.size());
    auto at = [&](int32_t v) {
        const float* x = &verts[3 * static_cast<size_t>(v)];
        return glm::dvec3(x[0], x[1], x[2]);
    };
    for (size_t f = 0; f + 2 < faces.size(); f += 3) {
        const glm::dvec3 a = at(faces[f]);
        const glm::dvec3 normal = glm::cross(at(faces[f + 1]) - a, at(faces[f + 2]) - a);
        for (size_t corner = 0; corner < 3; ++corner)
            for (int c = 0; c < 3; ++c)
                sums[3 * static_cast<size_t>(faces[f + corner]) + static_cast<size_t>(c)] +=
                    normal[c];
    }
    return {sums.begin(), sums.end()};
}

}  // namespace doppel
