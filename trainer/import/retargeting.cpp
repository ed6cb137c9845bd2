// The layout of Gomes, Coutinho, Azevedo, Martins and Nascimento's Human Retargeting dataset, IJCV
// 2021: images/*.jpg, smpl_pose/STEM*_body.pkl with pose, trans, f, betas and openpose, and where
// given segmentations/STEM.png (> 0: the person).
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "engine/io/image.h"
#include "engine/io/pickle.h"
#include "trainer/data/frame_selection.h"
#include "trainer/import/importer.h"
#include "trainer/import/seen_heads.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

bool isFolder(const fs::path& path) {
    std::error_code error;
    return fs::is_directory(path, error);
}

bool isThere(const fs::path& path) {
    std::error_code error;
    return fs::exists(path, error);
}

std::vector<fs::path> filesOf(const fs::path& folder,
                              std::initializer_list<const char*> extensions) {
    std::vector<fs::path> files;
    std::error_code error;
    fs::directory_iterator entries(folder, error);
    if (error) throwInput("{}: cannot be read: {}", folder.string(), error.message());
    for (const auto& entry : entries) {
        const std::string ending = endingOf(entry.path());
        if (entry.path().filename().string().starts_with('.')) continue;
        if (std::find(extensions.begin(), extensions.end(), ending) == extensions.end()) continue;
        files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.stem().string(), b.stem().string());
    });
    return files;
}

// "X.jpg_body.pkl" and "X_IUV.png_body.pkl" are of the picture X.jpg.
std::string stemOfPose(std::string name) {
    const auto cut = [&](std::string_view end) {
        if (!name.ends_with(end)) return false;
        name.resize(name.size() - end.size());
        return true;
    };
    cut(".pkl");
    cut("_body");
    if (!cut(".png")) cut(".jpg");
    cut("_IUV");
    return name;
}

struct PoseFile {
    Theta theta{};
    Trans trans{};
    Betas betas{};
    double focal = 0;
    std::optional<std::array<int64_t, 2>> size;  // height, width
    std::string model;
    std::vector<float> keypoints;  // [K][3]
};

template <size_t N>
std::array<float, N> finite(const PickleValue& value) {
    const std::vector<float> numbers = value.asArray().requireShape({int64_t(N)}).toF32();
    std::array<float, N> result{};
    for (size_t i = 0; i < N; ++i) {
        if (!std::isfinite(numbers[i])) {
            throwInput("{}: expected finite numbers, found {} in element {}", value.where(),
                       numbers[i], i);
        }
        result[i] = numbers[i];
    }
    return result;
}

PoseFile readPose(const fs::path& path) {
    const PickleValue file = readPickle(path);
    PoseFile pose;
    pose.theta = finite<kThetaSize>(file.at("pose"));
    pose.trans = finite<3>(file.at("trans"));
    if (const auto betas = file.find("betas")) pose.betas = finite<10>(*betas);
    pose.focal = file.at("f").asNumber();
    if (!(pose.focal > 0) || !std::isfinite(pose.focal)) {
        throwInput("{}: f: expected a focal length in pixels, found {}", path.string(), pose.focal);
    }
    // The camera's own pose: the dataset's bodies are in camera space.
    for (const char* name : {"rt", "t"}) {
        const auto value = file.find(name);
        if (!value) continue;
        for (double number : value->asArray().toF64()) {
            if (number != 0) {
                throwInput("{}: expected zeros, the body being in camera space, found {}",
                           value->where(), number);
            }
        }
    }
    if (const auto size = file.find("img_shape")) {
        const auto numbers = size->asArray().toF64();
        if (numbers.size() >= 2) pose.size = {int64_t(numbers[0]), int64_t(numbers[1])};
    }
    if (const auto model = file.find("model_type")) {
        const int64_t type = model->asInteger();
        pose.model = type == 1 ? "male" : type == 2 ? "female" : "neutral";
    }
    if (const auto points = file.find("openpose")) {
        pose.keypoints = points->asArray().requireShape({-1, 3}).toF32();
        for (float& value : pose.keypoints) {
            if (!std::isfinite(value)) {
                throwInput("{}: expected finite numbers, found {}", points->where(), value);
            }
        }
    }
    return pose;
}

Capture readRetargeting(const ImportRequest& request) {
    const fs::path& folder = request.source;
    const auto images = filesOf(folder / "images", {".jpg", ".jpeg", ".png"});
    if (images.empty()) {
        throwInput("{}: expected one picture (.jpg, .png) or more, found none",
                   (folder / "images").string());
    }
    std::map<std::string, fs::path> poses;
    for (const fs::path& file : filesOf(folder / "smpl_pose", {".pkl"})) {
        poses.emplace(stemOfPose(file.filename().string()), file);
    }
    const bool masked = isFolder(folder / "segmentations");
    Capture capture;
    std::optional<size_t> keypointCount;
    const std::vector<size_t> chosen = selectFrames(request.frames, images.size());
    for (size_t i : chosen) {
        Frame frame;
        frame.image = images[i];
        frame.name = images[i].stem().string();
        const auto file = poses.find(frame.name);
        if (file == poses.end()) {
            throwInput(
                "{}: expected the pose of {} ({}_body.pkl), found none; --frames picks "
                "those that have one",
                (folder / "smpl_pose").string(), frame.image.filename().string(),
                frame.image.filename().string());
        }
        const PoseFile pose = readPose(file->second);
        const ImageSize size = imageSize(frame.image);
        if (pose.size && (*pose.size != std::array<int64_t, 2>{size.height, size.width})) {
            throwInput("{}: img_shape: expected {}×{}, the size of {}, found {}×{}",
                       file->second.string(), size.height, size.width,
                       frame.image.filename().string(), (*pose.size)[0], (*pose.size)[1]);
        }
        frame.camera = {pose.focal,       pose.focal, size.width / 2.,
                        size.height / 2., size.width, size.height};
        const fs::path mask = folder / "segmentations" / (frame.name + ".png");
        if (masked && isThere(mask)) {
            const ImageSize found = imageSize(mask);
            if (!(found == size)) {
                throwInput("{}: expected {}×{} pixels, the size of its frame, found {}×{}",
                           mask.string(), size.width, size.height, found.width, found.height);
            }
            frame.mask = mask;
        } else if (masked && !request.key) {
            throwInput(
                "{}: expected a mask for every picture, found none for {}; --key makes it "
                "from a green screen",
                (folder / "segmentations").string(), frame.image.filename().string());
        }
        if (capture.frames.empty()) {
            capture.sourceBetas = pose.betas;
            if (!pose.model.empty()) capture.source["model"] = pose.model;
            const size_t count = pose.keypoints.size() / 3;
            if (count == 25 || count == 19) {
                keypointCount = count;
                capture.keypoints = Keypoints{count == 25 ? "openpose25" : "lsp19", int(count), {}};
            }
        }
        if (keypointCount) {
            if (pose.keypoints.size() != 3 * *keypointCount) {
                throwInput("{}: openpose: expected {} keypoints as in the first frame, found {}",
                           file->second.string(), *keypointCount, pose.keypoints.size() / 3);
            }
            auto& values = capture.keypoints->values;
            values.insert(values.end(), pose.keypoints.begin(), pose.keypoints.end());
        }
        capture.frames.push_back(std::move(frame));
        capture.theta.push_back(pose.theta);
        capture.trans.push_back(pose.trans);
    }
    const fs::path absolute = fs::absolute(folder).lexically_normal();
    capture.name =
        (absolute.has_filename() ? absolute : absolute.parent_path()).filename().string();
    capture.fps = selectedRate(request.fps, chosen);
    if (request.poses.empty()) takeSeenHeads(capture, request);
    return capture;
}

const Importer kRetargeting{{
    .name = "human-retargeting",
    .looks = "images/ and smpl_pose/ (Human Retargeting)",
    .recognises =
        [](const fs::path& folder) {
            return isFolder(folder / "images") && isFolder(folder / "smpl_pose");
        },
    .read = readRetargeting,
}};

}  // namespace

}  // namespace doppel
