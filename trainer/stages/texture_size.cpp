#include "trainer/stages/texture_size.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace doppel {

namespace {

// Crops of 1024 pixels at most could not teach finer ones (stages/surface.cpp).
constexpr int kMostSide = 1024;

// Metres that the atlas's side would be long if all of it were as dense as its charts are in the
// mean.
double atlasMetres(const BodyModel& body) {
    double surface = 0, charts = 0;  // m², and the atlas's side squared
    for (size_t f = 0; f < static_cast<size_t>(body.faceCount); ++f) {
        std::array<glm::dvec3, 3> corner, uv;
        for (size_t k = 0; k < 3; ++k) {
            const float* v = &body.templateVertices[3 * static_cast<size_t>(body.faces[3 * f + k])];
            const float* t = &body.uvs[2 * static_cast<size_t>(body.uvFaces[3 * f + k])];
            corner[k] = {v[0], v[1], v[2]};
            uv[k] = {t[0], t[1], 0};
        }
        surface += glm::length(glm::cross(corner[1] - corner[0], corner[2] - corner[0]));
        charts += glm::length(glm::cross(uv[1] - uv[0], uv[2] - uv[0]));
    }
    return std::sqrt(surface / std::max(charts, 1e-9));
}

}  // namespace

int textureSizeFor(const BodyModel& body, const Capture& capture, double texel) {
    std::vector<double> pixels;  // of a metre at the person's distance
    for (size_t i = 0; i < capture.size(); ++i) {
        const Camera& camera = capture.frames[i].camera;
        const auto depth = static_cast<double>(capture.trans[i][2]);
        if (depth > 0) pixels.push_back(std::sqrt(camera.fx * camera.fy) / depth);
    }
    if (pixels.empty()) return kLeastSideByFrames;
    std::ranges::sort(pixels);
    const double wanted = atlasMetres(body) * pixels[(pixels.size() - 1) * 9 / 10] / texel;
    int side = kLeastSideByFrames;
    while (side < kMostSide && side < wanted) side *= 2;
    return side;
}

void decideTextureSize(Avatar& avatar, const Capture& capture, const TrainSettings& settings) {
    TexturePreset& preset = avatar.preset.texture;
    if (preset.textureSize != 0) return;
    const bool anew = std::ranges::count(settings.stages, "texels") > 0;
    preset.textureSize = !anew && !avatar.texels.empty()
                             ? avatar.textureSize
                             : textureSizeFor(avatar.body, capture, preset.texel);
    const int depth = std::max(preset.depth, avatar.preset.refine.depth);
    preset.block = std::max(preset.block, preset.textureSize >> depth);
}

}  // namespace doppel
