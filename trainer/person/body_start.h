// A body's pose from landmarks, in closed form: where a fit starts.
#pragma once

#include <optional>

#include "nn/body/body.h"
#include "trainer/data/camera.h"
#include "trainer/data/pose.h"
#include "trainer/person/blazepose.h"

namespace doppel {

// What a picture's longer side sees where nobody says it: a phone's main camera, degrees.
inline constexpr double kGuessedAngle = 60;

// What the longer side of a picture sees through a lens that is as one of so many mm on 35 mm film,
// degrees.
double angleOfLens(double focalLength);

// A camera whose longer side sees `degrees`, with its axis through the picture's middle.
Camera cameraOfAngle(int width, int height, double degrees);

// The shape nearest to the default (in the coefficients' squares) that stands so many metres high
// in the rest pose, barefoot.
Betas betasOfHeight(const BodyModel& body, double metres);

struct BodyStart {
    Theta theta{};
    Trans trans{};        // metres, camera space
    double residual = 0;  // pixels: root mean square of the joints' distances to their landmarks
};

// A body of some shape, each bone turned to where the landmarks in space point, hinges of
// elbows and knees by the plane in which they are bent, stood where its joints best cover the
// landmarks in the picture. Where landmarks are across and down comes from the picture, how deep
// from the landmarks in space, whose scale is a guess; only directions are used.
class BodyPoser3d {
public:
    explicit BodyPoser3d(const BodyModel& body, const Betas& betas = {});
    // Landmarks as atJoints() gives them. face: FaceMesh::axes(), where the face was found; else
    // the head is tilted as the landmarks have it, and turned from the chest half as far, for they
    // exaggerate.
    BodyStart operator()(const PersonLandmarks& person, const Camera& camera,
                         const std::optional<glm::dmat3>& face = {}) const;

    // BlazePose's hips lie at the sides of the pelvis and its shoulders on the chest's front. Here
    // they are where the body's joints are: hips moved inwards and down, shoulders backwards. The
    // same person where the landmarks span no trunk.
    PersonLandmarks atJoints(const PersonLandmarks& person, const Camera& camera) const;

private:
    glm::dvec3 restTrunk() const;  // from the hips' middle to the shoulders'

    std::array<int, joint::kCount> parents_;
    std::array<glm::dvec3, joint::kCount> rest_;
};

// The landmark that shows a joint, where one does: shoulders, elbows, wrists, hips, knees, ankles.
std::optional<size_t> landmarkOfJoint(size_t joint);

// u, v in pixels and confidence, in the order of the scheme openpose25; [25][3].
std::array<float, 75> openPoseKeypoints(const PersonLandmarks& person);

}  // namespace doppel
