// The method's networks for other programs: as ONNX, which runs as it is, and as plain tensors.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"

namespace doppel {

// Writes the networks that the avatar has into the folder, each as NAME.onnx and
// NAME.safetensors, with README.txt, which lists inputs, results and every tensor with its shape.
//
//     mesh_net     vertices [V,3] of the posed body -> refined [V,3], metres in the body's frame
//     texture_net  visibility [1,1,T,T] -> texture [1,3,T,T] in [0,1]
//     refine_net   coarse [1,3,T,T], visibility [1,1,T,T] -> texture [1,3,T,T]
//
// Statistics of the normalisations are the running ones, nothing is dropped out; what the networks
// stand on, the mesh, its bounds and the texels that are painted over, is in the files. Returns the
// networks' names, none where the avatar has none. InputError where one is not as its preset says.
std::vector<std::string> writeNetworks(const std::filesystem::path& folder, const Avatar& avatar);

}  // namespace doppel
