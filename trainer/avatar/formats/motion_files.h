// Motions for other programs, of an avatar's own skeleton: BVH, AMASS's npz, JSON.
#pragma once

#include <filesystem>

#include "engine/io/gltf.h"

namespace doppel {

// Each takes a scene's skeleton and animation, which it has to have: metres, y up, joints in SMPL's
// order, whose rest pose has no rotations. Files appear whole or not at all.

// Centimetres and degrees; the root's place and rotations about z, x, y of each joint, each angle
// as near to the one before as there is one.
void writeBvh(const std::filesystem::path& out, const GltfScene& scene);

// As AMASS has SMPL+H: poses [F,156], 22 joints' axis-angle and fingers at rest; trans [F,3], for
// bodies whose pelvis rests where SMPL's does; betas [16], zeros, for ours mean nothing to SMPL;
// gender, mocap_framerate. z up.
void writeAmass(const std::filesystem::path& out, const GltfScene& scene);

// One object: fps, up, joints, parents, rest [J][3] and frames, each with translation [3], the
// root's place, and rotations [J][4], quaternions x y z w relative to the parent.
void writePosesJson(const std::filesystem::path& out, const GltfScene& scene);

}  // namespace doppel
