// The poses of the frames that an avatar was trained on, as training left them. In the avatar's
// folder, poses.npz: what posesOf() writes, and
//
//     given [F,75]   theta and trans of each frame as the capture had them: tells frames again
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/motion/motion.h"

namespace doppel {

// The capture's poses and shape as readPoses() takes them, and
//
//     gain [F,3]   of each frame, where they were looked for (Capture::gains)
Npz posesOf(const Capture& capture);
// Gives them to a capture of as many frames; the frames' gains are those of the file, or none.
// InputError for another number of frames or a file that is damaged.
void takePoses(const std::filesystem::path& path, Capture& capture);

// given: the capture that training was given; trained: the same frames with the poses of now.
void writeTrainingPoses(const std::filesystem::path& avatar, const Capture& given,
                        const Capture& trained);

// Gives those of the capture's frames which the avatar was trained on, told by the poses that they
// have, the poses and gains that training found. Returns how many; 0 where the avatar has none.
// InputError for a file that is damaged.
size_t takeTrainingPoses(const std::filesystem::path& avatar, Capture& capture);

// A frame of a motion that the avatar was trained on, and the pose that training found.
struct TrainedFrame {
    size_t frame;
    Theta theta;
    Trans trans;
    Gain gain;
};

// Those of the motion's frames, as it was read, told likewise; none where it is no capture.
// InputError likewise.
std::vector<TrainedFrame> trainedFrames(const std::filesystem::path& avatar, const Motion& motion);

// The capture that an avatar was trained on, with its frames that were.
struct TrainedOn {
    std::filesystem::path capture;
    std::vector<TrainedFrame> frames;
    std::vector<Camera> cameras;  // one per frame of the capture
};

// By `capture_folder` of the avatar's [source], from the avatar's folder, or else that with the
// name that `doppel avatar` gives it, beside the avatar. Nothing where none of them is a capture
// with frames that the avatar was trained on.
std::optional<TrainedOn> trainedOn(const std::filesystem::path& folder, const Avatar& avatar);
// As [source] has it.
std::string captureFolder(const std::filesystem::path& avatar,
                          const std::filesystem::path& capture);

// Gives these of the motion's frames, as it was read, the poses that training found. A frame within
// half a second of one is corrected as that is, and between two of them by what lies between their
// corrections: joint by joint the rotation that leads from the given pose to the found one, and the
// way.
void takeTrainingPoses(std::span<const TrainedFrame> known, Motion& motion);

}  // namespace doppel
