// Which point of a body each texel of its atlas colours.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "nn/body/body.h"

namespace doppel {

// Where a texel lies on the mesh.
struct TexelPlace {
    int32_t face = -1;               // -1: between the charts
    std::array<float, 3> corners{};  // barycentrics in the face
};

// [size,size] For every texel that pictures depend on: bilinear filtering reaches one texel over a
// chart's border, and such a texel belongs to the nearest point of the chart.
std::vector<TexelPlace> texelPlaces(const BodyModel& body, int size);

}  // namespace doppel
