// A camera that goes round a point, as a mouse moves it.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "trainer/data/camera.h"
#include "viewer/picture/view_transform.h"

namespace doppel {

// Angles in radians, lengths in metres, the world as ViewTransform says. With both angles zero it
// looks along +z, as a capture's camera does; a positive pitch looks down from above.
struct OrbitCamera {
    glm::dvec3 target{0, 0, 3};
    double yaw = 0, pitch = 0, distance = 3;
    double fieldOfView = 0.66;  // of the picture's height
    // Drawn through a lens so long that what is a metre further away is smaller by 1/600, seen from
    // three metres.
    bool orthographic = false;

    ViewTransform view() const;
    Camera camera(int width, int height) const;

    // The same having gone around by so many turns, as turned() has it
    // (trainer/avatar/rendering.h).
    OrbitCamera turned(double turns) const;

    // Mouse movement in pixels of a picture with this many rows: what is near moves with the mouse.
    void orbit(double right, double down, int height);
    void pan(double right, double down, int height);
    // The same movement turns it where it stands, as a head turns.
    void look(double right, double down, int height);
    // It goes so many metres to its right, down and ahead.
    void walk(const glm::dvec3& metres);
    // > 1 goes away, < 1 comes nearer.
    void dolly(double factor);
    // The same, so that what is seen at this place stays there: pixels from the picture's middle.
    void dollyAt(double factor, double right, double down, int height);
    // Looks at these points [n,3] so that all of them are seen, from where it stands.
    void frame(std::span<const float> points, int width, int height);
};

// "yaw,pitch,distance,x,y,z,field of view[,ortho]", as `doppel view --camera` takes it; angles in
// degrees. The same camera to a millionth.
std::string cameraText(const OrbitCamera& camera);
// For other programs: {"camera": that text, "width", "height", "intrinsic" [3,3], "extrinsic"
// [4,4]} of a picture of this size, as a capture's cameras.npz has them: from the world, which is
// the capture's camera space, metres.
std::string cameraJson(const OrbitCamera& camera, int width, int height);
// Also with "--camera " before it, or that JSON. InputError where it is something else.
OrbitCamera readCameraText(std::string_view text);

// The pixel that shows a point, and its depth; the depth is not positive for one behind the camera.
glm::dvec3 projected(const glm::dvec3& world, const ViewTransform& view, const Camera& camera);
// The point that has moved by so many pixels in the plane parallel to the picture.
glm::dvec3 movedInPlane(const glm::dvec3& world, double right, double down,
                        const ViewTransform& view, const Camera& camera);

}  // namespace doppel
