#include "trainer/stages/telling_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include <glm/gtc/quaternion.hpp>

#include "nn/body/joint.h"
#include "trainer/data/pictures/sharpness.h"
#include "trainer/data/progress.h"
#include "trainer/data/shared_work.h"

namespace doppel {

namespace {

// How much a joint's rotation changes what is seen: the root's turns all of the person, and hands
// and feet are few pixels.
float seenOf(size_t j) {
    if (j == 0) return 3;
    for (size_t small : {joint::kLeftWrist, joint::kRightWrist, joint::kLeftFoot, joint::kRightFoot,
                         joint::kLeftHand, joint::kRightHand})
        if (j == small) return .3f;
    return 1;
}

// Rotations of all joints as unit quaternions [4][24], which lie side by side for the processor.
class PoseTable {
public:
    explicit PoseTable(const Capture& capture) : numbers_(kNumbers * capture.size()) {
        for (size_t j = 0; j < kJoints; ++j) weights_[j] = 8 * seenOf(j) * seenOf(j);
        for (size_t f = 0; f < capture.size(); ++f)
            for (size_t j = 0; j < kJoints; ++j) {
                const float* theta = &capture.theta[f][3 * j];
                const glm::vec3 axis(theta[0], theta[1], theta[2]);
                const float angle = glm::length(axis);
                const glm::quat q =
                    angle > 0 ? glm::angleAxis(angle, axis / angle) : glm::quat(1, 0, 0, 0);
                float* numbers = &numbers_[f * kNumbers + j];
                numbers[0] = q.w, numbers[kJoints] = q.x;
                numbers[2 * kJoints] = q.y, numbers[3 * kJoints] = q.z;
            }
    }

    // The sum over joints of the squares between their rotation matrices, weighted: between two
    // rotations that is 8 (1 - (p . q)^2).
    float squareBetween(size_t a, size_t b) const {
        const float *p = &numbers_[a * kNumbers], *q = &numbers_[b * kNumbers];
        std::array<float, kLanes> sums{};
        for (size_t j = 0; j < kJoints; j += kLanes)
            for (size_t l = 0; l < kLanes; ++l) {
                float dot = 0;
                for (size_t c = 0; c < 4; ++c)
                    dot += p[c * kJoints + j + l] * q[c * kJoints + j + l];
                sums[l] += weights_[j + l] * (1 - dot * dot);
            }
        float square = 0;
        for (float sum : sums) square += sum;
        return std::max(0.0f, square);
    }

private:
    static constexpr size_t kJoints = kJointCount, kNumbers = 4 * kJoints, kLanes = 8;
    static_assert(kJoints % kLanes == 0);
    std::vector<float> numbers_;
    std::array<float, kJoints> weights_;
};

// So many frames, each the one that is farthest from those before, beginning with the first; `left`
// becomes the square of the distance that the next one would have.
std::vector<size_t> farthestFrames(const PoseTable& poses, size_t count, size_t most, float& left) {
    constexpr float kTaken = -1;
    std::vector<float> apart(count, std::numeric_limits<float>::max());  // from the nearest taken
    std::vector<size_t> nearest(count), taken;
    const size_t parts = std::min(workers(), count / 4096 + 1);
    for (size_t next = 0; taken.size() < most;) {
        std::vector<float> fromTaken;
        for (size_t other : taken) fromTaken.push_back(poses.squareBetween(next, other));
        const size_t newest = taken.size();
        taken.push_back(next);
        apart[next] = kTaken;
        auto look = [&](size_t part) {
            const size_t end = (part + 1) * count / parts;
            size_t farthest = part * count / parts;
            for (size_t i = farthest; i < end; ++i) {
                // Half as far from its nearest one as that is from the new one: the new one is no
                // nearer.
                if (apart[i] >= 0 && (newest == 0 || fromTaken[nearest[i]] < 4 * apart[i]))
                    if (const float square = poses.squareBetween(i, next); square < apart[i]) {
                        apart[i] = square;
                        nearest[i] = newest;
                    }
                if (apart[i] > apart[farthest]) farthest = i;
            }
            return farthest;
        };
        size_t farthest = 0;
        inParallel(parts, look, [&](size_t part, size_t found) {
            if (part == 0 || apart[found] > apart[farthest]) farthest = found;
        });
        next = farthest;
    }
    left = std::max(0.0f, *std::ranges::max_element(apart));
    return taken;
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

std::vector<size_t> tellingFrames(const Capture& capture, FrameCache& cache, size_t most,
                                  Ranks* ranks) {
    const size_t count = capture.size();
    std::vector<size_t> taken;
    if (count <= most) {
        for (size_t i = 0; i < count; ++i) taken.push_back(i);
        return taken;
    }
    const PoseTable poses(capture);
    float left = 0;
    taken = farthestFrames(poses, count, most, left);
    // Neighbours that are a quarter as far as the frames are from each other show as much.
    const float same = left / 16;
    auto neighbours = [&](size_t middle) {
        std::vector<size_t> alike;
        for (std::ptrdiff_t step : {-2, 2}) {
            const std::ptrdiff_t there = static_cast<std::ptrdiff_t>(middle) + step;
            if (there < 0 || there >= static_cast<std::ptrdiff_t>(count)) continue;
            const auto other = static_cast<size_t>(there);
            if (poses.squareBetween(middle, other) <= same) alike.push_back(other);
        }
        return alike;
    };
    // Each of them is decoded once, and none that no neighbour could replace.
    std::map<size_t, double> sharp;
    for (size_t middle : taken)
        for (size_t other : neighbours(middle)) sharp[middle] = sharp[other] = 0;
    std::vector<size_t> looked;
    for (const auto& [frame, unknown] : sharp) looked.push_back(frame);
    Progress progress("choosing frames", static_cast<int64_t>(looked.size()), kQuiet);
    shareWork(
        ranks, looked.size(),
        [&](size_t k) {
            const double found = sharpnessOf(*cache.load(looked[k]));
            std::vector<uint8_t> bytes(sizeof(found));
            std::memcpy(bytes.data(), &found, sizeof(found));
            return bytes;
        },
        [&](size_t k, std::span<const uint8_t> bytes) {
            std::memcpy(&sharp[looked[k]], bytes.data(), sizeof(double));
            progress.update(static_cast<int64_t>(k) + 1);
        });
    std::vector<bool> chosen(count);
    for (size_t i : taken) chosen[i] = true;
    for (size_t& frame : taken) {
        size_t best = frame;
        for (size_t other : neighbours(frame))
            if (!chosen[other] && sharp.at(other) > sharp.at(best)) best = other;
        chosen[frame] = false;
        chosen[best] = true;
        frame = best;
    }
    std::ranges::sort(taken);
    return taken;
}

}  // namespace doppel
