// Procedural motions for the synthetic actor: what a short recording session would ask of a person.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "nn/body/joint.h"

namespace doppel {

struct MotionFrame {
    std::string motion;                   // "turn", "walk", …
    std::array<float, kThetaSize> theta;  // SMPL order, axis-angle, radians; camera's y points
                                          // down, so the first joint turns the body upside up
    std::array<float, 3> trans;           // metres, camera space
};

// A full turn with the arms away from the body, then walking, raising the arms, and bending down,
// each seen from several sides. turnFrames + 3 * motionFrames frames, at `distance` metres.
std::vector<MotionFrame> actorSession(int turnFrames, int motionFrames, float distance);

// One take without a cut, as a person would be asked for before a phone: stepping round in a full
// turn with the arms away from the body, then raising the arms, then bending down.
std::vector<MotionFrame> oneTake(int frames, float distance);

// A wave and a bow that the session does not contain, for reenactment.
std::vector<MotionFrame> greeting(int frames, float distance);

// The first joint's rotation for a body that faces the camera at yaw 0 and turns to its left.
std::array<float, 3> uprightOrientation(float yaw, float pitch = 0);

}  // namespace doppel
