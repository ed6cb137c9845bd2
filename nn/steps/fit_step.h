// The training step of stage fit: shape, poses and positions of a body, refined by gradient descent
// through LBS and the soft silhouette, and through keypoints where a frame has them.
//
//     L = L_s + w_k L_keypoints + the priors of nn/ops/fit.h
#pragma once

#include <array>
#include <vector>

#include "nn/body/body.h"
#include "nn/core/numbers.h"
#include "nn/ops/optim.h"
#include "nn/ops/raster.h"
#include "nn/steps/losses.h"

namespace doppel {

// Stage fit, before the method's own.
#define FIT_NUMBERS(NUMBER, FLAG, CHOICE)                                                      \
    NUMBER(int, size, 256, 16, 4096, "side of the crops, pixels")                              \
    NUMBER(int, batch, 1, 1, 64, "frames of a step")                                           \
    NUMBER(int, passes, 100, 0, kNoLimit, "times that all frames are taken")                   \
    NUMBER(double, sigmaStart, 1e-4, 1e-9, 1, "softness of the rim at first, squared NDC")     \
    NUMBER(double, sigma, 1e-5, 1e-9, 1, "softness of the rim at last, squared NDC")           \
    NUMBER(double, lrTheta, 1e-2, 0, 10, "rad per step and joint; translations follow")        \
    NUMBER(double, lrBeta, 6e-2, 0, 10, "standard deviations per step")                        \
    NUMBER(double, constantPart, .5, 0, 1, "part of the steps at full rate; then linear to 0") \
    NUMBER(double, priorTheta, .002, 0, kNoLimit, "weight of staying near the given poses")    \
    NUMBER(double, priorFew, 0, 0, kNoLimit, "of four frames or fewer this, if it is more")    \
    NUMBER(double, smoothTheta, .02, 0, kNoLimit, "weight of an even motion, in videos")       \
    NUMBER(double, likely, 0, 0, kNoLimit, "weight of a likely pose (nn/body/likely_pose.h)")  \
    NUMBER(double, limits, 0, 0, kNoLimit, "weight of joints' limits, per squared radian")     \
    NUMBER(double, balance, 0, 0, kNoLimit, "weight of a centre of mass above the feet")       \
    NUMBER(double, priorBeta, 1e-5, 0, kNoLimit, "weight of a likely shape")                   \
    NUMBER(double, keypoints, .1, 0, kNoLimit, "weight w_k of the keypoints' loss")
struct FitPreset {
    NUMBERS(FIT_NUMBERS)
};

// [24] What it costs a joint to leave its given rotation, relative to the others: silhouettes say
// little of hands, feet and the twist of the spine, and nothing of the way a head is turned, which
// stays as it was given until colours tell.
// heads: there is a target for the head's joint, too, and the neck bends as the spine does.
std::vector<float> jointWeights(bool coloured, bool heads = false);

// The keypoint loss's scale, as part of the crop's side: joints farther off pull less.
inline constexpr float kKeypointScale = .04f;

// What is fitted: the frames' poses and the shape that they share.
struct FitStart {
    std::vector<float> poses;       // [frames, kPoseRow] as given
    std::array<float, 10> betas{};  // as given
    bool fitShape = true;           // false: betas stay as they are
    bool video = false;             // neighbouring frames tell about each other
    bool keypoints = false;         // there is a target for joints
    bool heads = false;             // and for the head's
};

// A frame comes by once in a pass: short memories, and nothing that pulls poses to zero.
inline constexpr AdamWOptions kFitOptimiser{.beta1 = 0.5f, .beta2 = 0.95f, .weightDecay = 0};

// One step over a batch of frames: forward, backward and update in one graph.
struct FitStep {
    struct Sample {
        Tensor camera, target;  // kCameraShape, [S,S]: inputs
        Tensor keypoints;       // [24,3] as keypointLoss() has it; empty without keypoints
    };
    Parameters corrections, shape;  // outlive what the graph has under way
    Graph graph;
    Losses losses{graph};  // iou_loss (L_s), prior, keypoints
    // Of each frame of the batch: StepParams with the frame, and the corrections of how often it
    // has come by. The shape goes by graph.setStep().
    std::vector<Tensor> poseSteps;
    std::vector<Sample> samples;  // of this rank's part of the batch

    FitStep(Device& device, const BodyModel& body, FitStart start, const FitPreset& preset,
            const CompileOptions& options = {});

    // As fitted so far.
    std::vector<float> poses() const;  // [frames, kPoseRow]
    std::array<float, 10> betas() const;

private:
    FitStart start_;
};

}  // namespace doppel
