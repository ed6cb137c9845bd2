// The layout of Gomes, Coutinho, Azevedo, Martins and Nascimento's Human Retargeting dataset, IJCV
// 2021.
#include "trainer/import/import.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/pickle.h"
#include "trainer/data/progress.h"
#include "trainer/data/version.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/chroma_key.h"
#include "trainer/import/overlay.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr size_t kKeySamples = 12;  // pictures that the key learns from
constexpr size_t kSheetPictures = 24;
constexpr int kSheetColumns = 8, kSheetLongest = 320;

// What a layout's reader finds: a capture whose files are still where they were.
struct Source {
    Capture capture;
    std::string layout;
    std::string maskFolder;  // where masks would have been, for errors
};

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
        std::string extension = entry.path().extension().string();
        std::transform(extension.begin(), extension.end(), extension.begin(),
                       [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
        if (entry.path().filename().string().starts_with('.')) continue;
        if (std::find(extensions.begin(), extensions.end(), extension) == extensions.end())
            continue;
        files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.stem().string(), b.stem().string());
    });
    return files;
}

// ---- the Human Retargeting dataset --------------------------------------------------------------

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
    pose.theta = finite<72>(file.at("pose"));
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

Source readRetargeting(const ImportOptions& options) {
    const fs::path& folder = options.source;
    const auto images = filesOf(folder / "images", {".jpg", ".jpeg", ".png"});
    if (images.empty()) {
        throwInput("{}: expected one picture (.jpg, .png) or more, found none",
                   (folder / "images").string());
    }
    std::map<std::string, fs::path> poses;
    for (const fs::path& file : filesOf(folder / "smpl_pose", {".pkl"})) {
        poses.emplace(stemOfPose(file.filename().string()), file);
    }
    Source source;
    source.layout = "human-retargeting";
    source.maskFolder = (folder / "segmentations").string();
    const bool masked = isFolder(folder / "segmentations");
    Capture& capture = source.capture;
    std::optional<size_t> keypointCount;
    for (size_t i : selectFrames(options.frames, images.size())) {
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
        } else if (masked && !options.key) {
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
    capture.fps = options.fps;
    return source;
}

Source readOwn(const ImportOptions& options) {
    Source source;
    source.layout = "capture";
    source.maskFolder = (options.source / "masks").string();
    const Capture all = readCapture(options.source);
    source.capture = all.subset(selectFrames(options.frames, all.size()));
    return source;
}

Source readSource(const ImportOptions& options) {
    const fs::path& folder = options.source;
    if (!isFolder(folder)) {
        throwInput("{}: expected a folder to import, found {}", folder.string(),
                   isThere(folder) ? "a file" : "nothing");
    }
    if (isFolder(folder / "images") && isFolder(folder / "smpl_pose")) {
        return readRetargeting(options);
    }
    if (isFolder(folder / "images") && isThere(folder / "cameras.npz") &&
        isThere(folder / "poses.npz")) {
        return readOwn(options);
    }
    std::vector<std::string> names;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
        names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    if (names.size() > 8) names.resize(8), names.push_back("…");
    throwInput(
        "{}: expected a known layout: images/ and smpl_pose/ (Human Retargeting), or "
        "images/, cameras.npz and poses.npz (a capture); found {}",
        folder.string(),
        names.empty() ? "an empty folder" : fmt::format("{}", fmt::join(names, ", ")));
}

// ---- writing ------------------------------------------------------------------------------------

std::vector<size_t> evenly(size_t count, size_t most) {
    std::vector<size_t> indices;
    const size_t n = std::min(count, most);
    for (size_t i = 0; i < n; ++i) indices.push_back(i * count / n);
    return indices;
}

std::string shortText(const CommonOptions& common) {
    return common.commandLine.empty() ? "doppel import" : common.commandLine;
}

}  // namespace

ImportResult importCapture(const ImportOptions& options, const DrawBody& drawBody) {
    Source source = readSource(options);
    Capture& capture = source.capture;
    const size_t frames = capture.size();
    CaptureWriter writer(options.out);
    FrameCache cache(capture, size_t{64} << 20);
    const auto draw = [&](size_t f) {
        BodyPicture body =
            drawBody(capture.frames[f].camera, capture.theta[f], capture.trans[f], capture.betas);
        CHECK(body.mask.size() ==
                  size_t(capture.frames[f].camera.width) * size_t(capture.frames[f].camera.height),
              "a body is drawn at its frame's size");
        return body;
    };

    // The key needs to have seen the screen and the person before it can tell them apart.
    std::vector<size_t> unmasked;
    for (size_t f = 0; f < frames; ++f) {
        if (!capture.frames[f].mask) unmasked.push_back(f);
    }
    std::optional<PersonKey> key;
    if (options.key && !unmasked.empty()) {
        std::vector<std::shared_ptr<const Picture>> pictures;
        std::vector<std::vector<uint8_t>> bodies;
        for (size_t i : evenly(unmasked.size(), kKeySamples)) {
            const Frame& frame = capture.frames[unmasked[i]];
            const Camera& first = capture.frames[unmasked[0]].camera;
            if (frame.camera.width != first.width || frame.camera.height != first.height) {
                throwInput(
                    "{}: expected {}×{} pixels, since --key needs pictures of one size, "
                    "found {}×{}",
                    frame.image.string(), first.width, first.height, frame.camera.width,
                    frame.camera.height);
            }
            pictures.push_back(cache.load(unmasked[i]));
            bodies.push_back(draw(unmasked[i]).mask);
        }
        key.emplace(pictures, bodies, (options.source / "images").string());
        const auto [r, g, b] = key->screen().colour();
        capture.source["key"] = fmt::format("#{:02x}{:02x}{:02x}", r, g, b);
    }

    ImportResult result;
    result.layout = source.layout;
    const std::vector<size_t> onSheet = evenly(frames, kSheetPictures);
    std::vector<Image> sheet;
    if (options.overlays) createFolders(writer.folder() / "overlays");
    Progress progress("import", int64_t(frames));
    for (size_t f = 0; f < frames; ++f) {
        if (interrupted()) throw Interrupted{};
        Frame& frame = capture.frames[f];
        Picture picture = *cache.load(f);
        writer.copyImage(frame.name, frame.image);
        const BodyPicture body = draw(f);
        if (frame.mask) {
            ++result.givenMasks;
        } else if (key) {
            picture.mask = key->mask(picture, body.mask);
            if (std::none_of(picture.mask.begin(), picture.mask.end(),
                             [](uint8_t v) { return v > 0; })) {
                throwInput(
                    "{}: expected the person where its pose draws the body, found only the "
                    "screen: wrong pose or camera, or not before a screen; --frames leaves "
                    "it out",
                    frame.image.string());
            }
            ++result.keyedMasks;
        }
        if (!picture.mask.empty()) {
            writer.addMask(frame.name, picture.width, picture.height, picture.mask);
            result.meanIou += intersectionOverUnion(body.mask, picture.mask) / double(frames);
        }
        if (options.overlays) {
            const Image overlay = overlayPicture(picture, body);
            writeImage(writer.folder() / "overlays" / (frame.name + ".jpg"), overlay);
            if (std::binary_search(onSheet.begin(), onSheet.end(), f)) {
                const int side = std::max(overlay.width, overlay.height);
                const auto scaled = [&](int length) {
                    return std::max(1, int(std::lround(double(length) * kSheetLongest / side)));
                };
                Image tile = resize(overlay, scaled(overlay.width), scaled(overlay.height));
                if (!sheet.empty()) tile = resize(tile, sheet[0].width, sheet[0].height);
                sheet.push_back(std::move(tile));
            }
        }
        progress.update(int64_t(f) + 1);
    }
    if (options.overlays) {
        writeImage(writer.folder() / "overlay.jpg", tiles(sheet, kSheetColumns));
    }
    capture.source["layout"] = source.layout;
    capture.source["folder"] = options.source.string();
    capture.source["command"] = shortText(options.common);
    capture.source["program"] = fmt::format("doppel {}", kVersion);
    capture.source["masks"] = result.givenMasks == frames   ? "given"
                              : result.keyedMasks == frames ? "keyed"
                              : result.keyedMasks > 0       ? "given and keyed"
                                                            : "none";
    result.capture = writer.commit(capture);
    return result;
}

}  // namespace doppel
