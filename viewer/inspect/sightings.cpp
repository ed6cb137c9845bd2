#include "viewer/inspect/sightings.h"

#include <chrono>
#include <cmath>

#include "trainer/data/body_render.h"

namespace doppel {

Sightings sightingsOf(Device& device, const Avatar& avatar, std::span<const TrainedFrame> frames,
                      std::span<const Camera> cameras, const SurfacePoint& point,
                      const std::stop_token& stop) {
    constexpr double kHidden = .01;  // metres: of the surface itself nothing is before it
    const std::vector<int32_t>& faces = avatar.body.faces;
    BodyPoser poser(device, avatar.body);
    Sightings found;
    double most = 0;
    for (const TrainedFrame& trained : frames) {
        if (stop.stop_requested()) break;
        ++found.frames;
        const Camera& camera = cameras[trained.frame];
        const PosedMesh posed = poser.pose(trained.theta, trained.trans, avatar.betas);
        const glm::dvec3 place = placeOf(point, posed.verts, faces);
        const glm::dvec3 normal = normalOf(point.face, posed.verts, faces);
        const double distance = glm::length(place);
        const double facing = -glm::dot(normal, place) / glm::length(normal);
        if (!(place.z > 0) || !(facing > 0)) continue;
        const auto [u, v] = camera.project({place.x, place.y, place.z});
        if (u < 0 || v < 0 || u >= camera.width || v >= camera.height) continue;
        const glm::dvec3 ray = place / distance;
        const auto hit = nearestHit(posed.verts, faces, glm::dvec3(0), ray);
        if (hit && hit->distance < distance - kHidden) continue;
        ++found.seen;
        // Per square metre of the surface, as the picture's plane shows it.
        const double pixels = facing * camera.fx * camera.fy / std::pow(place.z, 3);
        if (pixels <= most) continue;
        most = pixels;
        found.best = trained.frame;
    }
    return found;
}

SightingSearch::SightingSearch(DeviceOptions device, std::shared_ptr<const Avatar> avatar,
                               std::vector<TrainedFrame> frames, std::vector<Camera> cameras,
                               const SurfacePoint& point)
    : found_(std::async(
          std::launch::async,
          [device = std::move(device), avatar = std::move(avatar), frames = std::move(frames),
           cameras = std::move(cameras), point, stop = stop_.get_token()] {
              Device own(device);
              return sightingsOf(own, *avatar, frames, cameras, point, stop);
          })) {}

bool SightingSearch::busy() const {
    return found_.valid() && found_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
}

}  // namespace doppel
