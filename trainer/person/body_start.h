// A body's pose from landmarks, in closed form: where a fit starts.
#pragma once

#include <optional>

#include "nn/body/body.h"
#include "trainer/data/camera.h"
#include "trainer/data/pose.h"
#include "trainer/person/blazepose.h"

namespace doppel {

// A camera whose longer side sees 60°, as a phone's main camera does, for pictures that say nothing
// of theirs.
Camera guessedCamera(int width, int height);

struct BodyStart {
    Theta theta{};
    Trans trans{};        // metres, camera space
    double residual = 0;  // pixels: root mean square of the joints' distances to their landmarks
};

// The default shape of `body`, each bone turned to where the landmarks in space point, hinges of
// elbows and knees by the plane in which they are bent, stood where its joints best cover the
// landmarks in the picture. Where landmarks are across and down comes from the picture, how deep
// from the landmarks in space, whose scale is a guess; only directions are used.
class BodyPoser3d {
public:
    explicit BodyPoser3d(const BodyModel& body);
    BodyStart operator()(const PersonLandmarks& person, const Camera& camera) const;

private:
    std::array<int, joint::kCount> parents_;
    std::array<glm::dvec3, joint::kCount> rest_;
};

// The landmark that shows a joint, where one does: shoulders, elbows, wrists, hips, knees, ankles.
std::optional<size_t> landmarkOfJoint(size_t joint);

// u, v in pixels and confidence, in the order of the scheme openpose25; [25][3].
std::array<float, 75> openPoseKeypoints(const PersonLandmarks& person);

}  // namespace doppel
