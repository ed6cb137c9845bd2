// What a VRM says of an avatar beside its mesh: its bones, and hair that swings.
#pragma once

#include "engine/io/gltf.h"
#include "trainer/avatar/avatar.h"

namespace doppel {

// The scene's joints as VRM's bones. Hair that falls (a part "hair" that goes down from the head by
// 6 cm or more) gets a chain of joints of its own in the scene, which hangs from the head, and
// swings without going into the upper trunk: as little as it does at rest.
GltfVrm vrmOf(const Avatar& avatar, GltfScene& scene);

}  // namespace doppel
