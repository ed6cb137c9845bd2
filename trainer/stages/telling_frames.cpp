#include "trainer/stages/telling_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <glm/gtc/quaternion.hpp>

#include "nn/body/joint.h"
#include "trainer/data/progress.h"
#include "trainer/data/sharpness.h"

namespace doppel {

namespace {

constexpr size_t kNumbers = 9 * kJointCount;

// How much a joint's rotation changes what is seen: the root's turns all of the person, and hands
// and feet are few pixels.
float seenOf(size_t j) {
    if (j == 0) return 3;
    for (size_t small : {joint::kLeftWrist, joint::kRightWrist, joint::kLeftFoot, joint::kRightFoot,
                         joint::kLeftHand, joint::kRightHand})
        if (j == small) return .3f;
    return 1;
}

// Rotation matrices, weighted: distances between these are distances between poses.
std::vector<float> posesOf(const Capture& capture) {
    std::vector<float> poses;
    poses.reserve(kNumbers * capture.size());
    for (const Theta& theta : capture.theta)
        for (size_t j = 0; j < size_t{kJointCount}; ++j) {
            const glm::vec3 axis(theta[3 * j], theta[3 * j + 1], theta[3 * j + 2]);
            const float angle = glm::length(axis);
            const glm::mat3 rotation =
                angle > 0 ? glm::mat3_cast(glm::angleAxis(angle, axis / angle)) : glm::mat3(1);
            for (int c = 0; c < 3; ++c)
                for (int r = 0; r < 3; ++r) poses.push_back(seenOf(j) * rotation[c][r]);
        }
    return poses;
}

float squareBetween(const std::vector<float>& poses, size_t a, size_t b) {
    const float *x = &poses[a * kNumbers], *y = &poses[b * kNumbers];
    float square = 0;
    for (size_t k = 0; k < kNumbers; ++k) square += (x[k] - y[k]) * (x[k] - y[k]);
    return square;
}

// Within the mask.
double sharpnessOf(const Picture& picture) {
    auto at = [&](int x, int y) { return static_cast<size_t>(y * picture.width + x); };
    return sharpness(
        picture.width, picture.height,
        [&](int x, int y) {
            const uint8_t* p = &picture.rgb[3 * at(x, y)];
            return (p[0] + 2 * p[1] + p[2]) / 4.0;
        },
        [&](int x, int y) { return picture.mask.empty() || picture.mask[at(x, y)] == 255; });
}

}  // namespace

std::vector<size_t> tellingFrames(const Capture& capture, FrameCache& cache, size_t most) {
    const size_t count = capture.size();
    std::vector<size_t> taken;
    if (count <= most) {
        for (size_t i = 0; i < count; ++i) taken.push_back(i);
        return taken;
    }
    const std::vector<float> poses = posesOf(capture);
    std::vector<float> apart(count, std::numeric_limits<float>::max());
    for (size_t next = 0; taken.size() < most;) {
        taken.push_back(next);
        apart[next] = -1;
        for (size_t i = 0; i < count; ++i)
            if (apart[i] >= 0) apart[i] = std::min(apart[i], squareBetween(poses, i, next));
        next = static_cast<size_t>(std::ranges::max_element(apart) - apart.begin());
    }
    // Neighbours that are a quarter as far as the frames are from each other show as much.
    const float same = std::max(0.0f, *std::ranges::max_element(apart)) / 16;
    std::vector<bool> chosen(count);
    for (size_t i : taken) chosen[i] = true;
    Progress progress("choosing frames", static_cast<int64_t>(taken.size()));
    for (size_t k = 0; k < taken.size(); ++k) {
        if (interrupted()) throw Interrupted{};
        const size_t middle = taken[k];
        size_t best = middle;
        double sharpest = sharpnessOf(*cache.load(middle));
        for (std::ptrdiff_t step : {-2, 2}) {
            const std::ptrdiff_t there = static_cast<std::ptrdiff_t>(middle) + step;
            if (there < 0 || there >= static_cast<std::ptrdiff_t>(count)) continue;
            const auto other = static_cast<size_t>(there);
            if (chosen[other] || squareBetween(poses, middle, other) > same) continue;
            if (double sharp = sharpnessOf(*cache.load(other)); sharp > sharpest)
                sharpest = sharp, best = other;
        }
        chosen[middle] = false;
        chosen[best] = true;
        taken[k] = best;
        progress.update(static_cast<int64_t>(k) + 1);
    }
    std::ranges::sort(taken);
    return taken;
}

}  // namespace doppel
