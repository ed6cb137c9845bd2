// What is edited: poses over time, as keys alone or as a layer of keys over a motion.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "trainer/motion/motion.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

struct Keyframe {
    double time = 0;  // frames of the timeline; need not be whole
    Pose pose;        // the whole of it, as it is seen at this time
    bool operator==(const Keyframe&) const = default;
};

constexpr double kLargestTime = 1e7;   // frames, of a key
constexpr double kSameTime = 1e-6;     // frames within which two keys are one
constexpr double kLongestFade = 1000;  // frames

// How keys change a motion that is under them.
struct Layer {
    enum class Blend {
        Add,      // by what a key changes at its time: the joint goes on moving as in the motion
        Override  // to the key's own rotations and place, where it changes them: the joint is held
    };
    double fade = 12;  // frames before a key in which its change comes, and after it goes
    Blend blend = Blend::Add;
    bool operator==(const Layer&) const = default;
};

struct Take {
    std::shared_ptr<const Motion> motion;  // null: none
    std::vector<Keyframe> keys;            // in the order of time
    Layer layer;                           // over a motion
    Pose pose;                             // what is seen where there is neither motion nor key
    Betas betas{};

    bool timed() const { return motion || !keys.empty(); }
};

// The motion's pose at this time: of the frame that has begun, the first and last beyond the ends.
Pose motionPose(const Motion& motion, double time);

// What is seen at this time.
//
// Without a motion rotations go the short way between keys at an even pace and places straight;
// before the first key and after the last, those. Over a motion a key is what it changes there:
// each joint's turn in its parent's frame, the pelvis's in its own, and the place; or, where the
// layer overrides, how those joints are turned and where the pelvis is. That fades in and out
// within `layer.fade` frames of the key by a smooth step, and goes over into the next key's where
// that is nearer. So the pose at a key's time is the key's to the last bit, and the motion's own
// beyond the fades, as it always is for joints that no key changes.
Pose poseAt(const Motion* motion, std::span<const Keyframe> keys, const Layer& layer, double time);
Pose poseAt(const Take& take, double time);

// ---- files --------------------------------------------------------------------------------------

// A poses.npz (docs/formats.md) of what is seen: the motion's frames with the layer in them, and
// beside them the motion and the keys, so that readTake() gives the take again; keys alone as one
// row each, with key_times [K]; or the one pose. fps: the timeline's frames per second. Whole or
// not at all. InputError where fps is none.
void writeTake(const std::filesystem::path& out, const Take& take, double fps);

// The take that writeTake() left in a file; null where it has no keys, so is a motion like any
// other. InputErrors name the file and the array: all that readMotion() refuses, times that do not
// grow, counts that disagree, numbers that are not finite.
std::optional<Take> readTake(const std::filesystem::path& file);

}  // namespace doppel
