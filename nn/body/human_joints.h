// How far human joints turn, and what they carry.
#pragma once

#include <array>
#include <glm/vec3.hpp>

#include "nn/body/joint.h"

namespace doppel {

struct AngleRange {
    double low, high;  // degrees
};

// A joint's rotation is taken apart into a twist about its bone's axis in the T-pose, and a swing
// of the bone about axes u and v across it (the swing's rotation vector in these two).
//
// Signs are those of SMPL's T-pose, of left and middle joints; the right side is its mirror image.
struct JointRange {
    glm::dvec3 axis, u, v;
    AngleRange twist, aboutU, aboutV;
    // Ball joints: swings fill an ellipse, for nobody reaches the ends of both ranges at once.
    // Hinges: a box.
    bool ball;
};

// Ranges of motion of healthy adults as the American Academy of Orthopaedic Surgeons gives them
// (Greene and Heckman, "The Clinical Measurement of Joint Motion", 1994) and, for the spine, White
// and Panjabi, "Clinical Biomechanics of the Spine" (1990). Where SMPL has more joints than a
// physiotherapist measures (three in the trunk, two in the neck), they share a range. Captures put
// part of a forearm's rotation into the wrist and part of a shoulder girdle's into the shoulder,
// and active people go further than the mean: ranges are widened by up to a third for that.
// None of the pelvis.
const JointRange& rangeOf(size_t joint);

// Each joint's share of the mass, of a body whose segments have the shares of an adult's that de
// Leva gives ("Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", 1996): a
// segment's goes to the joints at its ends in the ratio of their distances from the segment's
// centre.
const std::array<double, joint::kCount>& jointMasses();

}  // namespace doppel
