// Videos, and folders of pictures: frames that are worth keeping, and in them a person found by
// BlazePose, with a mask, keypoints, and a pose to start a fit from.
// landmarks.npz keeps what was seen; docs/formats.md has its arrays.
#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/io/image.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/import/importer.h"
#include "trainer/person/body_start.h"
#include "trainer/person/face.h"
#include "trainer/person/mask.h"
#include "trainer/person/tracker.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

struct Found {
    Track track;
    std::vector<std::optional<glm::dmat3>> faces;  // FaceMesh::axes()
    std::vector<double> times;
    std::vector<int32_t> numbers;    // in the clip
    std::vector<size_t> beginnings;  // after cuts
    int detections = 0;
};

void writeLandmarks(const fs::path& file, const Found& found) {
    std::vector<float> times(found.times.begin(), found.times.end()), rois, presence, picture,
        world, visibility, inPicture;
    for (const auto& person : found.track) {
        const Roi& roi = person->roi;
        for (double v : {roi.centre[0], roi.centre[1], roi.side, roi.rotation})
            rois.push_back(float(v));
        presence.push_back(float(person->presence));
        for (size_t i = 0; i < landmark::kCount; ++i) {
            const Landmark& point = person->points[i];
            for (double v : point.picture) picture.push_back(float(v));
            for (double v : point.world) world.push_back(float(v));
            visibility.push_back(float(point.visibility));
            inPicture.push_back(float(point.presence));
        }
    }
    const auto F = int64_t(found.track.size());
    constexpr int64_t kLandmarks = landmark::kCount;
    Npz arrays;
    arrays.set("number", Array::i32({F}, found.numbers));
    arrays.set("time", Array::f32({F}, times));
    arrays.set("roi", Array::f32({F, 4}, rois));
    arrays.set("presence", Array::f32({F}, presence));
    arrays.set("picture", Array::f32({F, kLandmarks, 3}, picture));
    arrays.set("world", Array::f32({F, kLandmarks, 3}, world));
    arrays.set("visibility", Array::f32({F, kLandmarks}, visibility));
    arrays.set("in_picture", Array::f32({F, kLandmarks}, inPicture));
    writeNpz(file, arrays, false);
}

Capture readClip(const ImportRequest& request) {
    CHECK(request.device && request.body && !request.workspace.empty(),
          "a clip is imported with a device, a body and a place for its frames");
    ClipOptions options = request.clip;
    options.frames = request.frames;
    options.fps = request.fps;
    BlazePose pose(*request.device, request.net);
    pose.requireModels();
    const std::vector<ClipFrame> frames = surveyClip(request.source, options);

    Capture capture;
    createFolders(request.workspace / "images");
    createFolders(request.workspace / "masks");
    Clip clip(request.source, options);
    PersonTracker tracker(pose, request.person);
    FaceFinder faces(*request.device);
    const bool looksAtFaces = FaceFinder::isThere();
    Found found;
    size_t nobody = 0;
    bool cut = false;
    Image picture;
    Progress progress("find the person", int64_t(frames.size()));
    for (size_t i = 0; i < frames.size() && clip.next(picture); ++i) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(i) + 1);
        cut = cut || frames[i].cut;
        if (frames[i].fate != Fate::Kept) continue;
        if (cut) tracker.forget();
        auto person = tracker.next(picture, frames[i].time);
        if (!person) {
            ++nobody;
            continue;
        }
        if (cut) found.beginnings.push_back(found.track.size());
        cut = false;
        Frame frame;
        frame.name = fmt::format("{:06}", i);
        frame.image = request.workspace / "images" / (frame.name + ".png");
        frame.mask = request.workspace / "masks" / (frame.name + ".png");
        frame.camera = cameraOfAngle(picture.width, picture.height,
                                     request.fov > 0 ? request.fov : kGuessedAngle);
        Image mask(picture.width, picture.height, 1);
        mask.data = personMask(*person, picture);
        person->mask = {};
        std::optional<FaceMesh> face;
        if (looksAtFaces) face = faces(picture, *person);
        found.faces.push_back(face ? face->axes() : std::nullopt);
        writeImage(frame.image, picture);
        writeImage(*frame.mask, mask);
        capture.frames.push_back(std::move(frame));
        found.track.push_back(std::move(person));
        found.times.push_back(frames[i].time);
        found.numbers.push_back(int32_t(i));
    }
    if (capture.frames.empty()) {
        throwInput("{}: expected a person in its {} frames, found nobody", request.source.string(),
                   nobody);
    }
    const auto seenFaces =
        std::ranges::count_if(found.faces, [](const auto& f) { return bool(f); });
    capture.source["heads"] =
        looksAtFaces ? fmt::format("as the face looks in {} frames of {}, else by the ears",
                                   seenFaces, found.faces.size())
                     : "by the ears; scripts/setup --models fetches a network that sees faces";
    const size_t swaps = mendSwaps(found.track, found.beginnings);
    smoothBothWays(found.track, found.times, found.beginnings);

    if (request.height > 0) capture.betas = betasOfHeight(*request.body, request.height);
    const BodyPoser3d poser(*request.body, capture.betas);
    capture.keypoints = Keypoints{"openpose25", 25, {}};
    for (size_t f = 0; f < capture.frames.size(); ++f) {
        const Camera& camera = capture.frames[f].camera;
        const PersonLandmarks person = poser.atJoints(*found.track[f], camera);
        const BodyStart start = poser(person, camera, found.faces[f]);
        capture.theta.push_back(start.theta);
        capture.trans.push_back(start.trans);
        const auto keypoints = openPoseKeypoints(person);
        capture.keypoints->values.insert(capture.keypoints->values.end(), keypoints.begin(),
                                         keypoints.end());
    }
    writeLandmarks(request.workspace / "landmarks.npz", found);
    capture.name = request.source.stem().string();
    capture.fps = keptRate(frames, options.fps);
    capture.source["masks"] = fmt::format("found by blazepose {}", poseNetName(request.net));
    capture.source["poses"] = "a start from landmarks, for a fit to refine";
    capture.source["camera"] =
        request.fov > 0
            ? fmt::format("{:g} degrees along the longer side, given", request.fov)
            : fmt::format("{:g} degrees along the longer side, guessed (--fov)", kGuessedAngle);
    if (request.height > 0) capture.source["height"] = fmt::format("{:g} m, given", request.height);
    std::string left = leftOut(frames);
    if (nobody > 0) left += fmt::format("{}{} without a person", left.empty() ? "" : ", ", nobody);
    if (!left.empty()) capture.source["left_out"] = left;
    if (const std::string ends = endsEarly(frames, clip.duration()); !ends.empty())
        capture.source["ends"] = ends;
    if (const std::string cuts = cutsOf(frames); !cuts.empty()) capture.source["cuts"] = cuts;
    if (swaps > 0) capture.source["swaps"] = fmt::format("{} of left and right, mended", swaps);
    return capture;
}

const Importer kVideo{{
    .name = "video",
    .looks = "a video",
    .recognises =
        [](const fs::path& source) {
            std::error_code error;
            return fs::is_regular_file(source, error);
        },
    .read = readClip,
}};

const Importer kPictures{{
    .name = "pictures",
    .looks = "pictures (a clip's frames)",
    .recognises =
        [](const fs::path& source) {
            std::error_code error;
            return fs::is_directory(source, error) && !fs::exists(source / "images", error) &&
                   !picturesOfFolder(source).empty();
        },
    .read = readClip,
}};

}  // namespace

}  // namespace doppel
