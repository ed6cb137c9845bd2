// How far what was found in a clip is from what is known to be there.
#pragma once

#include <array>
#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "nn/body/body.h"
#include "trainer/data/capture.h"

namespace doppel {

using JointPlaces = std::array<glm::dvec3, joint::kCount>;  // metres, camera space

// A truth's folder, as filmHandHeld() writes it; a capture is one, too. Frames have the names of
// the masks.
struct ClipTruth {
    std::vector<std::string> names;
    std::vector<std::filesystem::path> masks;
    std::vector<JointPlaces> joints;
};

// Joints are those of poses.npz's array `joints` [F,24,3], or else of the body in its poses.
// InputErrors name the file, what was expected and what was found.
ClipTruth readClipTruth(const std::filesystem::path& folder, const BodyModel& body);

// Joints of a posed body of this shape, by the definition in nn/ops/body.h.
JointPlaces jointPlaces(const BodyModel& body, const Betas& betas, const Theta& theta,
                        const Trans& trans);

struct FrameError {
    std::string name;
    double joints = 0;   // mm: shoulders, elbows, wrists, hips, knees, ankles, from the pelvis
    double aligned = 0;  // mm: the same after the best turn, shift and scale
    double pelvis = 0;   // mm: of the pelvis itself
    std::optional<double> iou;  // of the masks; nothing where the capture has none
};

// The frames that both have, by their names, in the capture's order. InputError where there are
// none, or a mask's size differs.
std::vector<FrameError> compareWithTruth(const Capture& capture, const ClipTruth& truth,
                                         const BodyModel& body);

}  // namespace doppel
