// Surfaces beyond a body model's own: hair that hangs free, a skirt, what a person carries. They
// are more vertices and faces at the end of the model's, skinned like them, with charts of their
// own in the same atlas, so that whatever poses, draws or exports a body has them without knowing
// of them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "nn/body/body.h"

namespace doppel {

struct BodyCap {
    std::vector<float> vertices;   // [C,3] rest pose of the shape that it was grown for, m
    std::vector<int32_t> faces;    // [G,3] into these, counter-clockwise from outside
    std::vector<int64_t> nearest;  // [C] the model's vertex whose shape and part each shares
    std::vector<float> weights;    // [C,24] each row sums to one
};

// The arrays of the body that they hold, with the cap at their ends; betas [10] is the shape that
// it was grown for. The model's vertices and faces keep their numbers. Nothing where its atlas has
// no room for texels that would be worth it.
std::optional<Npz> withCap(const Npz& arrays, const BodyCap& cap, std::span<const float> betas);

// The arrays of the model alone; the same where it has no cap.
Npz withoutCap(const Npz& arrays);

// Whether a body has this model, with a cap or without: its surface and its atlas.
bool isModelOf(const BodyModel& model, const BodyModel& body);

}  // namespace doppel
