#include "trainer/training_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <glm/gtc/quaternion.hpp>

namespace doppel {

namespace {

uint8_t toByte(float value) {
    return static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
}

std::vector<float> toFloats(const std::vector<uint8_t>& bytes) {
    std::vector<float> values(bytes.size());
    std::ranges::transform(bytes, values.begin(),
                           [](uint8_t b) { return static_cast<float>(b) / 255.0f; });
    return values;
}

}  // namespace

TrainingFrames::TrainingFrames(Device& device, const BodyModel& body, const Capture& capture,
                               FrameCache& cache, int size, bool colours, double margin)
    : size_(size) {
    capture.requireMasks();
    BodyPoser poser(device, body);
    for (size_t i = 0; i < capture.size(); ++i) {
        PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], capture.betas);
        const Frame& frame = capture.frames[i];
        CropBox box = cropBox(frame.camera, posed.joints, "frame " + frame.name);
        box.half *= margin;
        Crop cut = crop(*cache.load(i), frame.camera, box, size);
        cameras_.push_back(cut.camera);
        boxes_.push_back(box);
        std::ranges::transform(cut.mask, std::back_inserter(masks_.emplace_back()), toByte);
        if (colours)
            std::ranges::transform(cut.image, std::back_inserter(images_.emplace_back()), toByte);
    }
}

std::vector<float> TrainingFrames::mask(size_t frame) const { return toFloats(masks_[frame]); }
std::vector<float> TrainingFrames::image(size_t frame) const { return toFloats(images_[frame]); }

FrameSampler::FrameSampler(size_t count, uint64_t seed, std::vector<double> weights)
    : state_(seed), order_(count) {
    CHECK(count > 0, "there are frames to draw");
    std::iota(order_.begin(), order_.end(), size_t{0});
    position_ = count;
    if (!weights.empty()) {
        CHECK(weights.size() == count, "a weight for every frame");
        std::partial_sum(weights.begin(), weights.end(), std::back_inserter(cumulative_));
    }
}

uint64_t FrameSampler::random() {  // SplitMix64
    uint64_t x = state_ += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

size_t FrameSampler::next() {
    if (!cumulative_.empty()) {
        double at = static_cast<double>(random() >> 11) * 0x1p-53 * cumulative_.back();
        auto found = std::ranges::upper_bound(cumulative_, at);
        return std::min(static_cast<size_t>(found - cumulative_.begin()), order_.size() - 1);
    }
    if (position_ == order_.size()) {
        for (size_t i = order_.size() - 1; i > 0; --i)
            std::swap(order_[i], order_[random() % (i + 1)]);
        position_ = 0;
    }
    return order_[position_++];
}

std::vector<double> headingWeights(const Capture& capture) {
    std::vector<size_t> bins;
    std::array<double, 8> population{};
    for (const Theta& theta : capture.theta) {
        glm::dvec3 v(theta[0], theta[1], theta[2]);
        double angle = glm::length(v);
        glm::dquat q = angle > 0 ? glm::angleAxis(angle, v / angle) : glm::dquat(1, 0, 0, 0);
        glm::dvec3 front = q * glm::dvec3(0, 0, 1);
        double heading = std::atan2(front.x, front.z) / 6.283185307179586 + 0.5;  // [0, 1]
        bins.push_back(std::min<size_t>(static_cast<size_t>(heading * 8), 7));
        population[bins.back()] += 1;
    }
    std::vector<double> weights;
    for (size_t bin : bins) weights.push_back(1 / population[bin]);
    return weights;
}

double scheduledRate(double rate, double constantPart, int64_t step, int64_t steps) {
    double done = static_cast<double>(step) / static_cast<double>(steps);
    if (done < constantPart) return rate;
    return rate * (1 - done) / (1 - constantPart);
}

}  // namespace doppel
