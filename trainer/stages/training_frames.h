// The frames of a capture as training sees them: square crops around the body.
#pragma once

#include <map>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "trainer/avatar/background.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture.h"
#include "trainer/data/crop.h"

namespace doppel {

class TrainingFrames {
public:
    // Crops around the body in its present poses, `margin` times as large as the method's box.
    // Each frame is decoded once; its crop stays in memory as bytes, compressed without loss where
    // all of them would take more than memoryBudget (0: 1 GiB).
    // With a plate, what is behind the person is kept as well, and a frame that need not shrink is
    // cut at its own pixels: sampled between them it would lose its sharpness.
    TrainingFrames(Device& device, const BodyModel& body, const Capture& capture, FrameCache& cache,
                   int size, bool colours, double margin = 1, uint64_t memoryBudget = 0,
                   const BackgroundPlate* plate = nullptr);

    size_t count() const { return cameras_.size(); }
    int size() const { return size_; }
    const Camera& camera(size_t frame) const { return cameras_[frame]; }
    const CropBox& box(size_t frame) const { return boxes_[frame]; }
    std::vector<float> mask(size_t frame) const;   // [S,S] in [0,1]
    std::vector<float> image(size_t frame) const;  // [S,S,3] sRGB-encoded in [0,1]
    // [S,S,3] the scene without the person; needs a plate.
    std::vector<float> background(size_t frame) const;
    std::vector<float> inside(size_t frame) const;  // [S,S] the part of a pixel in the frame

    // Makes mask() and image() of these frames ready, in place of those made ready before: what the
    // host does for the next step while the device works on this one.
    void prepare(std::span<const size_t> frames);

    bool compressed() const { return compressed_; }
    uint64_t bytesKept() const;

private:
    struct Ready {
        std::vector<float> mask, image, background;
    };
    std::vector<float> unpack(const std::vector<uint8_t>& bytes, size_t count) const;

    int size_;
    std::vector<Camera> cameras_;
    std::vector<CropBox> boxes_;
    bool compressed_ = false;
    std::vector<std::vector<uint8_t>> masks_, images_, backgrounds_, insides_;
    std::map<size_t, Ready> ready_;
};

// A mask's sum, 1 at least: what a picture's loss is counted by.
float personPixels(std::span<const float> mask);

// Frame numbers in random order, each once per round; the same for the same seed. Where weights
// are given, frames are drawn with replacement in their proportion.
class FrameSampler {
public:
    FrameSampler(size_t count, uint64_t seed, std::vector<double> weights = {});
    size_t next();
    std::vector<size_t> next(int count);
    // What the next so many will be.
    std::vector<size_t> peek(int count) const;

private:
    uint64_t random();
    uint64_t state_;
    std::vector<size_t> order_;
    std::vector<double> cumulative_;
    size_t position_ = 0;
};

// Weights inverse to the population of eight bins of body heading, so that all sides are seen
// alike.
std::vector<double> headingWeights(const Capture& capture);

// Learning rate: full for the first part of the steps, then linear to zero. step counts from 0.
double scheduledRate(double rate, double constantPart, int64_t step, int64_t steps);

}  // namespace doppel
