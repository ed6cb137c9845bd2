#include "viewer/picture/floor.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

constexpr double kSquare = .5;                // metres between lines; every second is stronger
constexpr double kFull = 1.2, kFar = 3;       // metres from the centre between which lines fade
constexpr double kStrong = .5, kFaint = .25;  // of a line's opacity

// How much of a pixel a line covers that is this far from its middle, both in pixels.
double coverage(double distance, double line) {
    return std::clamp(line / 2 + .5 - distance, 0., 1.) * std::min(line, 1.);
}

// Lines at whole multiples of the square along one axis of the floor. at: metres; step: metres of
// that axis from a pixel to the next.
double lineAt(double at, double step, double line) {
    const double nearest = std::round(at / kSquare);
    const bool strong = std::fmod(std::abs(nearest), 2) < .5;
    // Where squares are hardly wider than pixels their lines would be noise.
    const double shown = std::clamp(kSquare / (4 * step) - .5, 0., 1.);
    return (strong ? kStrong : kFaint) * shown *
           coverage(std::abs(at - nearest * kSquare) / step, line);
}

uint32_t blended(uint32_t word, float shadow, double line) {
    double rgb[3];
    for (int c = 0; c < 3; ++c) rgb[c] = (word >> 8 * c & 0xff) * double{1 - shadow};
    const double grey = .3 * rgb[0] + .6 * rgb[1] + .1 * rgb[2];
    const double ink = grey > 110 ? 0 : 255;
    uint32_t result = word & 0xff000000u;
    for (int c = 0; c < 3; ++c)
        result |= static_cast<uint32_t>(std::lround(rgb[c] + line * (ink - rgb[c]))) << 8 * c;
    return result;
}

}  // namespace

Ground asGround(const ToFloor& toFloor) {
    const glm::dvec3 up = glm::transpose(toFloor.rotation) * glm::dvec3(0, 1, 0);
    return {{up.x, up.y, up.z}, -toFloor.translation.y};
}

void paintFloor(std::span<uint32_t> picture, const Camera& camera, const ToFloor& toFloor,
                const glm::dvec2& centre, double line, std::span<const float> shadow) {
    const glm::dvec3 eye = toFloor.translation;
    if (eye.y <= 0) return;
    const auto rayAt = [&](double x, double y) {
        return toFloor.rotation *
               glm::dvec3((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
    };
    const glm::dvec3 right = rayAt(1, 0) - rayAt(0, 0), down = rayAt(0, 1) - rayAt(0, 0);
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const glm::dvec3 ray = rayAt(x + .5, y + .5);
            if (ray.y > -1e-6) continue;
            const double depth = eye.y / -ray.y;
            const glm::dvec2 place(eye.x + depth * ray.x, eye.z + depth * ray.z);
            const double away = glm::distance(place, centre);
            if (away >= kFar) continue;
            double opacity = 0;
            for (int axis = 0; axis < 2; ++axis) {
                const int k = 2 * axis;  // x and z
                // From eye + depth * ray with depth = eye.y / -ray.y.
                const double along = depth * (right[k] - ray[k] / ray.y * right.y),
                             across = depth * (down[k] - ray[k] / ray.y * down.y);
                const double step = std::max(std::hypot(along, across), 1e-9);
                opacity = std::max(opacity, lineAt(place[axis], step, line));
            }
            const double out = std::clamp((away - kFull) / (kFar - kFull), 0., 1.);
            const auto i =
                static_cast<size_t>(y) * static_cast<size_t>(camera.width) + static_cast<size_t>(x);
            picture[i] = blended(picture[i], shadow[i], opacity * (1 - out * out * (3 - 2 * out)));
        }
}

void drawFloor(std::span<uint32_t> picture, const Camera& camera, const ViewTransform& view,
               const RigidMotion& toFloor, const glm::dvec3& pelvis, double line,
               std::span<const FloorBody> bodies) {
    ToFloor seen;
    seen.rotation = toFloor.rotation * glm::transpose(view.rotation);
    seen.translation = toFloor.translation - seen.rotation * view.translation;
    const glm::dvec3 centre = toFloor.rotation * pelvis + toFloor.translation;
    std::vector<float> shadow(picture.size());
    for (const FloorBody& body : bodies) {
        const std::vector<float> own =
            contactShadow(body.verts, body.faces, asGround(seen), camera);
        // What is left of the light is what the one and the other leave.
        for (size_t i = 0; i < shadow.size(); ++i) shadow[i] = 1 - (1 - shadow[i]) * (1 - own[i]);
    }
    paintFloor(picture, camera, seen, {centre.x, centre.z}, line, shadow);
}

}  // namespace doppel
