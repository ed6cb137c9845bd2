// Avatars for other programs: glTF, VRM, USD and OBJ, with a skinned mesh, its texture and, if
// wanted, a motion; and motions alone.
//
// Skinning has one mesh for all poses, where the mesh network refines each pose anew. What is
// exported is the one T-pose mesh that skinning brings closest to the network's in a standing pose
// and in those of the motion.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "engine/device.h"
#include "engine/io/gltf.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/formats/joint_names.h"
#include "trainer/motion/motion.h"

namespace doppel {

struct ExportSettings {
    TextureKind texture = TextureKind::Best;  // Coarse or Baked; Best is the baked one, if any
    JointNames names = JointNames::Smpl;
    bool shapes = false;          // glTF: morph targets for shape coefficients and hands
    std::string author, licence;  // of a VRM: who made it, and a licence's address; may be empty
    VrmPermissions permissions;   // of a VRM
    bool lit = false;             // glTF, VRM, USD: seen in the light of where it stands
    std::span<const Motion> furtherMotions;  // glTF: more animations, after the motion's
};

// bindVerts [V,3]: the avatar's vertices in the T-pose, body frame. The scene has the same axes
// (metres, y up, facing +z), with the ground, y = 0, under the lowest vertex.
//
// Each motion becomes an animation at the motion's fps in a world with y up (uprightRotation): what
// faced the camera faces +z, and in the first key the pelvis is above the origin and the lowest
// vertex on the ground.
//
// Hair, a skirt and what else hangs free are meshes of their own (formats/mesh_parts.h).
//
// Texels between the charts of the atlas take the colour of the nearest chart, because players
// average texels where the person is small.
//
// Shapes move the T-pose as a step of one standard deviation moves the body; the skeleton stays,
// since glTF's morph targets move vertices only. Behind them are those that curl and close the
// hands, by an amount of 1 (nn/body/fingers.h).
//
// InputError where there is no texture.
GltfScene avatarScene(const Avatar& avatar, std::span<const float> bindVerts, const Motion* motion,
                      const ExportSettings& settings = {});

// The endings that exportAvatar knows, and of those the ones that are a motion's alone.
bool isExportName(const std::filesystem::path& out);
bool isMotionFile(const std::filesystem::path& out);

// Writes the avatar to `out`, which appears whole or not at all: *.glb, *.vrm (VRM 1.0, without
// motion), *.usda (and FILE.png), *.obj (and FILE.mtl, FILE.png; of a motion its only frame, posed
// by the networks); or its motion alone, on its skeleton: *.bvh, *.npz (AMASS's), *.json. motion
// may be null, but not for those. InputError: another name, what does not go with it, no texture,
// and where the mesh network's vertices are not finite.
void exportAvatar(Device& device, const Avatar& avatar, const std::filesystem::path& out,
                  const Motion* motion, const ExportSettings& settings = {});

}  // namespace doppel
