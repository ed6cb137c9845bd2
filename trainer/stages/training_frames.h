// The frames of a capture as training sees them: square crops around the body.
#pragma once

#include <map>
#include <span>
#include <vector>

#include "engine/files/byte_store.h"
#include "nn/body/body.h"
#include "trainer/avatar/background.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture.h"
#include "trainer/data/pictures/crop.h"

namespace doppel {

struct TrainingFramesOptions {
    bool colours = false;
    double margin = 1;          // of the crops, times the method's box
    uint64_t memoryBudget = 0;  // of what is kept; 0: 1 GiB
    // What comparing edges and colours wants: inside(), and frames that need not shrink cut at
    // their own pixels, for sampled between them they would lose their sharpness.
    bool edges = false;
    int rim = 0;  // pixels of masks' rims that take the inside's colours, before a screen (rim.h)
    const BackgroundPlates* scene = nullptr;  // with it background() is kept as well
    Ranks* ranks = nullptr;                   // each of which decodes its part of the frames
    bool canStop = true;                      // Interrupted while they are made
};

class TrainingFrames {
public:
    // Crops around the body in its present poses. Each frame is decoded once, by one of the ranks;
    // its crop is kept as bytes, compressed without loss where all of them would take more than the
    // budget. What takes more even so is put into a file (engine/files/byte_store.h).
    TrainingFrames(Device& device, const BodyModel& body, const Capture& capture, FrameCache& cache,
                   int size, const TrainingFramesOptions& options = {});

    size_t count() const { return cameras_.size(); }
    int size() const { return size_; }
    const Camera& camera(size_t frame) const { return cameras_[frame]; }
    const CropBox& box(size_t frame) const { return boxes_[frame]; }
    std::vector<float> mask(size_t frame) const;        // [S,S] in [0,1]
    std::vector<float> image(size_t frame) const;       // [S,S,3] sRGB-encoded in [0,1]
    std::vector<float> background(size_t frame) const;  // [S,S,3] the scene without the person
    std::vector<float> inside(size_t frame) const;      // [S,S] the part of a pixel in the frame
    // What a picture's loss is counted by: one over the mask's sum. 0 where hardly anybody is to be
    // seen (a twentieth of the median's pixels): such a frame tells nothing, and by its own few
    // pixels it would count a thousandfold.
    float scale(size_t frame) const { return scales_[frame]; }

    // Makes mask() and image() of these frames ready, in place of those made ready before: what the
    // host does for the next step while the device works on this one.
    void prepare(std::span<const size_t> frames);

    bool compressed() const { return compressed_; }
    uint64_t bytesKept() const { return store_.bytesInMemory() + store_.bytesInFile(); }
    uint64_t bytesInMemory() const { return store_.bytesInMemory(); }

private:
    struct Ready {
        std::vector<float> mask, image, background, inside;
    };
    std::vector<float> unpack(size_t stored, size_t channels) const;

    int size_;
    std::vector<Camera> cameras_;
    std::vector<CropBox> boxes_;
    std::vector<float> scales_;
    bool compressed_ = false;
    ByteStore store_;
    std::vector<size_t> masks_, images_, backgrounds_, insides_;  // a frame's numbers in it
    std::map<size_t, Ready> ready_;
};

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
