// The numbers of a training run: presets `ci`, `small` and `paper`, changed by a config file and by
// flags. Names follow the symbols of Gomes et al., WACV 2022; where the authors' program differs
// from their paper, the preset `paper` takes the paper's value and the field's comment gives the
// program's.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace doppel {

// Shape, poses and positions refined by gradient descent through lbs and soft_silhouette.
struct FitPreset {
    int size = 256;                          // side of the crops, pixels
    int passes = 100;                        // over the frames; a step takes one frame
    double sigmaStart = 1e-4, sigma = 1e-5;  // squared NDC: the silhouette's rim, at first and last
    double lrTheta = 1e-2;                   // rad per step and joint; translations follow
    double lrBeta = 6e-2;                    // standard deviations per step
    double constantPart = .5;                // of the steps at full rate; then linear to zero
    double priorTheta = .002, smoothTheta = .02, priorBeta = 1e-5, keypoints = .1;  // weights
};

// Stage 1: the mesh refinement network G_m.
struct MeshPreset {
    int size = 256;  // side of the crops, pixels
    int blocks = 3, layers = 6, hidden = 128;
    double deviation = .01;  // of the first weights
    int batch = 4;
    int epochs = 20;  // over the capture's frames; steps = 0 goes by epochs
    int steps = 0;    // where > 0: this many steps, whatever the number of frames
    double lr = 1e-4, beta1 = .5, beta2 = .999, weightDecay = 1e-2;
    double constantPart = .5;        // of the steps at full lr; then linear to zero
    double sigma = 1e-5;             // program: 1e-4 in the blend, same radius
    double blurRadius = 9.21024e-5;  // squared NDC: ln(1/1e-4 − 1)·1e-5
    double laplacian = 1, normal = .5, silhouette = 1;  // λ_gl, λ_gn, and L_s's own weight
    double gradientClip = 0;       // largest gradient norm; 0: none. Program: 2
    bool dilateMask = false;       // 3×3 before the loss. Program: true
    bool balanceHeadings = false;  // draw frames evenly over 8 body headings. Program: true
    // Whose table of clamps K bounds the blocks' offsets (see clampBounds): "paper", "program", or
    // "none".
    std::string clamps = "paper";
};

// Stage 2: the coarse texture network G_TN.
struct TexturePreset {
    int size = 512;         // side of the crops, pixels
    int textureSize = 512;  // power of two
    int width = 64;         // channels d of the U-Net's first step
    int depth = 9;          // down steps; 2^depth ≤ textureSize
    int batch = 8;
    int steps = 2000;
    double lr = 2e-3, beta1 = .5, beta2 = .999, weightDecay = 1e-2;
    double constantPart = .5;
    double weight = 1;             // of L_pt. Program: 100
    double dropout = .5;           // on up steps 2 to 5
    std::string region = "union";  // B: "union" of rendered and real body; program: "intersection"
    bool constantInput = false;    // all ones in place of the visibility map. Program: true
};

// Stage 3: the texture refinement network G_RN and its discriminators. Its textures have stage 2's
// size.
struct RefinePreset {
    int size = 512;               // side of the crops, pixels
    int width = 64;               // channels d of the U-Net's first step
    int depth = 9;                // down steps; 2^depth ≤ texture.textureSize
    int discriminatorWidth = 64;  // channels d of the discriminators
    int faceSize = 80;            // side of the face discriminator's crops, pixels
    int batch = 8;
    int epochs = 40;  // over the capture's frames; steps = 0 goes by epochs
    int steps = 0;    // where > 0: this many steps, whatever the number of frames
    double lr = 2e-4, lrDiscriminator = 2e-5;
    double beta1 = .5, beta2 = .999, weightDecay = 1e-2;
    double constantPart = .5;  // of the steps at full rates; then linear to zero. Program: 0
    double dropout = .5;       // on up steps 2 to 5
    std::string loss = "log";  // "log": log-likelihood; program: "squares", least squares
    double adversarial = 1;    // weight of each adversarial loss
    double reconstruction = 100, misaligned = 100;  // α1, α2
    bool imageDiscriminator = true, faceDiscriminator = true;
    std::string region = "union";  // B, as in stage 2. Program: "intersection"
    // Pictures for the discriminators: frame and render in "region" B, or each in its "own"
    // silhouette, as the program has it.
    std::string masks = "region";
    // C: where the silhouettes are "different"; program: what is "rendered" but not real.
    std::string apart = "different";
    // "clamped": x_p + y/2 within [0,1]; program: "program", (1 + x_p + y)/2.
    std::string residual = "clamped";
    bool balanceHeadings = false;  // draw frames evenly over 8 body headings. Program: true
};

struct Preset {
    std::string name;
    FitPreset fit;
    MeshPreset mesh;
    TexturePreset texture;
    RefinePreset refine;
};

// "ci" (a minute or so, for demo and tests), "small" (an evening on a CPU), "paper". InputError
// that lists them for another name.
Preset presetByName(std::string_view name);
const std::vector<std::string>& presetNames();

// Every number as text under its dotted name, in order: {"mesh.batch", "4"}.
std::vector<std::pair<std::string, std::string>> presetValues(const Preset& preset);

// Sets one of them: ("mesh.batch", "8"). InputError for an unknown name (it lists the near ones), a
// value of another type, or one out of its range; `where` says whose it is ("--set", "run.toml").
void setPresetValue(Preset& preset, std::string_view name, std::string_view value,
                    std::string_view where);

// What must hold between the numbers (2^depth fits the texture). InputError.
void checkPreset(const Preset& preset, std::string_view where);

}  // namespace doppel
