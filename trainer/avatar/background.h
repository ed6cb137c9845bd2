// The scene without the person, to put a render where the person was.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"
#include "trainer/data/shared_work.h"

namespace doppel {

// The median over time of what the masks leave uncovered; what no frame shows is filled in from
// around it. All frames of the capture have to have the same size and a mask (InputError).
class BackgroundPlate {
public:
    // Each rank decodes its part of the frames that are looked at; all get the same plate.
    BackgroundPlate(const Capture& capture, FrameCache& frames, Ranks* ranks = nullptr);

    int width() const { return width_; }
    int height() const { return height_; }
    // [H,W,3] sRGB-encoded in [0,1].
    const std::vector<float>& plate() const { return plate_; }
    // This frame's own pixels away from the person, the plate's on and next to the person.
    std::vector<float> behind(const Picture& picture) const;
    // The same in the picture itself.
    void removePerson(Picture& picture) const;

private:
    int width_ = 0, height_ = 0;
    std::vector<float> plate_;
};

// A plate for each size of frame that a capture has, as of several cameras.
class BackgroundPlates {
public:
    BackgroundPlates(const Capture& capture, FrameCache& frames, Ranks* ranks = nullptr);
    // Puts the plate on and next to the person.
    void removePerson(Picture& picture) const;

private:
    std::map<std::pair<int, int>, BackgroundPlate> bySize_;  // width, height
};

// result = rgb + (1 - mask / 255) * background: rgb is already weighted by coverage.
std::vector<float> composite(const std::vector<float>& rgb, const std::vector<uint8_t>& mask,
                             const std::vector<float>& background);

// Fills what is not known (0) with the mean of known neighbours, coarse to fine: halves until all
// is known, then comes back, bilinear. rgb [H,W,3], known [H,W].
void fillHoles(std::vector<float>& rgb, std::vector<uint8_t>& known, size_t width, size_t height);

// Grows a mask by `radius` pixels (a square).
std::vector<uint8_t> dilateMask(const std::vector<uint8_t>& mask, int width, int height,
                                int radius);

}  // namespace doppel
