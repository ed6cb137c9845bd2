#include "trainer/import/import.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/progress.h"
#include "trainer/data/version.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/given_poses.h"
#include "trainer/import/masks/chroma_key.h"
#include "trainer/import/seen_heads.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr size_t kKeySamples = 12;  // pictures that the key learns from
constexpr size_t kSheetPictures = 24;
constexpr int kSheetColumns = 8, kSheetLongest = 320;

}  // namespace

namespace {

ImportResult importInto(CaptureWriter& writer, const ImportSettings& settings,
                        const DrawBody& drawBody) {
    ImportRequest request = settings.request;
    request.workspace = writer.folder();
    request.goesOn = !settings.work.empty();
    ImportSource source = readImportSource(request);
    Capture& capture = source.capture;
    ImportResult result;
    if (!request.poses.empty()) {
        GivenPoses given =
            takeGivenPoses(capture, {request.poses, request.source, request.workspace}, drawBody);
        result.poses = std::move(given.told);
        result.posesFilled = std::move(given.filled);
        if (!given.measured) takeSeenHeads(capture, request);
    }
    const size_t frames = capture.size();
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
    if (settings.request.key && !unmasked.empty()) {
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
        key.emplace(pictures, bodies, (settings.request.source / "images").string());
        const auto [r, g, b] = key->screen().colour();
        capture.source["key"] = fmt::format("#{:02x}{:02x}{:02x}", r, g, b);
    }

    result.layout = source.layout;
    const std::vector<size_t> onSheet = evenly(frames, kSheetPictures);
    std::vector<Image> sheet;
    if (settings.overlays) createFolders(writer.folder() / "overlays");
    // Of a clip, whose frames follow each other, mask and keypoints make a film.
    std::optional<VideoWriter> film;
    std::error_code ignored;
    const bool filmed = settings.overlays && capture.keypoints &&
                        capture.keypoints->scheme == "openpose25" &&
                        fs::exists(writer.folder() / "landmarks.npz", ignored);
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
            if (frame.mask && frame.mask->parent_path().parent_path() == writer.folder())
                writer.copyMask(frame.name, *frame.mask);
            else
                writer.addMask(frame.name, picture.width, picture.height, picture.mask);
            result.iou.push_back(intersectionOverUnion(body.mask, picture.mask));
            result.meanIou += result.iou.back() / double(frames);
        }
        if (settings.overlays) {
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
        if (filmed) {
            const Image shown =
                skeletonPicture(picture, std::span(capture.keypoints->values).subspan(75 * f, 75));
            if (!film)
                film.emplace(writer.folder() / "overlay.mp4", shown.width, shown.height,
                             std::clamp(capture.fps, 1., 1000.));
            film->add(shown);
        }
        progress.update(int64_t(f) + 1);
    }
    if (result.iou.size() < frames) result.iou.clear();
    if (!result.poses.empty()) notePoseOverlaps(writer.folder(), capture, result.iou);
    if (film) film->finish();
    if (settings.overlays) {
        writeImage(writer.folder() / "overlay.jpg", tiles(sheet, kSheetColumns));
    }
    capture.source["layout"] = source.layout;
    capture.source["folder"] = settings.request.source.string();
    capture.source["command"] =
        settings.commandLine.empty() ? "doppel import" : settings.commandLine;
    capture.source["program"] = fmt::format("doppel {}", kVersion);
    // Where masks that are given came from may have been said before.
    std::string& masks = capture.source["masks"];
    if (result.givenMasks < frames || masks.empty() || masks == "none")
        masks = result.givenMasks == frames   ? "given"
                : result.keyedMasks == frames ? "keyed"
                : result.keyedMasks > 0       ? "given and keyed"
                                              : "none";
    for (const char* left : {kAnswersFile, kSharesFolder}) fs::remove_all(writer.folder() / left);
    result.capture = writer.commit(capture);
    return result;
}

}  // namespace

ImportResult importCapture(const ImportSettings& settings, const DrawBody& drawBody) {
    if (settings.startsOver) CaptureWriter{settings.out};  // removes what was left
    CaptureWriter writer(settings.out, settings.work);
    if (writer.goesOn())
        fmt::print(stderr, "{}: goes on with what a run that was stopped has found\n",
                   settings.out.string());
    try {
        return importInto(writer, settings, drawBody);
    } catch (const Interrupted&) {
        // Only of clips is there something that takes longer than reading it again.
        std::error_code ignored;
        if (!fs::exists(writer.folder() / kAnswersFile, ignored)) throw;
        writer.leave();
        throw Interrupted{
            fmt::format("what was found so far, {}, from which the same command goes on",
                        writer.folder().string())};
    }
}

}  // namespace doppel
