// Poses that are kept, each as a file that any viewer opens: FOLDER/NAME.json (pose_text.h).
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "nn/body/body.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

struct KeptPose {
    std::string name;  // of its file, without the ending
    Pose pose;
};

class PoseLibrary {
public:
    static constexpr size_t kMost = 200;

    // An empty folder: there is none, and nothing can be kept.
    explicit PoseLibrary(std::filesystem::path folder);

    // By name. Files that are none of poses are not among them, nor more than kMost.
    const std::vector<KeptPose>& poses() const { return poses_; }
    // Under "pose 1" or the next free number; its place in poses(). InputError where there are
    // kMost of them, MachineError where it cannot be written.
    size_t keep(const Pose& pose, const Betas& betas);
    // InputError where the name is taken, or no file's.
    void rename(const std::string& name, const std::string& to);
    void forget(const std::string& name);

private:
    std::filesystem::path fileOf(const std::string& name) const;
    void read();

    std::filesystem::path folder_;
    std::vector<KeptPose> poses_;
};

// What is taken of a kept pose: how all joints are turned; the body stays where it is.
Pose withRotationsOf(const Pose& pose, const Pose& kept);

}  // namespace doppel
