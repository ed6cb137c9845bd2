// The training step of a body's own surface: what it has beyond the model's shape, its texels, and
// the frames' poses, from silhouettes and colours at once.
//
//     L = w_s L_s + w_c L_c + the priors
//
// with L_s and L_c the pyramid losses of alpha and of the colours over the background, per pixel of
// the person (nn/ops/loss.h), drawn so that edges pull (nn/ops/surface.h). The offsets [V,3] move
// the rest pose before skinning; they take smoothed steps (Nicolet, Jacobson, Jakob, Large Steps in
// Inverse Rendering of Geometry, ACM ToG 2021), and fingers bend with them, as far as all of a hand
// is curled and closed (nn/body/fingers.h). The mesh network has no part in it.
#pragma once

#include <array>
#include <vector>

#include "nn/body/body.h"
#include "nn/body/fingers.h"
#include "nn/core/numbers.h"
#include "nn/ops/optim.h"
#include "nn/ops/surface.h"
#include "nn/steps/losses.h"

namespace doppel {

#define SURFACE_NUMBERS(NUMBER, FLAG, CHOICE)                                                    \
    NUMBER(int, size, 256, 16, 4096, "side of the crops, pixels; no more than frames have")      \
    NUMBER(int, samples, 1, 1, 4, "samples of a pixel along each axis")                          \
    NUMBER(int, batch, 4, 1, 64, "frames of a step")                                             \
    NUMBER(int, steps, 0, 0, kNoLimit, "steps; 0: the stage is left out, as in the paper")       \
    NUMBER(double, coarse, 0, 0, 1, "part of them, the first, over crops of half the size")      \
    NUMBER(double, fine, 0, 0, 1,                                                                \
           "part of them, the last, for poses and texels over crops that shrink no frame")       \
    NUMBER(double, decay, .1, 1e-6, 1, "part of the rates that is left in the last step")        \
    NUMBER(double, lrTheta, .01, 1e-9, 10, "rad per step and joint")                             \
    NUMBER(double, lrTrans, .003, 0, 10, "m per step")                                           \
    NUMBER(double, lrOffsets, .04, 0, 10,                                                        \
           "m per step of the vertex that moves most, before it "                                \
           "is smoothed")                                                                        \
    NUMBER(double, lrHands, 0, 0, 10,                                                            \
           "of 1, per step, of how far hands are curled and closed; 0: as they are")             \
    NUMBER(double, ease, 0, 0, 1,                                                                \
           "how hands begin in stage shape: 0 flat and spread, 1 half closed")                   \
    NUMBER(double, lrTexels, .015, 0, 10, "of 1, per step and texel")                            \
    NUMBER(double, lrLight, 0, 0, 10, "of 1, per step, of the capture's light; 0: none learned") \
    NUMBER(double, lrGain, 0, 0, 10,                                                             \
           "of 1, per step, of a frame's exposure and white balance; 0: none learned")           \
    NUMBER(double, silhouette, 1, 0, kNoLimit, "w_s, weight of the silhouettes' loss")           \
    NUMBER(double, silhouette1, 2, 0, kNoLimit, "weight in it of single pixels")                 \
    NUMBER(double, silhouette2, 1, 0, kNoLimit, "weight in it of cells of 2 pixels a side")      \
    NUMBER(double, silhouette4, .5, 0, kNoLimit, "of 4")                                         \
    NUMBER(double, silhouette8, .25, 0, kNoLimit, "of 8")                                        \
    NUMBER(double, colour, 4, 0, kNoLimit, "w_c, weight of the colours' loss")                   \
    NUMBER(double, colour1, 1, 0, kNoLimit, "weight in it of single pixels")                     \
    NUMBER(double, colour2, .5, 0, kNoLimit, "weight in it of cells of 2 pixels a side")         \
    NUMBER(double, colour4, .5, 0, kNoLimit, "of 4")                                             \
    NUMBER(double, colour8, 0, 0, kNoLimit, "of 8")                                              \
    NUMBER(double, robust, .02, 0, 1, "difference of colours from which on outliers count less") \
    NUMBER(double, keypoints, 0, 0, kNoLimit, "weight of the keypoints' loss")                   \
    NUMBER(double, facePoints, 0, 0, kNoLimit, "weight of faces' points where they are seen")    \
    NUMBER(double, priorTheta, .05, 0, kNoLimit, "weight of staying near the given rotations")   \
    NUMBER(double, priorTrans, .5, 0, kNoLimit, "weight of staying near the given places")       \
    NUMBER(double, smoothTheta, 0, 0, kNoLimit, "weight of an even motion, in videos")           \
    NUMBER(int, others, 0, 0, kNoLimit,                                                          \
           "times that each of three to sixteen frames is fitted before, in each of three "      \
           "rounds, to what others show")                                                        \
    NUMBER(double, stay, .3, 0, kNoLimit, "weight of small offsets")                             \
    NUMBER(double, facing, 0, 0, 100,                                                            \
           "power of the cosine to the camera with which a pixel teaches texels")                \
    NUMBER(double, facingFace, 0, 0, 100,                                                        \
           "the same on the face by the bare body's normals, where it is greater")               \
    NUMBER(double, facingMiddle, 0, 0, 2,                                                        \
           "part of the face's extent, from its middle, that who is before it teaches")          \
    NUMBER(double, facingFew, 0, 0, 100,                                                         \
           "of three to sixteen frames the same on all of the body, where it is greater")        \
    NUMBER(int, rim, 0, 0, 64,                                                                   \
           "outermost pixels of masks, before a screen, that take the colours of the inside")    \
    NUMBER(double, stayTexels, 0, 0, kNoLimit,                                                   \
           "weight of texels near those that frames gave first, over how many frames there are") \
    NUMBER(double, seams, 0, 0, kNoLimit,                                                        \
           "weight of texels that are equal on both sides of the atlas's seams")                 \
    NUMBER(double, smooth, 500, 0, kNoLimit, "weight of smooth offsets")                         \
    NUMBER(double, hands, 1, 1, 1e6, "times as much of it on the hands")                         \
    NUMBER(double, face, 1, 1, 1e6, "times as much of it on the face")                           \
    NUMBER(double, toes, 0, 0, .1,                                                               \
           "m, within which the front of a foot moves as one; 0: each toe for itself")           \
    FLAG(cleanHands, false,                                                                      \
         "texels of the hands that have another thing's colour take the hands'")                 \
    NUMBER(double, folds, 1, 0, kNoLimit, "weight of faces that keep their side and an area")    \
    NUMBER(double, lambda, 10, 0, 1e4, "how far a step of the offsets is smoothed, edges squared")
struct SurfacePreset {
    NUMBERS(SURFACE_NUMBERS)
};

// What is there, and what of it may change.
struct SurfaceStart {
    std::vector<float> poses;  // [frames, kPoseRow]
    std::array<float, 10> betas{};
    std::vector<float> offsets;  // [V,3]; empty: none yet
    std::vector<float> texels;   // [size,size,3]; empty: silhouettes alone
    int textureSize = 0;
    std::vector<float> light;  // L [8,3] (nn/steps/light.h); empty: none, or none yet
    HandAmounts hands{};       // how hands begin
    bool movesPoses = true, movesOffsets = true, movesTexels = true;
    bool video = false;      // neighbouring frames tell about each other
    bool faces = false;      // it is known where points of faces are seen
    bool keypoints = false;  // and where joints are
};

// A frame comes by seldom: shorter memories than networks have, and nothing that pulls to zero.
inline constexpr AdamWOptions kSurfaceOptimiser{.beta1 = .9f, .beta2 = .99f, .weightDecay = 0};
inline constexpr AdamWOptions kPoseOptimiser{.beta1 = .9f, .beta2 = .97f, .weightDecay = 0};
// What no frame tells of the light is zero: people who do not turn show it from one side.
inline constexpr AdamWOptions kLightOptimiser{.beta1 = .9f, .beta2 = .99f, .weightDecay = .1f};
// Hands that no frame tells of stay where they begin.
inline constexpr AdamWOptions kHandOptimiser{.beta1 = .9f, .beta2 = .99f, .weightDecay = .1f};
// How bright all frames are together, the texels say. The steps of poses are the gains' steps, so
// their memories are as long.
inline constexpr AdamWOptions kGainOptimiser{.beta1 = .9f, .beta2 = .97f, .weightDecay = .1f};

// What steps move. One state may be moved by steps over crops of several sizes, one after another.
struct SurfaceState {
    SurfaceStart start;
    float transScale;  // of corrections: metres per radian, for one rate moves both
    // texels [size,size,3]: what their mean over neighbours (nn/ops/texture.h) adds to those at the
    // start, for a picture tells nothing finer.
    Parameters corrections, offsets, texels;
    // Of nothing unless they are learned; gains less one [frames,3].
    Parameters light, gains;
    Parameters hands;         // what is added to the start's
    FingerRig fingers;        // empty where hands are not learned
    SparseMatrix toes;        // rows [V,V] by which offsets move; empty: each by itself
    std::vector<float> bare;  // [V,3] the model's template

    SurfaceState(Device& device, const BodyModel& body, SurfaceStart start,
                 const SurfacePreset& preset);

    // [V,3] What the start has of offsets beside what `toes` makes of it: steps move the rest.
    std::vector<float> unmoved() const;
    // As they are by now.
    std::vector<float> poses() const;  // [frames, kPoseRow]
    HandAmounts handValues() const;
    std::vector<float> offsetValues() const;  // [V,3], hands bent
    std::vector<float> texelValues() const;   // [size,size,3] in [0,1]
    std::vector<float> lightValues() const;   // [8,3], or empty
    std::vector<float> gainValues() const;    // [frames,3], or empty
};

// One step over a batch of frames: forward, backward and updates in one graph.
struct SurfaceStep {
    struct Sample {
        Tensor camera;             // of samples x samples as many pixels as the targets have
        Tensor mask, counts;       // [S,S]; counts: the part of a pixel that the frame shows
        Tensor scale;              // [1] one over the mask's sum
        Tensor image, background;  // [S,S,3]; empty without colours
        // [P,3] and [24,3] as keypointLoss() has them, in the camera's pixels; empty without faces
        // and keypoints
        Tensor face, joints;
    };
    Graph graph;
    Losses losses{graph};  // silhouette (L_s), colour (L_c), keypoints, face, prior, offsets,
                           // folds, texels, seams
    // Of each frame of the batch: StepParams with the frame, and the corrections of how often it
    // has come by.
    std::vector<Tensor> poseSteps;
    std::vector<Sample> samples;  // of this rank's part of the batch

    // The state outlives what the graph has under way.
    SurfaceStep(Device& device, const BodyModel& body, SurfaceState& state,
                const SurfacePreset& preset, const CompileOptions& options = {});
};

}  // namespace doppel
