#include "trainer/data/capture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "engine/io/image.h"
#include "trainer/data/capture_notes.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/shared_work.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

bool isFrameName(const fs::path& path) {
    const std::string ending = endingOf(path);
    return ending == ".png" || ending == ".jpg" || ending == ".jpeg";
}

// Pictures of a folder by their names without extension.
std::map<std::string, fs::path> picturesIn(const fs::path& folder) {
    std::map<std::string, fs::path> pictures;
    std::error_code error;
    fs::directory_iterator entries(folder, error);
    if (error) throwInput("{}: cannot be read: {}", folder.string(), error.message());
    for (const auto& entry : entries) {
        const fs::path& path = entry.path();
        if (!isFrameName(path) || path.filename().string().starts_with('.')) continue;
        const auto [at, added] = pictures.emplace(path.stem().string(), path);
        if (!added) {
            throwInput("{}: expected one picture of this name, found {} too", path.string(),
                       at->second.filename().string());
        }
    }
    return pictures;
}

// Programs give probabilities, or a number that is 1 and a little for what is surely there.
constexpr float kMostConfidence = 2;

// Points of pictures, [n][3]: u, v and a confidence. A distance of more pixels would have no
// square.
void requirePoints(std::span<const float> values, const std::string& file) {
    constexpr float kFarthest = 1e7f;
    for (size_t i = 0; i < values.size(); ++i)
        if (i % 3 < 2 && !(std::abs(values[i]) <= kFarthest))
            throwInput("{}: expected pixels from {:g} to {:g}, found {:g}", file, -kFarthest,
                       kFarthest, values[i]);
        else if (i % 3 == 2 && !(values[i] >= 0 && values[i] <= kMostConfidence))
            throwInput("{}: expected confidences from 0 to {:g}, found {:g}", file, kMostConfidence,
                       values[i]);
}

Keypoints readKeypoints(const fs::path& path, std::string scheme, size_t frames) {
    const Array array = readNpy(path);
    const std::string file = path.string();
    array.requireShape({-1, -1, 3}, file);
    if (array.shape[0] != int64_t(frames)) {
        throwInput("{}: expected {} frames, as images/ has, found {}", file, frames,
                   array.shape[0]);
    }
    const int64_t count = array.shape[1];
    if (scheme.empty() && count == 25) scheme = "openpose25";
    if (scheme.empty() && count == 19) scheme = "lsp19";
    if (scheme.empty()) {
        throwInput(
            "{}: expected 25 keypoints (openpose25) or 19 (lsp19), or [keypoints] scheme in "
            "capture.toml, found {}",
            file, count);
    }
    if (int64_t(keypointJoints(scheme).size()) != count) {
        throwInput("{}: expected {} keypoints for the scheme {}, found {}", file,
                   keypointJoints(scheme).size(), scheme, count);
    }
    Keypoints keypoints{std::move(scheme), int(count), array.toF32()};
    requireFinite(keypoints.values, file, size_t(3 * count));
    requirePoints(keypoints.values, file);
    return keypoints;
}

std::vector<SeenFace> readFaces(const fs::path& path, size_t frames) {
    constexpr auto kPoints = static_cast<int64_t>(kFacePoints);
    const std::string file = path.string();
    const std::vector<float> values =
        readNpy(path).requireShape({static_cast<int64_t>(frames), kPoints, 3}, file).toF32();
    requireFinite(values, file, 3 * kFacePoints);
    requirePoints(values, file);
    std::vector<SeenFace> faces(frames);
    for (size_t f = 0; f < frames; ++f) {
        SeenFace face(kFacePoints);
        bool seen = false;
        for (size_t k = 0; k < kFacePoints; ++k) {
            std::copy_n(&values[3 * (f * kFacePoints + k)], 3, face[k].begin());
            seen |= face[k][2] > 0;
        }
        if (seen) faces[f] = std::move(face);
    }
    return faces;
}

void requireFolder(const fs::path& folder, const char* what) {
    std::error_code error;
    if (fs::is_directory(folder, error)) return;
    throwInput(
        "{}: expected {}, found {}; `doppel import` makes a capture of a video or of pictures, and "
        "docs/formats.md has its files",
        folder.string(), what, fs::exists(folder, error) ? "a file" : "nothing");
}

void requireSize(const fs::path& path, const Camera& camera, const char* of) {
    const ImageSize size = imageSize(path);
    if (size.width == camera.width && size.height == camera.height) return;
    throwInput("{}: expected {}×{} pixels, the size of {}, found {}×{}", path.string(),
               camera.width, camera.height, of, size.width, size.height);
}

// Of an hour's frames these are 200,000 headers.
void requireSizes(std::span<const Frame> frames) {
    constexpr size_t kPart = 64;
    inParallel((frames.size() + kPart - 1) / kPart,
               [&](size_t part) {
                   const size_t begin = part * kPart;
                   for (const Frame& frame :
                        frames.subspan(begin, std::min(kPart, frames.size() - begin))) {
                       requireSize(frame.image, frame.camera, "cameras.npz");
                       if (frame.mask) requireSize(*frame.mask, frame.camera, "its frame");
                   }
                   return true;
               },
               [](size_t, bool) {});
}

}  // namespace

// ---- keypoints ----------------------------------------------------------------------------------

std::span<const int> keypointJoints(std::string_view scheme) {
    // BODY_25: nose, neck, right shoulder elbow wrist, left shoulder elbow wrist, mid hip, right
    // hip knee ankle, left hip knee ankle, eyes, ears, left big toe, small toe, heel, right ones.
    static constexpr std::array<int, 25> openpose25{-1, -1, 17, 19, 21, 16, 18, 20, -1,
                                                    2,  5,  8,  1,  4,  7,  -1, -1, -1,
                                                    -1, -1, -1, -1, -1, -1, -1};
    // LSP's 14: right ankle knee hip, left hip knee ankle, right wrist elbow shoulder, left
    // shoulder elbow wrist, neck, top of the head; then nose, eyes, ears.
    static constexpr std::array<int, 19> lsp19{8,  5,  2,  1,  4,  7,  21, 19, 17, 16,
                                               18, 20, -1, -1, -1, -1, -1, -1, -1};
    if (scheme == "openpose25") return openpose25;
    if (scheme == "lsp19") return lsp19;
    throwInput("keypoints: expected the scheme openpose25 or lsp19, found \"{}\"", scheme);
}

std::array<size_t, 5> keypointFace(std::string_view scheme) {
    if (keypointJoints(scheme).size() == 25) return {0, 16, 15, 18, 17};
    return {14, 15, 16, 17, 18};
}

// ---- captures -----------------------------------------------------------------------------------

bool Capture::hasMasks() const {
    return !frames.empty() && std::all_of(frames.begin(), frames.end(),
                                          [](const Frame& f) { return f.mask.has_value(); });
}

void Capture::requireMasks() const {
    for (const Frame& frame : frames) {
        if (frame.mask) continue;
        throwInput(
            "{}: expected a mask for every frame, found none for {}; bring them in with the "
            "source, or make them from a green screen with `doppel import --key`",
            (folder / "masks").string(), frame.name);
    }
}

Capture Capture::subset(std::span<const size_t> indices) const {
    Capture part;
    part.folder = folder;
    part.name = name;
    part.actor = actor;
    part.motion = motion;
    part.fps = selectedRate(fps, indices);
    part.betas = betas;
    part.source = source;
    part.sourceBetas = sourceBetas;
    if (keypoints) part.keypoints = Keypoints{keypoints->scheme, keypoints->count, {}};
    for (size_t i : indices) {
        CHECK(i < frames.size(), "frame {} is one of the capture's {}", i, frames.size());
        part.frames.push_back(frames[i]);
        part.theta.push_back(theta[i]);
        part.trans.push_back(trans[i]);
        if (!gains.empty()) part.gains.push_back(gains[i]);
        if (!faces.empty()) part.faces.push_back(faces[i]);
        if (keypoints) {
            const auto size = std::ptrdiff_t(3 * keypoints->count);
            const auto from = keypoints->values.begin() + std::ptrdiff_t(i) * size;
            part.keypoints->values.insert(part.keypoints->values.end(), from, from + size);
        }
    }
    return part;
}

Capture readCapture(const fs::path& folder) {
    requireFolder(folder, "a capture's folder");
    requireFolder(folder / "images", "a capture's pictures");
    const CaptureNotes notes = readNotes(folder);
    const auto images = picturesIn(folder / "images");
    std::vector<std::string> names = notes.frames;
    if (names.empty()) {
        for (const auto& [name, path] : images) {
            requireFileName(name, (folder / "images").string());
            names.push_back(name);
        }
        std::sort(names.begin(), names.end(), naturallyBefore);
    }
    if (names.empty()) {
        throwInput(
            "{}: expected one picture (.png, .jpg) or more, found none; docs/formats.md has "
            "a capture's files",
            (folder / "images").string());
    }
    std::error_code error;
    for (const char* part : {"cameras.npz", "poses.npz"})
        if (!fs::exists(folder / part, error))
            throwInput("{}: expected this file of a capture, found none; docs/formats.md has all",
                       (folder / part).string());
    const Cameras cameras = readCameras(folder / "cameras.npz", names.size());
    const bool masked = fs::exists(folder / "masks", error);
    const auto masks = masked ? picturesIn(folder / "masks") : std::map<std::string, fs::path>{};

    Capture capture;
    capture.folder = folder;
    capture.name = notes.name;
    capture.actor = notes.actor;
    capture.motion = notes.motion;
    capture.fps = notes.fps;
    capture.source = notes.source;
    capture.sourceBetas = notes.sourceBetas;
    for (size_t f = 0; f < names.size(); ++f) {
        Frame frame{names[f], {}, {}, cameras.cameras[f]};
        const auto image = images.find(names[f]);
        if (image == images.end()) {
            throwInput("{}: expected a picture for the frame {} of capture.toml, found none",
                       (folder / "images").string(), names[f]);
        }
        frame.image = image->second;
        if (masked) {
            const auto mask = masks.find(names[f]);
            if (mask == masks.end()) {
                throwInput("{}: expected a mask for every frame, found none for {}",
                           (folder / "masks").string(), names[f]);
            }
            frame.mask = mask->second;
        }
        capture.frames.push_back(std::move(frame));
    }
    requireSizes(capture.frames);

    const fs::path posesPath = folder / "poses.npz";
    Poses poses = readPoses(posesPath, true);
    if (poses.theta.size() != names.size()) {
        throwInput("{}: global_orient: expected {} rows, as many as there are frames, found {}",
                   posesPath.string(), names.size(), poses.theta.size());
    }
    for (size_t f = 0; f < names.size(); ++f) {
        movePose(cameras.extrinsics[f], poses.theta[f], poses.trans[f]);
    }
    capture.betas = poses.betas;
    capture.theta = std::move(poses.theta);
    capture.trans = std::move(poses.trans);
    if (fs::exists(folder / "keypoints.npy", error)) {
        capture.keypoints = readKeypoints(folder / "keypoints.npy", notes.scheme, names.size());
    }
    if (fs::exists(folder / "faces.npy", error))
        capture.faces = readFaces(folder / "faces.npy", names.size());
    return capture;
}

}  // namespace doppel
