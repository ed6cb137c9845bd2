// In which of its training frames a point of the avatar's surface is seen.
#pragma once

#include <future>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/training_poses.h"
#include "viewer/inspect/surface_point.h"

namespace doppel {

struct Sightings {
    size_t frames = 0, seen = 0;  // how many were looked at, and show the point
    // Of TrainedFrame::frame: where a piece of the surface there covers the most pixels.
    std::optional<size_t> best;
};

// By the poses that training found and the frames' cameras, one per frame of the motion: the point
// is inside the picture, faces the camera, and nothing of the body is before it. Whether anything
// else is before it, no pose tells. Ends early, with what there is, once it is asked to stop.
Sightings sightingsOf(Device& device, const Avatar& avatar, std::span<const TrainedFrame> frames,
                      std::span<const Camera> cameras, const SurfacePoint& point,
                      const std::stop_token& stop = {});

// The same in the background, with a device of its own.
class SightingSearch {
public:
    SightingSearch(DeviceOptions device, std::shared_ptr<const Avatar> avatar,
                   std::vector<TrainedFrame> frames, std::vector<Camera> cameras,
                   const SurfacePoint& point);
    ~SightingSearch() { stop_.request_stop(); }
    SightingSearch(const SightingSearch&) = delete;
    SightingSearch& operator=(const SightingSearch&) = delete;

    bool busy() const;
    // Waits for it; once. Throws what went wrong.
    Sightings take() { return found_.get(); }

private:
    std::stop_source stop_;
    std::future<Sightings> found_;  // last: it waits for the thread
};

}  // namespace doppel
