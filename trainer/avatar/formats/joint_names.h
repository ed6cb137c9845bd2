// What other programs call SMPL's joints.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace doppel {

// Ours, as SMPL's programs write them; VRM's bones; Mixamo's, with their prefix; Unreal Engine's.
enum class JointNames { Smpl, Vrm, Mixamo, Unreal };

// "smpl", "vrm", "mixamo" or "unreal"; InputError naming `where` for another word.
JointNames jointNamesByWord(std::string_view word, std::string_view where);

// SMPL's hands are where fingers begin, and have the names of the middle finger's first bone.
std::string jointNameFor(JointNames names, size_t joint);

}  // namespace doppel
