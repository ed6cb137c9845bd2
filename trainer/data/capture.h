// Captures: recorded sequences of one person, with masks and SMPL poses, and motions (poses only).
//
// On disk a capture is a folder:
//
//     images/NAME.png|jpg      the frames, all of cameras.npz's size
//     masks/NAME.png           optional: where the person is (> 0), the size of the frame
//     cameras.npz              intrinsic [3,3] or [F,3,3], extrinsic [4,4] or [F,4,4] (optional:
//                              identity), height, width (0-d or [F])
//     poses.npz                betas [10], global_orient [F,3], body_pose [F,69], transl [F,3]
//     keypoints.npy            optional: [F,K,3], u, v in pixels and confidence
//     capture.toml             optional: name, actor and motion (of a capture in a collection, see
//                              findCaptures), fps, frames (the names in order), [keypoints]
//                              scheme, [source] how it was made
//
// Without capture.toml the frames are the files of images/ in the order of the numbers in their
// names. In memory poses are always in camera space: an extrinsic is folded into them on reading.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/npz.h"
#include "nn/body/joint.h"
#include "trainer/data/output_folder.h"

namespace doppel {

// Pinhole: x right, y down, z forward; u = fx x/z + cx, v = fy y/z + cy in pixels, whose centres
// are at .5 and whose origin is the picture's top left corner.
struct Camera {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    int width = 0, height = 0;  // pixels

    // u, v of a point in camera space; z has to be positive.
    std::array<double, 2> project(const std::array<double, 3>& point) const {
        return {fx * point[0] / point[2] + cx, fy * point[1] / point[2] + cy};
    }
    bool operator==(const Camera&) const = default;
};

using Theta = std::array<float, kThetaSize>;  // axis-angle, joints in SMPL's order, radians
using Trans = std::array<float, 3>;           // metres
using Betas = std::array<float, 10>;          // standard deviations

struct Frame {
    std::string name;  // of its files, without extension
    std::filesystem::path image;
    std::optional<std::filesystem::path> mask;
    Camera camera;
};

struct Keypoints {
    std::string scheme;         // "openpose25" or "lsp19"
    int count = 0;              // K
    std::vector<float> values;  // [F][K][3]: u, v (pixels), confidence (0: not seen)
};

// The SMPL joint that each keypoint of a scheme shows, or −1 where none does (eyes, toes' tips, and
// the mid-points that SMPL's joints only come near). InputError for an unknown scheme.
std::span<const int> keypointJoints(std::string_view scheme);

struct Capture {
    std::filesystem::path folder;
    std::string name;
    std::string actor, motion;  // who is seen, doing what; empty: not said
    double fps = 30;
    std::vector<Frame> frames;
    Betas betas{};
    std::vector<Theta> theta;  // per frame; theta[0..2] turns the body into camera space
    std::vector<Trans> trans;  // per frame, camera space: v_cam = R(θ0)(v − j0) + j0 + trans
    std::optional<Keypoints> keypoints;
    // How it was made, written as strings into capture.toml's [source].
    std::map<std::string, std::string> source;
    // Shape coefficients of the source's own body model: no meaning for another body.
    std::optional<Betas> sourceBetas;

    size_t size() const { return frames.size(); }
    bool hasMasks() const;  // every frame has one
    // These frames, in this order.
    Capture subset(std::span<const size_t> indices) const;
    // InputError that names the first frame without a mask and says what to do.
    void requireMasks() const;
};

// InputErrors name the file, what was expected and what was found: counts that disagree, values
// that are not finite, a picture whose size is not the camera's, no frames. Sizes come from the
// files' headers; pixels are decoded by FrameCache.
Capture readCapture(const std::filesystem::path& folder);

// Poses without pictures: the driving motion.
struct Motion {
    std::filesystem::path source;
    std::string name;
    double fps = 30;
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    Betas betas{};
    // Per frame where the source is a capture; then theta and trans are in camera space.
    std::vector<Camera> cameras;

    size_t size() const { return theta.size(); }
    Motion subset(std::span<const size_t> indices) const;
};

// A capture's folder, a poses.npz (betas may be missing; a 0-d `fps` is believed), or a *.bvh.
Motion readMotion(const std::filesystem::path& path);

// The motion seen by the cameras of a cameras.npz (one for all frames, or one per frame), into
// whose space its poses are moved; they are taken to be in that file's world.
Motion throughCameras(Motion motion, const std::filesystem::path& cameras);

// Frame numbers, ascending and each once: "a:b" (from a up to but not b), "a:", ":b", "a:b:step",
// "a" (one frame), and lists of these with commas. Negative numbers count from the end. Empty text:
// all frames. InputError where the text is none of these, where a frame does not exist, and where
// nothing is left. `what` names the flag.
std::vector<size_t> selectFrames(std::string_view text, size_t count,
                                 std::string_view what = "--frames");

// "frame9" before "frame10": runs of digits count as numbers.
bool naturallyBefore(const std::string& a, const std::string& b);

// ---- pictures -----------------------------------------------------------------------------------

// 8-bit, rows from the top.
struct Picture {
    int width = 0, height = 0;
    std::vector<uint8_t> rgb;   // [H][W][3], sRGB-encoded
    std::vector<uint8_t> mask;  // [H][W], 255 the person, 0 not; empty where the frame has none
};

// Decodes the frames of a capture on demand and keeps the latest ones. Can be used from several
// threads.
class FrameCache {
public:
    explicit FrameCache(const Capture& capture, size_t memoryBudget = size_t{512} << 20);
    // InputError where the file is cut short, or no longer what readCapture saw.
    std::shared_ptr<const Picture> load(size_t frame);

private:
    const Capture& capture_;
    size_t budget_, used_ = 0;
    std::mutex mutex_;
    std::list<std::pair<size_t, std::shared_ptr<const Picture>>> kept_;  // latest first
};

// A square in a picture, in its pixels; it may reach beyond the border.
struct CropBox {
    double centreX = 0, centreY = 0, half = 0;
};

// The square around the pelvis in which the body fills the picture: half size 1.1 × the largest
// projected distance of a joint from the pelvis. joints: [24], camera space, metres, all with
// positive z (InputError otherwise: `where` names the frame).
CropBox cropBox(const Camera& camera, std::span<const std::array<double, 3>> joints,
                std::string_view where = "frame");

// The camera that draws the box with size × size pixels: u' = (u − left) · size / (2 half).
Camera cropCamera(const Camera& camera, const CropBox& box, int size);

struct Crop {
    Camera camera;              // S × S
    std::vector<float> image;   // [S][S][3], sRGB-encoded, [0,1]; 0 outside the frame
    std::vector<float> mask;    // [S][S], [0,1]; empty where the picture has none
    std::vector<float> inside;  // [S][S], the part of each pixel that lies inside the frame
};

// Each pixel is the mean of the frame over its square where the box shrinks the frame, and a
// bilinear sample at its centre where it enlarges it.
Crop crop(const Picture& picture, const Camera& camera, const CropBox& box, int size);

// ---- writing ------------------------------------------------------------------------------------

// Writes a capture into a temporary folder beside its place; commit() renames it. Without commit()
// nothing is left. A capture there that Doppel wrote is replaced as a whole; anything else that is
// not an empty folder is refused (InputError).
//
//     CaptureWriter writer("fitted");
//     for (...) writer.addImage(name, width, height, rgb), writer.addMask(name, ...);
//     writer.commit(capture);
class CaptureWriter {
public:
    explicit CaptureWriter(const std::filesystem::path& folder);

    // The temporary folder, for whatever else belongs to the capture (overlays).
    const std::filesystem::path& folder() const { return output_.folder(); }

    void copyImage(const std::string& name, const std::filesystem::path& file);
    void copyMask(const std::string& name, const std::filesystem::path& file);
    // PNG. rgb: [H][W][3], mask: [H][W], > 0 the person.
    void addImage(const std::string& name, int width, int height, std::span<const uint8_t> rgb);
    void addMask(const std::string& name, int width, int height, std::span<const uint8_t> mask);

    // Writes cameras, poses, keypoints and capture.toml (frames[i].image and mask are looked up by
    // name among what was added), checks them as readCapture does, and renames the folder. Returns
    // the capture as it is now on disk.
    Capture commit(const Capture& capture);

private:
    OutputFolder output_;
    std::map<std::string, std::filesystem::path> images_, masks_;  // relative to the folder
};

// What poses.npz holds.
Npz posesArrays(std::span<const Theta> theta, std::span<const Trans> trans, const Betas& betas);

// The capture with its pictures copied to another folder (which may be its own).
Capture writeCapture(const Capture& capture, const std::filesystem::path& folder);
Capture writeCapture(const Capture& capture, CaptureWriter& writer);

}  // namespace doppel
