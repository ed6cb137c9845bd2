// An avatar: a body, the networks that make it a person, and its texture; on disk a folder:
//
//     avatar.toml               name, seed, preset, every number of the run, where it came from
//     body.npz                  the body model, and the person's betas
//     mesh_net.safetensors      once stage "mesh" is done
//     texture_net.safetensors   once stage "texture" is done
//     texture.png               the atlas as the texture network paints it for all sides
//     preview.png
//     checkpoints/, log/        training state, while a run is unfinished, and curves
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/io/safetensors.h"
#include "nn/body.h"
#include "nn/graph.h"
#include "trainer/body_render.h"
#include "trainer/capture.h"
#include "trainer/preset.h"

namespace doppel {

using WeightMap = std::map<std::string, Tensor32>;  // by parameter name

struct Avatar {
    BodyModel body;
    Npz bodyArrays;  // what body.npz holds, as it was read
    Betas betas{};
    Preset preset;
    std::map<std::string, std::string> provenance;
    WeightMap meshNet, textureNet;  // empty: that stage has not been trained
    int textureSize = 0;
    std::vector<float> texture;  // [size,size,3] sRGB-encoded in [0,1]; empty: none yet
};

Avatar readAvatar(const std::filesystem::path& folder);
// Creates or updates the folder; each file appears whole or not at all. Files of networks that the
// avatar does not have are removed.
void writeAvatar(const std::filesystem::path& folder, const Avatar& avatar);

// "default", "default-full" (of assets/body), or an .npz, or SMPL's .pkl.
Npz readBodyArrays(const std::string& body);

// Poses an avatar and draws it: pose in, mesh, texture, picture out.
class AvatarRenderer {
public:
    // refined: false leaves the mesh network out.
    AvatarRenderer(Device& device, const Avatar& avatar, bool refined = true);
    ~AvatarRenderer();

    // [V,3] in camera space, metres.
    std::vector<float> vertices(const Theta& theta, const Trans& trans);
    // The texture for this view: the avatar's own, or the network's for what faces the camera.
    const std::vector<float>& texture(std::span<const float> verts);
    Drawing draw(const Theta& theta, const Trans& trans, const Camera& camera, int samples = 1);
    std::vector<uint8_t> mask(const Theta& theta, const Trans& trans, const Camera& camera);

private:
    struct MeshRecording;
    struct TextureRecording;
    Device& device_;
    const Avatar& avatar_;
    std::unique_ptr<MeshRecording> mesh_;
    std::unique_ptr<TextureRecording> textureRecording_;
    MeshDrawer drawer_;
    std::vector<float> texture_;
};

}  // namespace doppel
