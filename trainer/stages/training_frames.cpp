#include "trainer/stages/training_frames.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>

#include <glm/gtc/quaternion.hpp>

#include "trainer/data/progress.h"
#include "trainer/data/shared_work.h"
#include "trainer/stages/rim.h"

namespace doppel {

namespace {

uint8_t toByte(float value) {
    return static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
}

// A box of size x size of the frame's own pixels around the same place.
CropBox ownPixels(const CropBox& box, int size) {
    const double half = size / 2.0;
    return {std::round(box.centreX - half) + half, std::round(box.centreY - half) + half, half};
}

std::vector<uint8_t> deflated(const std::vector<uint8_t>& bytes) {
    uLongf size = compressBound(bytes.size());
    std::vector<uint8_t> packed(size);
    // Level 1: a fifth of the time of the usual level for a tenth more bytes.
    int status = compress2(packed.data(), &size, bytes.data(), bytes.size(), 1);
    CHECK(status == Z_OK, "a crop can be compressed");
    packed.resize(size);
    packed.shrink_to_fit();
    return packed;
}

// What ranks tell each other of a frame beside its crops.
struct KeptFrame {
    Camera camera;
    CropBox box;
    float maskSum = 0;
    std::array<uint64_t, 4> sizes{};  // of the crops' bytes, which lie behind it
};

std::vector<uint8_t> packed(KeptFrame kept, const std::array<std::vector<uint8_t>, 4>& parts) {
    for (size_t p = 0; p < parts.size(); ++p) kept.sizes[p] = parts[p].size();
    std::vector<uint8_t> bytes(sizeof(kept));
    std::memcpy(bytes.data(), &kept, sizeof(kept));
    for (const std::vector<uint8_t>& part : parts)
        bytes.insert(bytes.end(), part.begin(), part.end());
    return bytes;
}

}  // namespace

TrainingFrames::TrainingFrames(Device& device, const BodyModel& body, const Capture& capture,
                               FrameCache& cache, int size, const TrainingFramesOptions& options)
    : size_(size), store_(options.memoryBudget > 0 ? options.memoryBudget : uint64_t{1} << 30) {
    capture.requireMasks();
    uint64_t pixels = static_cast<uint64_t>(size) * static_cast<uint64_t>(size);
    uint64_t channels = 1 + (options.colours ? 3 : 0) + (options.edges ? 1 : 0);
    if (options.scene) channels += 3;
    compressed_ = pixels * channels * capture.size() >
                  (options.memoryBudget > 0 ? options.memoryBudget : uint64_t{1} << 30);
    auto keep = [&](const std::vector<float>& values) {
        std::vector<uint8_t> bytes(values.size());
        std::ranges::transform(values, bytes.begin(), toByte);
        return compressed_ ? deflated(bytes) : bytes;
    };
    // Of the frames that this rank decodes.
    std::map<size_t, CropBox> boxes;
    BodyPoser poser(device, body);
    for (size_t i = 0; i < capture.size(); ++i) {
        if (!isMine(options.ranks, i)) continue;
        PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], capture.betas);
        const Frame& frame = capture.frames[i];
        CropBox& box = boxes[i] = cropBox(frame.camera, posed.joints, "frame " + frame.name);
        box.half *= options.margin;
        if (options.edges && 2 * box.half <= size) box = ownPixels(box, size);
    }
    const bool colours = options.colours || options.scene;
    const int rim = rimBeforeScreen(capture, cache, colours ? options.rim : 0, options.ranks);
    auto make = [&](size_t i) {
        const Camera& camera = capture.frames[i].camera;
        const CropBox& box = boxes.at(i);
        std::shared_ptr<const Picture> picture = colours ? cache.load(i) : cache.loadMask(i);
        Crop cut;
        if (rim > 0) {
            Picture clean = *picture;
            clean.rgb = withoutRim(clean, rim);
            cut = crop(clean, camera, box, size);
        } else {
            cut = crop(*picture, camera, box, size);
        }
        KeptFrame kept{cut.camera, box, std::accumulate(cut.mask.begin(), cut.mask.end(), 0.0f)};
        std::array<std::vector<uint8_t>, 4> parts;
        parts[0] = keep(cut.mask);
        if (options.colours) parts[1] = keep(cut.image);
        if (options.edges) parts[2] = keep(cut.inside);
        if (options.scene) {
            Picture scene = *picture;
            options.scene->removePerson(scene);
            parts[3] = keep(crop(scene, camera, box, size).image);
        }
        return packed(kept, parts);
    };
    Progress progress("crops", static_cast<int64_t>(capture.size()), kQuiet);
    auto take = [&](size_t i, std::span<const uint8_t> bytes) {
        progress.update(static_cast<int64_t>(i) + 1);
        KeptFrame kept;
        std::memcpy(&kept, bytes.data(), sizeof(kept));
        cameras_.push_back(kept.camera);
        boxes_.push_back(kept.box);
        scales_.push_back(kept.maskSum);
        bytes = bytes.subspan(sizeof(kept));
        auto next = [&](size_t part) {
            const size_t stored = store_.add(bytes.first(kept.sizes[part]));
            bytes = bytes.subspan(kept.sizes[part]);
            return stored;
        };
        masks_.push_back(next(0));
        if (options.colours) images_.push_back(next(1));
        if (options.edges) insides_.push_back(next(2));
        if (options.scene) backgrounds_.push_back(next(3));
    };
    shareWork(options.ranks, capture.size(), make, take, options.canStop);
    std::vector<float> sorted = scales_;  // the masks' sums
    std::ranges::sort(sorted);
    const float least = std::max(1.0f, sorted.empty() ? 0 : sorted[sorted.size() / 2] / 20);
    for (float& scale : scales_) scale = scale < least ? 0 : 1 / scale;
}

std::vector<float> TrainingFrames::unpack(size_t stored, size_t channels) const {
    const size_t count = channels * static_cast<size_t>(size_) * static_cast<size_t>(size_);
    std::vector<uint8_t> bytes = store_.read(stored);
    if (compressed_) {
        std::vector<uint8_t> inflated(count);
        uLongf size = count;
        int status = uncompress(inflated.data(), &size, bytes.data(), bytes.size());
        CHECK(status == Z_OK && size == count, "a crop is as it was kept");
        bytes = std::move(inflated);
    }
    std::vector<float> values(count);
    std::ranges::transform(bytes, values.begin(),
                           [](uint8_t b) { return static_cast<float>(b) / 255.0f; });
    return values;
}

std::vector<float> TrainingFrames::mask(size_t frame) const {
    if (auto found = ready_.find(frame); found != ready_.end()) return found->second.mask;
    return unpack(masks_[frame], 1);
}

std::vector<float> TrainingFrames::image(size_t frame) const {
    if (auto found = ready_.find(frame); found != ready_.end()) return found->second.image;
    return unpack(images_[frame], 3);
}

std::vector<float> TrainingFrames::background(size_t frame) const {
    if (auto found = ready_.find(frame); found != ready_.end()) return found->second.background;
    return unpack(backgrounds_.at(frame), 3);
}

std::vector<float> TrainingFrames::inside(size_t frame) const {
    if (auto found = ready_.find(frame); found != ready_.end()) return found->second.inside;
    return unpack(insides_.at(frame), 1);
}

void TrainingFrames::prepare(std::span<const size_t> frames) {
    ready_.clear();
    for (size_t frame : frames) {
        if (ready_.contains(frame)) continue;
        Ready one{mask(frame), images_.empty() ? std::vector<float>() : image(frame),
                  backgrounds_.empty() ? std::vector<float>() : background(frame),
                  insides_.empty() ? std::vector<float>() : inside(frame)};
        ready_.emplace(frame, std::move(one));
    }
}

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

std::vector<size_t> FrameSampler::next(int count) {
    std::vector<size_t> frames;
    for (int i = 0; i < count; ++i) frames.push_back(next());
    return frames;
}

std::vector<size_t> FrameSampler::peek(int count) const { return FrameSampler(*this).next(count); }

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
