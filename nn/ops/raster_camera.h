// A camera as the renders take it: an input of the graph, so that it can change between replays,
//     Tensor camera = graph.input(kCameraShape); graph.write(camera, cameraValues({...}));
// or a constant.
#pragma once

#include <cstring>
#include <vector>

#include "nn/core/op.h"
#include "raster/params.h"

namespace doppel {

inline const Shape kCameraShape{sizeof(RasterCamera) / 4};
inline std::vector<float> cameraValues(const RasterCamera& camera) {
    std::vector<float> values(sizeof(camera) / 4);
    std::memcpy(values.data(), &camera, sizeof(camera));
    return values;
}

// ---- what the declarations of the rasterizers' ops make of their attributes
// ----------------------

// attr_NAME as a picture's side.
inline int64_t side(OpCall& c, std::string_view name, int64_t most) {
    uint32_t value = c.u(name);
    if (value == 0 || value > most)
        throwInput("attr_{}: expected pixels from 1 to {}, found {}", name, most, value);
    return value;
}

inline float positive(OpCall& c, std::string_view name) {
    double value = c.attribute(name);
    if (!(value > 0)) throwInput("attr_{}: expected a positive number, found {}", name, value);
    return c.f(name);
}

// fx, fy, cx, cy, as of a picture that is `scale` times as large.
inline Tensor cameraOf(OpCall& c, float sigma, float blurRadius, float scale = 1) {
    RasterCamera camera{scale * positive(c, "fx"),
                        scale * positive(c, "fy"),
                        scale * c.f("cx"),
                        scale * c.f("cy"),
                        sigma,
                        blurRadius,
                        0,
                        0};
    return c.graph.constant(std::span<const float>(cameraValues(camera)), kCameraShape);
}

}  // namespace doppel
