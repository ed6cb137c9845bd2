// Which poses people are likely to be in, where pictures leave it open.
#pragma once

#include <vector>

#include "nn/body/joint.h"

namespace doppel {

// Of one component of a joint's rotation vector, radians.
struct LikelyAngle {
    float mean = 0;
    float precision = 0;  // one over the deviation; 0: anything is as likely
    float low = -100, high = 100;
};

// [kThetaSize], in theta's order. Somebody who stands at ease with the arms hanging, and how far
// joints are from that in most frames of most clips: knees and elbows little bent, the trunk
// straight, feet at right angles to shins. No recorded motion went into it; the numbers are ours,
// and nn/ops/fit.h has the loss that lets a joint be anywhere else.
// Limits are those of human_joints.h, along the components. Shoulders have none: their range is
// not a box in these.
// Nothing is said of the pelvis, of neck and head (which are aimed by the face), toes and knuckles.
std::vector<LikelyAngle> likelyPose();

}  // namespace doppel
