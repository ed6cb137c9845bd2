// Videos, and folders of pictures: frames that are worth keeping, and in them a person found by
// BlazePose, with a mask, keypoints, and a pose to start a fit from.
// landmarks.npz keeps what was seen; docs/formats.md has its arrays.
#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <mutex>

#include "engine/error.h"
#include "engine/io/image.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/import/importer.h"
#include "trainer/import/masks/clip_cutter.h"
#include "trainer/import/masks/given_masks.h"
#include "trainer/import/overlay.h"
#include "trainer/import/quality.h"
#include "trainer/person/body_start.h"
#include "trainer/person/face.h"
#include "trainer/person/masks/mask.h"
#include "trainer/person/tracker.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

struct Found {
    Track track;
    std::vector<std::optional<FaceMesh>> faces;
    std::vector<double> times;
    std::vector<int32_t> numbers;    // in the clip
    Digest pictures;                 // and the network's masks of them
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

// The people of the first frame in their boxes, with the numbers that --person takes.
void writePeople(const fs::path& file, const Image& picture, const PersonTracker& tracker) {
    std::vector<Box> boxes;
    for (const Roi& roi : tracker.people()) {
        // About as wide as a person with arms that hang.
        const double down = .45 * roi.side, across = .2 * roi.side;
        boxes.push_back({roi.centre[0] - across, roi.centre[1] - down, roi.centre[0] + across,
                         roi.centre[1] + down});
    }
    writeImage(file, numberedPicture(picture, boxes, tracker.followed()));
}

// Does what writes a file of this content, unless a run that was stopped has done it.
template <typename T>
void writeOnce(AnswerLog* log, const fs::path& file, const std::vector<T>& content,
               const std::function<void()>& write) {
    Digest question;
    question.addText((file.parent_path().filename() / file.filename()).string());
    question.add(std::span<const T>(content));
    answer(
        log, question,
        [&](std::span<const std::byte>) {
            std::error_code error;
            return fs::exists(file, error);
        },
        [&] {
            write();
            return AnswerLog::Answer{};
        });
}

// The network's masks, in their squares, wait on disk until the whole clip was seen.
void keepShare(const fs::path& file, const PersonLandmarks& person) {
    Image share(kRoiMaskSide, kRoiMaskSide, 1);
    for (size_t i = 0; i < share.data.size(); ++i)
        share.data[i] = uint8_t(256 / (1 + std::exp(-std::clamp(person.mask[i], -5.5f, 5.5f))));
    writeImage(file, share);
}

void takeShare(const fs::path& file, PersonLandmarks& person) {
    const Image share = readImage(file, 1);
    person.mask.resize(share.data.size());
    for (size_t i = 0; i < share.data.size(); ++i) {
        const double inside = (share.data[i] + .5) / 256;
        person.mask[i] = float(std::log(inside / (1 - inside)));
    }
}

constexpr size_t kSamples = 12;                    // frames in which a screen is looked for
constexpr size_t kRecentBytes = size_t{96} << 20;  // of frames that are kept to be cut

// Frames as they are cut, read from disk; those that were asked for last are kept, since frames
// that follow each other look at the same others. On any thread.
class RecentViews {
public:
    explicit RecentViews(std::function<ClipView(size_t)> load) : load_(std::move(load)) {}

    std::shared_ptr<const ClipView> operator()(size_t frame) {
        {
            const std::lock_guard lock(mutex_);
            const auto at = std::ranges::find(recent_, frame, &Recent::frame);
            if (at != recent_.end()) {
                std::rotate(recent_.begin(), at, at + 1);
                return recent_.front().view;
            }
        }
        const auto view = std::make_shared<const ClipView>(load_(frame));
        const size_t bytes =
            view->rgb.data.size() + sizeof(float) * view->share.size() + view->part.size();
        const std::lock_guard lock(mutex_);
        recent_.push_front({frame, view});
        while (recent_.size() > std::max<size_t>(1, kRecentBytes / bytes)) recent_.pop_back();
        return view;
    }

private:
    struct Recent {
        size_t frame;
        std::shared_ptr<const ClipView> view;
    };
    std::function<ClipView(size_t)> load_;
    std::mutex mutex_;
    std::deque<Recent> recent_;  // the last one first
};

// Masks of all frames: those that are there already, or by what the whole clip has shown.
void cutAll(const Capture& capture, Found& found, const fs::path& shares, bool given,
            ClipCutter& cutter, ClipQuality& quality, AnswerLog* log) {
    const auto load = [&](size_t f) {
        PersonLandmarks person = *found.track[f];
        takeShare(shares / (capture.frames[f].name + ".png"), person);
        return clipViewOf(person, readImage(capture.frames[f].image));
    };
    RecentViews views(load);
    const size_t count = capture.size(), some = std::min(count, kSamples);
    if (!given) {
        std::vector<ClipView> samples;
        for (size_t i = 0; i < some; ++i) samples.push_back(load(i * count / some));
        cutter.finish(samples);
    }
    FlickerMeter flicker;
    Progress progress("cut the person out", int64_t(count));
    for (size_t f = 0; f < count; ++f) {
        if (interrupted()) throw Interrupted{};
        const std::shared_ptr<const ClipView> frame = views(f);
        FrameCut cut;
        if (given) {
            cut.mask = readMask(*capture.frames[f].mask).data;
            cut.network = agreement(cut.mask, frame->share);
        } else {
            const fs::path& file = *capture.frames[f].mask;
            Digest question;
            // A mask depends on what the cutter has learned from all of them.
            question.addText("cut " + cutter.source());
            question.addText(capture.frames[f].name);
            question.addValue(found.pictures.value());
            answer(
                log, question,
                [&](std::span<const std::byte> kept) {
                    std::error_code error;
                    if (!takeFront(kept, cut.doubtful) || !takeFront(kept, cut.network) ||
                        !fs::exists(file, error))
                        return false;
                    cut.mask = readMask(file).data;
                    return true;
                },
                [&] {
                    cut = cutter.cut(f, *frame, std::ref(views));
                    Image mask(frame->rgb.width, frame->rgb.height, 1);
                    mask.data = cut.mask;
                    writeImage(file, mask);
                    AnswerLog::Answer bytes;
                    append(bytes, cut.doubtful);
                    append(bytes, cut.network);
                    return bytes;
                });
        }
        FrameQuality& frameQuality = quality.frames[f];
        frameQuality.agreement = cut.network;
        frameQuality.doubtful = cut.doubtful;
        if (std::ranges::count(found.beginnings, f) > 0 ||
            (f > 0 && found.times[f] - found.times[f - 1] > kFlickerSeconds))
            flicker.forget();
        const auto ofLast = flicker.next(cut.mask);
        if (f > 0) quality.frames[f - 1].flicker = ofLast;
        progress.update(int64_t(f) + 1);
    }
}

// Leaves frames out whose mask has little to do with where the person was found: training would
// learn what is not hers. Where it is half of them or more, masks that were cut here are of another
// kind than the network's, and are believed; those that were given (a path; else empty) are not
// this clip's: InputError.
void leaveOutDoubtful(Capture& capture, Found& found, std::vector<ClipFrame>& frames,
                      const fs::path& given, ClipQuality& quality) {
    constexpr double kLeastAgreement = .5;  // IoU
    const auto isDoubtful = [](const FrameQuality& f) { return f.agreement < kLeastAgreement; };
    const size_t count = capture.size(),
                 doubtful = size_t(std::ranges::count_if(quality.frames, isDoubtful));
    if (2 * doubtful >= count && !given.empty())
        throwInput(
            "{}: expected masks of the person in the clip's pictures, in their order, found ones "
            "that have little to do with where the person is in {} of {} frames",
            given.string(), doubtful, count);
    if (2 * doubtful >= count) return;
    std::vector<size_t> keptBefore;
    size_t kept = 0;
    for (size_t f = 0; f < count; ++f) {
        keptBefore.push_back(kept);
        if (!isDoubtful(quality.frames[f])) {
            if (kept != f) {
                capture.frames[kept] = std::move(capture.frames[f]);
                found.track[kept] = std::move(found.track[f]);
                found.faces[kept] = found.faces[f];
                found.times[kept] = found.times[f];
                found.numbers[kept] = found.numbers[f];
            }
            ++kept;
            continue;
        }
        frames[size_t(found.numbers[f])].fate = Fate::Doubtful;
        quality.leftOut.push_back(
            {int64_t{found.numbers[f]}, found.times[f],
             fmt::format("its mask agrees with where the person was found to {:.2f} only (IoU)",
                         quality.frames[f].agreement),
             quality.frames[f].picture});
        fs::remove(capture.frames[f].image);
        fs::remove(*capture.frames[f].mask);
    }
    std::ranges::sort(quality.leftOut, {}, &ClipQuality::LeftOut::number);
    std::erase_if(quality.frames, isDoubtful);
    capture.frames.resize(kept);
    found.track.resize(kept);
    found.faces.resize(kept);
    found.times.resize(kept);
    found.numbers.resize(kept);
    for (size_t& beginning : found.beginnings) beginning = keptBefore[beginning];
    const auto [last, end] = std::ranges::unique(found.beginnings);
    found.beginnings.erase(last, end);
    std::erase(found.beginnings, kept);
}

// The masks that were asked for, or that lie beside images/; empty: none.
fs::path masksOf(const ImportRequest& request, const fs::path& pictures) {
    std::error_code error;
    const bool makes =
        !request.plate.empty() || !request.matting.empty() || request.cutOutBy != CutOutBy::All;
    if (!request.masks.empty()) {
        if (makes)
            throwInput(
                "--masks: expected neither --plate nor --matting nor --cut-out, which make masks");
        if (!fs::exists(request.masks, error))
            throwInput("--masks: expected a folder of masks or a video, found nothing at {}",
                       request.masks.string());
        return request.masks;
    }
    if (makes) return {};
    const fs::path beside = request.source / "masks";
    return pictures != request.source && fs::is_directory(beside, error) ? beside : fs::path();
}

Capture readClip(const ImportRequest& request) {
    CHECK(request.device && request.body && !request.workspace.empty(),
          "a clip is imported with a device, a body and a place for its frames");
    ClipOptions options = request.clip;
    options.frames = request.frames;
    options.fps = request.fps;
    BlazePose pose(*request.device, request.net);
    pose.requireModels();
    std::unique_ptr<MattingNetwork> matting;
    if (!request.matting.empty())
        matting = std::make_unique<MattingNetwork>(request.matting, request.mattingKind);
    if (!request.plate.empty() && request.cutOutBy != CutOutBy::All)
        throwInput("--plate: expected --cut-out all, for it is a picture of what is behind");
    const fs::path folder = clipFolder(request.source),
                   source = folder.empty() ? request.source : folder,
                   given = masksOf(request, source);
    std::vector<ClipFrame> frames = surveyClip(source, options);
    std::optional<GivenMasks> masks;
    if (!given.empty()) masks.emplace(given, frames.size());

    Capture capture;
    createFolders(request.workspace / "images");
    createFolders(request.workspace / "masks");
    const fs::path shares = request.workspace / kSharesFolder;
    createFolders(shares);
    ClipCutter cutter(request.plate, std::move(matting), request.cutOutBy);
    Clip clip(source, options);
    const double lens = clip.focalLength();
    const double angle = request.fov > 0 ? request.fov
                         : lens > 0      ? angleOfLens(lens)
                                         : kGuessedAngle;
    PersonTracker tracker(pose, request.person);
    FaceFinder faces(*request.device);
    std::optional<AnswerLog> log;
    if (request.goesOn) {
        log.emplace(request.workspace / kAnswersFile);
        pose.remember(*log);
        faces.remember(*log);
    }
    AnswerLog* const answers = log ? &*log : nullptr;
    const bool looksAtFaces = FaceFinder::isThere();
    const std::vector<fs::path> files =
        folder.empty() ? std::vector<fs::path>() : picturesOfFolder(folder);
    const auto fileOf = [&](size_t i) {
        return i < files.size() ? files[i].filename().string() : std::string();
    };
    Found found;
    ClipQuality quality;
    quality.seen = frames.size();
    size_t nobody = 0;
    bool cut = false;
    Image picture;
    Progress progress("find the person", int64_t(frames.size()));
    for (size_t i = 0; i < frames.size() && clip.next(picture); ++i) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(i) + 1);
        cut = cut || frames[i].cut;
        const auto leaveOut = [&](std::string why) {
            quality.leftOut.push_back({int64_t(i), frames[i].time, std::move(why), fileOf(i)});
        };
        if (frames[i].fate != Fate::Kept) {
            if (masks) masks->skip();
            if (const std::string why = whyLeftOut(frames[i]); !why.empty()) leaveOut(why);
            continue;
        }
        if (cut) tracker.forget();
        auto person = tracker.next(picture, frames[i].time);
        if (!person) {
            if (masks) masks->skip();
            ++nobody;
            frames[i].fate = Fate::Nobody;
            leaveOut("without the person");
            continue;
        }
        if (found.track.empty() && tracker.people().size() > 1) {
            writePeople(request.workspace / "people.jpg", picture, tracker);
        }
        if (cut) found.beginnings.push_back(found.track.size());
        cut = false;
        Frame frame;
        frame.name = fmt::format("{:06}", i);
        frame.image = request.workspace / "images" / (frame.name + ".png");
        frame.mask = request.workspace / "masks" / (frame.name + ".png");
        frame.camera = cameraOfAngle(picture.width, picture.height, angle);
        if (masks) {
            Image mask(picture.width, picture.height, 1);
            mask.data = masks->next(picture.width, picture.height);
            writeOnce(answers, *frame.mask, mask.data, [&] { writeImage(*frame.mask, mask); });
        }
        quality.frames.push_back(qualityOf(frame.name, *person, picture.width, picture.height));
        quality.frames.back().picture = fileOf(i);
        if (!masks) cutter.learn(clipViewOf(*person, picture));
        found.pictures.add(std::span<const uint8_t>(picture.data));
        found.pictures.add(std::span<const float>(person->mask));
        const fs::path share = shares / (frame.name + ".png");
        writeOnce(answers, share, person->mask, [&] { keepShare(share, *person); });
        // `= {}` would empty the vector and keep its memory, for each frame.
        person->mask = std::vector<float>();
        std::optional<FaceMesh> face;
        if (looksAtFaces) face = faces(picture, *person);
        found.faces.push_back(std::move(face));
        writeOnce(answers, frame.image, picture.data, [&] { writeImage(frame.image, picture); });
        capture.frames.push_back(std::move(frame));
        found.track.push_back(std::move(person));
        found.times.push_back(frames[i].time);
        found.numbers.push_back(int32_t(i));
    }
    if (masks) masks->finish();
    if (capture.frames.empty()) {
        throwInput(
            "{}: expected a person in its {} frames, found nobody; film one person, whole "
            "and upright, at least a third as high as the picture",
            request.source.string(), nobody);
    }
    const auto seenFaces =
        std::ranges::count_if(found.faces, [](const auto& f) { return f && f->axes(); });
    capture.source["heads"] =
        looksAtFaces ? fmt::format("as the face looks in {} frames of {}, else by the ears",
                                   seenFaces, found.faces.size())
                     : "by the ears; scripts/setup --models fetches a network that sees faces";
    cutAll(capture, found, shares, bool(masks), cutter, quality, answers);
    leaveOutDoubtful(capture, found, frames, given, quality);
    quality.masks = masks ? fmt::format("given, {}", given.filename().string()) : cutter.source();
    const size_t swaps = mendSwaps(found.track, found.beginnings);
    smoothBothWays(found.track, found.times, found.beginnings);

    if (request.height > 0) capture.betas = betasOfHeight(*request.body, request.height);
    const BodyPoser3d poser(*request.body, capture.betas);
    capture.keypoints = Keypoints{"openpose25", 25, {}};
    for (size_t f = 0; f < capture.frames.size(); ++f) {
        const Camera& camera = capture.frames[f].camera;
        const PersonLandmarks person = poser.atJoints(*found.track[f], camera);
        const std::optional<FaceMesh>& face = found.faces[f];
        const BodyStart start = poser(person, camera, face ? face->axes() : std::nullopt);
        if (looksAtFaces) capture.faces.push_back(face ? face->seen() : SeenFace());
        capture.theta.push_back(start.theta);
        capture.trans.push_back(start.trans);
        const auto keypoints = openPoseKeypoints(person);
        capture.keypoints->values.insert(capture.keypoints->values.end(), keypoints.begin(),
                                         keypoints.end());
    }
    writeLandmarks(request.workspace / "landmarks.npz", found);
    capture.name = request.source.stem().string();
    capture.fps = keptRate(frames, options.fps);
    capture.source["masks"] = masks ? quality.masks
                                    : fmt::format("found by blazepose {}, cut out by {}",
                                                  poseNetName(request.net), cutter.source());
    capture.source["poses"] = "a start from landmarks, for a fit to refine";
    capture.source["keypoints"] = fmt::format("{}{}", kOwnKeypoints, poseNetName(request.net));
    capture.source["camera"] =
        fmt::format("{:.3g} degrees along the longer side, {}", angle,
                    request.fov > 0 ? "given"
                    : lens > 0 ? fmt::format("by its file: a lens of {:g} mm on 35 mm film", lens)
                               : "guessed (--fov)");
    if (request.height > 0) capture.source["height"] = fmt::format("{:g} m, given", request.height);
    if (const std::string left = leftOut(frames); !left.empty()) capture.source["left_out"] = left;
    const std::string ends = endsEarly(frames, clip.duration());
    clip.next(picture);  // past the last one: what ended the clip
    if (!clip.damage().empty())
        capture.source["ends"] = fmt::format("at {:.2f} s of {:.2f} s: {}", frames.back().time,
                                             clip.duration(), clip.damage());
    else if (!ends.empty())
        capture.source["ends"] = ends;
    if (const std::string range = clip.highRange(); !range.empty())
        capture.source["range"] = range + ", high dynamic range, brought to sRGB";
    if (const std::string cuts = cutsOf(frames); !cuts.empty()) capture.source["cuts"] = cuts;
    if (tracker.people().size() > 1) {
        capture.source["people"] = fmt::format(
            "{} in the first frame, of whom number {} is followed; people.jpg has the numbers "
            "that --person takes",
            tracker.people().size(), tracker.followed() + 1);
    }
    if (tracker.mistaken() > 0) {
        capture.source["hidden"] = fmt::format(
            "in {} frames somebody else was found, and they are left out", tracker.mistaken());
    }
    writeQuality(request.workspace / "quality.json", quality);
    capture.source["quality"] = summary(quality);
    if (const std::string lacks = cutOff(quality); !lacks.empty())
        capture.source["cut_off"] = lacks;
    if (swaps > 0) capture.source["swaps"] = fmt::format("{} of left and right, mended", swaps);
    return capture;
}

const Importer kVideo{{
    .name = "video",
    .looks = "a video",
    .isClip = true,
    .recognises =
        [](const fs::path& source) {
            std::error_code error;
            return fs::is_regular_file(source, error);
        },
    .read = readClip,
}};

const Importer kPictures{{
    .name = "pictures",
    .looks = "pictures (a clip's frames), also in images/ beside masks/",
    .isClip = true,
    .recognises = [](const fs::path& source) { return !clipFolder(source).empty(); },
    .read = readClip,
}};

}  // namespace

}  // namespace doppel
