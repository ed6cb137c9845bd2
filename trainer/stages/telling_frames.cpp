#include "trainer/stages/telling_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include "engine/io/image.h"
#include "nn/body/joint.h"
#include "trainer/data/frame_selection.h"
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

// Sharpnesses that differ by less than this part are the same for who chooses.
constexpr double kAsSharp = .1;

// So many frames: half of them evenly taken, the others each the one that is farthest from those
// before; `left` becomes the square of the distance that the next one would have.
std::vector<size_t> spreadFrames(const PoseTable& poses, size_t count, size_t most, float& left) {
    constexpr float kTaken = -1;
    std::vector<float> apart(count, std::numeric_limits<float>::max());  // from the nearest taken
    std::vector<size_t> nearest(count), taken;
    const size_t parts = std::min(workers(), count / 4096 + 1);
    const std::vector<size_t> first = evenly(count, (most + 1) / 2);
    size_t farthest = 0;
    while (taken.size() < most) {
        const size_t next = taken.size() < first.size() ? first[taken.size()] : farthest;
        std::vector<float> fromTaken;
        for (size_t other : taken) fromTaken.push_back(poses.squareBetween(next, other));
        const size_t newest = taken.size();
        taken.push_back(next);
        apart[next] = kTaken;
        auto look = [&](size_t part) {
            const size_t end = (part + 1) * count / parts;
            size_t there = part * count / parts;
            for (size_t i = there; i < end; ++i) {
                // Half as far from its nearest one as that is from the new one: the new one is no
                // nearer.
                if (apart[i] >= 0 && (newest == 0 || fromTaken[nearest[i]] < 4 * apart[i]))
                    if (const float square = poses.squareBetween(i, next); square < apart[i]) {
                        apart[i] = square;
                        nearest[i] = newest;
                    }
                if (apart[i] > apart[there]) there = i;
            }
            return there;
        };
        inParallel(parts, look, [&](size_t part, size_t found) {
            if (part == 0 || apart[found] > apart[farthest]) farthest = found;
        });
    }
    left = std::max(0.0f, *std::ranges::max_element(apart));
    return taken;
}

// Sharpness is looked at in frames of 2,000 pixels at the most, by halves: what is learned from are
// crops of a quarter of that.
int smallerBy(const Camera& camera) {
    int by = 1;
    while (by < 8 && std::max(camera.width, camera.height) > 2048 * by) by *= 2;
    return by;
}

// The part of a frame in which the person is, and its mask [height][width], 255 the person, both in
// pixels of the smaller frame.
struct PersonBox {
    int left = 0, top = 0, width = 0, height = 0;
    std::vector<uint8_t> mask;
};

PersonBox personBox(const Picture& picture, int by) {
    const int width = (picture.width + by - 1) / by, height = (picture.height + by - 1) / by;
    const auto at = [&](int x, int y) {
        return picture.mask.empty()
                   ? uint8_t{255}
                   : picture.mask[static_cast<size_t>(y * by) * static_cast<size_t>(picture.width) +
                                  static_cast<size_t>(x * by)];
    };
    int left = width, right = 0, top = height, bottom = 0;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            if (at(x, y) == 255) {
                left = std::min(left, x);
                right = std::max(right, x + 1);
                top = std::min(top, y);
                bottom = y + 1;
            }
    PersonBox box{left, top, std::max(0, right - left), std::max(0, bottom - top), {}};
    for (int y = top; y < bottom; ++y)
        for (int x = left; x < right; ++x) box.mask.push_back(at(x, y));
    return box;
}

// Within the mask, moved by so many pixels of the smaller frame.
double sharpnessOf(const Image& grey, const PersonBox& person, glm::ivec2 moved) {
    const int left = person.left + moved.x, top = person.top + moved.y;
    return sharpness(
        person.width, person.height,
        [&](int x, int y) { return static_cast<double>(*grey.pixel(x + left, y + top)); },
        [&](int x, int y) {
            return person.mask[static_cast<size_t>(y * person.width + x)] == 255 && x + left > 0 &&
                   x + left + 1 < grey.width && y + top > 0 && y + top + 1 < grey.height;
        });
}

// By how many pixels of the smaller frame the body's origin is elsewhere in frame b than in frame
// a.
glm::ivec2 movedBetween(const Capture& capture, size_t a, size_t b, int by) {
    const auto placeIn = [&](size_t frame) {
        const Camera& camera = capture.frames[frame].camera;
        const Trans& at = capture.trans[frame];
        const double depth = std::max(1e-3, static_cast<double>(at[2]));
        return glm::dvec2(camera.fx * at[0] / depth + camera.cx,
                          camera.fy * at[1] / depth + camera.cy);
    };
    const glm::dvec2 moved = (placeIn(b) - placeIn(a)) / static_cast<double>(by);
    return glm::round(glm::clamp(moved, -1. * kMaxImageSide, 1. * kMaxImageSide));
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
    taken = spreadFrames(poses, count, most, left);
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
    // None is decoded that no neighbour could replace. Who shows the same has the same outline but
    // for where it is, so that the mask of the one in the middle does for its neighbours.
    std::vector<size_t> looked;
    for (size_t middle : taken)
        if (!neighbours(middle).empty()) looked.push_back(middle);
    // Of a frame, and of its neighbours as far as they were looked at.
    std::map<size_t, std::vector<double>> sharp;
    Progress progress("choosing frames", static_cast<int64_t>(looked.size()), kQuiet);
    shareWork(
        ranks, looked.size(),
        [&](size_t k) {
            const size_t middle = looked[k];
            const int by = smallerBy(capture.frames[middle].camera);
            const PersonBox person = personBox(*cache.loadMask(middle), by);
            std::vector<double> found{
                sharpnessOf(cache.readSmallGrey(middle, by), person, glm::ivec2(0))};
            for (size_t other : neighbours(middle)) {
                // Two that are as sharp as each other: so is the third.
                if (found.size() > 1 && std::abs(found[1] - found[0]) < kAsSharp * found[0]) break;
                found.push_back(sharpnessOf(cache.readSmallGrey(other, by), person,
                                            movedBetween(capture, middle, other, by)));
            }
            std::vector<uint8_t> bytes(found.size() * sizeof(double));
            std::memcpy(bytes.data(), found.data(), bytes.size());
            return bytes;
        },
        [&](size_t k, std::span<const uint8_t> bytes) {
            std::vector<double>& found = sharp[looked[k]];
            found.resize(bytes.size() / sizeof(double));
            std::memcpy(found.data(), bytes.data(), bytes.size());
            progress.update(static_cast<int64_t>(k) + 1);
        });
    std::vector<bool> chosen(count);
    for (size_t i : taken) chosen[i] = true;
    for (size_t& frame : taken) {
        const std::vector<size_t> others = neighbours(frame);
        if (others.empty()) continue;
        const std::vector<double>& found = sharp.at(frame);
        size_t best = frame;
        double top = (1 + kAsSharp) * found[0];
        for (size_t n = 0; n + 1 < found.size(); ++n)
            if (!chosen[others[n]] && found[n + 1] > top) best = others[n], top = found[n + 1];
        chosen[frame] = false;
        chosen[best] = true;
        frame = best;
    }
    std::ranges::sort(taken);
    return taken;
}

}  // namespace doppel
