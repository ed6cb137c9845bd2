// Captures: recorded sequences of one person, with masks and SMPL poses.
//
// On disk a capture is a folder:
//
//     images/NAME.png|jpg      the frames, all of cameras.npz's size
//     masks/NAME.png           optional: where the person is (> 0), the size of the frame
//     cameras.npz              intrinsic [3,3] or [F,3,3], extrinsic [4,4] or [F,4,4] (optional:
//                              identity), height, width (0-d or [F])
//     poses.npz                betas [10], global_orient [F,3], body_pose [F,69], transl [F,3]
//     keypoints.npy            optional: [F,K,3], u, v in pixels and confidence
//     faces.npy                optional: [F,468,3], u, v in pixels and confidence of points of
//                              the face (trainer/person/face.h)
//     capture.toml             optional: name, actor and motion (of a capture in a collection, see
//                              findCaptures), fps, frames (the names in order), [keypoints]
//                              scheme, [source] how it was made
//     landmarks.npz            of a clip: what networks saw of the person (docs/formats.md)
//
// Without capture.toml the frames are the files of images/ in the order of the numbers in their
// names. In memory poses are always in camera space: an extrinsic is folded into them on reading.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/data/camera.h"
#include "trainer/data/pose.h"

namespace doppel {

struct Frame {
    std::string name;  // of its files, without extension
    std::filesystem::path image;
    std::optional<std::filesystem::path> mask;
    Camera camera;
};

// Who found keypoints is [source] keypoints: an import's own network, which comes behind this.
// Others see ears and eyes in places of their own.
inline constexpr std::string_view kOwnKeypoints = "blazepose ";

struct Keypoints {
    std::string scheme;         // "openpose25" or "lsp19"
    int count = 0;              // K
    std::vector<float> values;  // [F][K][3]: u, v (pixels), confidence (0: not seen)
};

// The SMPL joint that each keypoint of a scheme shows, or −1 where none does (eyes, toes' tips, and
// the mid-points that SMPL's joints only come near). InputError for an unknown scheme.
std::span<const int> keypointJoints(std::string_view scheme);
// Its numbers of nose, left eye, right eye, left ear and right ear. InputError likewise.
std::array<size_t, 5> keypointFace(std::string_view scheme);

// Where points of a face (kFacePoints, nn/body/joint.h) are seen: u, v (pixels), confidence (0: not
// seen). Empty where no face was found.
using SeenFace = std::vector<std::array<float, 3>>;

// What a frame's exposure and white balance make of colours that are encoded as sRGB: factors of
// red, green and blue.
using Gain = std::array<float, 3>;
inline constexpr float kLeastGain = .1f, kMostGain = 10;

struct Capture {
    std::filesystem::path folder;
    std::string name;
    std::string actor, motion;  // who is seen, doing what; empty: not said
    double fps = 30;
    std::vector<Frame> frames;
    Betas betas{};
    std::vector<Theta> theta;  // per frame; theta[0..2] turns the body into camera space
    std::vector<Trans> trans;  // per frame, camera space: v_cam = R(θ0)(v − j0) + j0 + trans
    // Per frame, as training or a fit to pictures found them, of the avatar's colours; empty: none
    // were looked for. FrameCache takes them out.
    std::vector<Gain> gains;
    std::optional<Keypoints> keypoints;
    std::vector<SeenFace> faces;  // per frame; empty: none were looked for
    // How it was made, written as strings into capture.toml's [source].
    std::map<std::string, std::string> source;
    // Shape coefficients of the source's own body model: no meaning for another body.
    std::optional<Betas> sourceBetas;

    size_t size() const { return frames.size(); }
    bool hasMasks() const;  // every frame has one
    // These frames, in this order, at the rate that keeps the motion's speed.
    Capture subset(std::span<const size_t> indices) const;
    // InputError that names the first frame without a mask and says what to do.
    void requireMasks() const;
};

// InputErrors name the file, what was expected and what was found: counts that disagree, values
// that are not finite, a picture whose size is not the camera's, no frames. Sizes come from the
// files' headers; pixels are decoded by FrameCache.
Capture readCapture(const std::filesystem::path& folder);

}  // namespace doppel
