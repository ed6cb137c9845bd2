// An avatar: a body, the networks that make it a person, and its texture; on disk a folder:
//
//     avatar.toml               name, seed, preset, every number of the run, where it came from,
//                               and the light of the capture
//     body.npz                  the body model, the person's betas and, once stage "shape" is
//                               done, her offsets [V,3] beyond the model; once stage "caps" has
//                               found hair or loose cloth, that at the end of the model's arrays
//     poses.npz                 the training frames' poses as training left them
//                               (trainer/avatar/training_poses.h)
//     texels.png                once stage "texels" is done: the texture that networks paint over
//     texels_seen.png           beside it: where its first colours came from, white where frames
//                               show the person (trainer/stages/back_projection.h)
//     mesh_net.safetensors      once stage "mesh" is done
//     texture_net.safetensors   once stage "texture" is done
//     texture.png               the atlas as the texture network paints it for all sides
//     refine_net.safetensors    once stage "refine" is done
//     texture_baked.png         the refined textures of many views, merged
//     preview.png
//     checkpoints/, log/        training state, while a run is unfinished, and curves
//     .doppel-files             what Doppel wrote here (trainer/data/output_folder.h)
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "engine/io/safetensors.h"
#include "nn/body/body.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/pose.h"

namespace doppel {

struct Avatar {
    BodyModel body;
    Npz bodyArrays;  // what body.npz holds, as it was read
    Betas betas{};
    Preset preset;
    std::map<std::string, std::string> provenance;
    // Of each stage that is done, all that its result depends on but the pictures.
    std::map<std::string, std::map<std::string, std::string>> trained;
    WeightMap meshNet, textureNet, refineNet;  // empty: that stage has not been trained
    int textureSize = 0;
    // [size,size,3] sRGB-encoded in [0,1]; empty: none yet.
    std::vector<float> texels, texture, bakedTexture;
    std::vector<uint8_t> texelsSeen;  // [size,size] beside texels, TexelOrigin
    // L [8,3] of the light that the frames were recorded under (nn/steps/light.h), which the
    // textures are free of; empty: they show it.
    std::vector<float> light;

    // Forgets what stage "refine" made, as when the stages before it are trained again.
    void clearRefinement() {
        refineNet.clear();
        bakedTexture.clear();
        trained.erase("refine");
    }
};

// Which texture an avatar is drawn with. Coarse: stage 2's. Refined: what stage 3 makes of it for
// the view at hand. Baked: the refined textures of many views merged into one, for programs that
// take a texture only.
enum class TextureKind { Best, Coarse, Refined, Baked };
// "best" (refined where there is one, else coarse), "coarse", "refined", "baked". InputError naming
// `where` for another word.
TextureKind textureKind(std::string_view word, std::string_view where = "--texture");
// InputError, naming the avatar's folder and what to train, where it has no such texture.
void requireTexture(const Avatar& avatar, TextureKind kind, const std::filesystem::path& folder);

// Gives the avatar's body these offsets [V,3]; empty: none.
void setOffsets(Avatar& avatar, const std::vector<float>& offsets);

Avatar readAvatar(const std::filesystem::path& folder);
// Creates or updates the folder; each file appears whole or not at all. Files of networks that the
// avatar does not have are removed. InputError as claimAvatar's.
void writeAvatar(const std::filesystem::path& folder, const Avatar& avatar);

// Makes the folder and takes all names in it that an avatar and its training write. InputError,
// before anything is changed, where one of them is somebody else's file.
void claimAvatar(const std::filesystem::path& folder);

// Where an unfinished run leaves its present state, as an avatar, whenever it draws a picture of
// it; it appears whole each time, and goes with the run's end.
std::filesystem::path liveFolder(const std::filesystem::path& avatar);
void writeLiveAvatar(const std::filesystem::path& out, const Avatar& avatar);

// "default", "default-full" (of assets/body), or an .npz, or SMPL's .pkl.
Npz readBodyArrays(const std::string& body);
// The file among these; empty for those of assets/body.
std::filesystem::path bodyFile(const std::string& body);

}  // namespace doppel
