// Heads apart from the bodies that carry them.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/data/camera.h"
#include "trainer/data/capture.h"
#include "trainer/data/pose.h"

namespace doppel {

// Turns neck and head of each pose until the head looks where that of `looks`, as many, does; the
// neck takes this part of the way, none of it where it is known how the neck stands. A head that
// would have to turn by more than 1.2 rad stays: then it is `looks` that is not to be believed.
void aimHeads(const BodyModel& body, std::span<const Theta> looks, std::vector<Theta>& theta,
              double neckPart = .5);

// Nose, left eye, right eye, left ear and right ear in a picture: u, v in pixels and confidence, 0
// where one is not seen.
using FacePoints = std::array<std::array<float, 3>, 5>;

// Where they are from the joint of a head of the default body that looks along z, metres.
extern const std::array<glm::dvec3, 5> kFace;

// Where the head's joint, which `pose` has at `place` in camera space (m), would have to be in the
// picture for the points to be where they are seen, the head turned as it is; and how sure that is,
// the points' mean confidence.
std::array<float, 3> headJointSeen(const BodyModel& body, const Theta& pose,
                                   const glm::dvec3& place, const FacePoints& points,
                                   const Camera& camera);

// Where a frame wants the points of its face, [P,3] for those of body.facePoints: u, v in its
// pixels and how much each counts, which is less where the point is not the same place on
// everybody, or where the face, in this pose, is seen from its side. All 0 where no face was found.
// verts: the body in the frame's pose [V,3], camera space.
std::vector<float> faceTargets(const BodyModel& body, std::span<const float> verts,
                               const SeenFace& seen);

}  // namespace doppel
