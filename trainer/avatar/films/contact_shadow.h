// The soft shadow that a body throws on the ground below it under an overcast sky.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "trainer/data/body_render.h"

namespace doppel {

// Points x of camera space, metres, with dot(up, x) = level; the body is where it is larger.
struct Ground {
    std::array<double, 3> up{};  // of length 1
    double level = 0;
};

// One ground per pose, in the order of time. Up is where the bodies are, seen from their feet, on
// average over a second or so about each pose, since who stands is balanced; the level is where
// their lowest points mostly are meanwhile, so that it follows poses that drift, and not a jump.
std::vector<Ground> groundsOf(BodyPoser& poser, std::span<const Theta> theta,
                              std::span<const Trans> trans, const Betas& betas);

// [H,W] in [0,1]: how much of the ground's encoded colour the shadow takes away. The part of a
// uniform sky's light, by the cosine at which it falls in, that the body keeps from each point:
// dark and sharp where it touches the ground, faint and wide below what is high. 0 off the ground.
// verts [V,3] in camera space, faces [F,3].
std::vector<float> contactShadow(std::span<const float> verts, std::span<const int32_t> faces,
                                 const Ground& ground, const Camera& camera);

}  // namespace doppel
