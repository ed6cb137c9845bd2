#include "trainer/eval/evaluate.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "engine/io/image.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/sheet.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/eval/picture_figures.h"
#include "trainer/eval/report.h"

namespace doppel {

namespace {

// Samples per pixel and axis of an evaluated render: photographs are not aliased either. An odd
// number, so that no pixel is covered by just half and a silhouette cut at the half has no bias.
constexpr int kSamples = 3;

// The scene behind the person in each frame.
class Background {
public:
    Background(const std::string& kind, const Capture& capture, FrameCache& frames)
        : fromFrame_(kind == "frame") {
        if (kind == "frame" || kind == "median") {
            plate_.emplace(capture, frames);
            return;
        }
        const Image image = readImage(kind);
        const Camera& camera = capture.frames.at(0).camera;
        if (image.width != camera.width || image.height != camera.height)
            throwInput("{}: expected a picture of {}×{} pixels, as the frames have, found {}×{}",
                       kind, camera.width, camera.height, image.width, image.height);
        for (uint8_t b : image.data) clean_.push_back(static_cast<float>(b) / 255.0f);
    }
    std::vector<float> behind(const Picture& picture) const {
        if (!plate_) {
            if (clean_.size() != picture.rgb.size())
                throwInput(
                    "--scene: the picture has {} pixels, a frame {}; frames of one "
                    "size are needed",
                    clean_.size() / 3, picture.rgb.size() / 3);
            return clean_;
        }
        return fromFrame_ ? plate_->behind(picture) : plate_->plate();
    }

private:
    bool fromFrame_;
    std::optional<BackgroundPlate> plate_;
    std::vector<float> clean_;
};

Capture withoutGains(Capture capture) {
    capture.gains.clear();
    return capture;
}

void applyGain(Drawing& drawing, const Gain& gain) {
    for (size_t i = 0; i < drawing.rgb.size(); ++i) {
        const float most = static_cast<float>(drawing.mask[i / 3]) / 255;  // weighted by coverage
        drawing.rgb[i] = std::min(drawing.rgb[i] * gain[i % 3], most);
    }
}

// Where the body's head is seen, and a few pixels around it.
PixelRect headRect(const BodyModel& body, const PosedMesh& posed, const Camera& camera) {
    constexpr double kAround = 3;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (size_t v = 0; v < body.part.size(); ++v) {
        if (body.part[v] != kHead) continue;
        const std::array<double, 3> x{double{posed.verts[3 * v]}, double{posed.verts[3 * v + 1]},
                                      double{posed.verts[3 * v + 2]}};
        if (!(x[2] > 0)) return {};
        const auto [u, w] = camera.project(x);
        low[0] = std::min(low[0], u), high[0] = std::max(high[0], u);
        low[1] = std::min(low[1], w), high[1] = std::max(high[1], w);
    }
    auto pixel = [](double at, int size) {
        return static_cast<int>(std::clamp(at, 0.0, static_cast<double>(size)));
    };
    return {pixel(low[0] - kAround, camera.width), pixel(low[1] - kAround, camera.height),
            pixel(high[0] + kAround + 1, camera.width),
            pixel(high[1] + kAround + 1, camera.height)};
}

// White where a region of the atlas is, on black.
std::vector<float> regionTexture(const AtlasRegion& region, int size) {
    std::vector<float> texture(3 * static_cast<size_t>(size) * static_cast<size_t>(size));
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const double u = (x + .5) / size, v = (y + .5) / size;
            if (u < region.left || u >= region.right || v < region.top || v >= region.bottom)
                continue;
            std::fill_n(&texture[3 * static_cast<size_t>(y * size + x)], 3, 1.0f);
        }
    return texture;
}

double greatestDifference(std::span<const float> a, std::span<const float> b) {
    double greatest = 0;
    for (size_t i = 0; i < a.size(); ++i)
        greatest = std::max(greatest, std::abs(double(a[i]) - double(b[i])));
    return 255 * greatest;
}

}  // namespace

AtlasRegion atlasRegion(std::string_view text, std::string_view where) {
    AtlasRegion region;
    const size_t equals = text.find('=');
    region.name = text.substr(0, equals);
    const bool named = !region.name.empty() && region.name != "head" &&
                       std::ranges::all_of(region.name, [](unsigned char c) {
                           return std::isalnum(c) != 0 || c == '_';
                       });
    std::string_view numbers = equals == std::string_view::npos ? "" : text.substr(equals + 1);
    bool whole = named;
    for (double* side : {&region.left, &region.top, &region.right, &region.bottom}) {
        const auto [end, error] =
            std::from_chars(numbers.data(), numbers.data() + numbers.size(), *side);
        whole = whole && error == std::errc();
        numbers.remove_prefix(static_cast<size_t>(end - numbers.data()));
        const bool last = side == &region.bottom;
        whole = whole && (last ? numbers.empty() : numbers.starts_with(','));
        if (!last && !numbers.empty()) numbers.remove_prefix(1);
    }
    whole = whole && region.left >= 0 && region.top >= 0 && region.left < region.right &&
            region.top < region.bottom && region.right <= 1 && region.bottom <= 1;
    if (!whole)
        throwInput(
            "{}: expected NAME=LEFT,TOP,RIGHT,BOTTOM with parts of the atlas from 0 to 1, as "
            "print=.3,.2,.5,.4, and another name than head, found \"{}\"",
            where, text);
    return region;
}

Evaluation evaluateCapture(Device& device, const Avatar& avatar, const Capture& capture,
                           const EvaluateSettings& settings) {
    capture.requireMasks();
    const std::filesystem::path& pictures = settings.pictures;
    const Capture asRecorded = withoutGains(capture);
    FrameCache frames(asRecorded);
    const Capture& whole = settings.plateOf ? *settings.plateOf : asRecorded;
    std::optional<Background> background;
    {
        FrameCache wholeFrames(whole);
        background.emplace(settings.background, whole, wholeFrames);
    }
    AvatarRenderer renderer(device, avatar, true, settings.texture);
    BodyPoser poser(device, avatar.body);
    constexpr int kRegionTexels = 512;
    MeshDrawer drawer(device, avatar.body);
    std::vector<std::vector<float>> regionTextures;
    for (const AtlasRegion& region : settings.regions)
        regionTextures.push_back(regionTexture(region, kRegionTexels));
    auto submit = [&](size_t i) {
        renderer.submit(capture.theta[i], capture.trans[i], capture.frames[i].camera, kSamples);
    };
    Progress progress("eval", static_cast<int64_t>(capture.size()));
    Evaluation result;
    std::vector<float> firstRender, lastRender, lastPerson;
    std::vector<std::vector<float>> realVideo, renderedVideo;
    int64_t changes = 0;
    if (capture.size() > 0) submit(0);
    for (size_t i = 0; i < capture.size(); ++i) {
        if (interrupted()) throw Interrupted{};
        submit(i + 1 < capture.size() ? i + 1 : 0);  // the first once more, behind the last
        const Frame& frame = capture.frames[i];
        auto picture = frames.load(i);
        int w = frame.camera.width, h = frame.camera.height;
        Drawing drawing = renderer.take();
        if (!capture.gains.empty()) applyGain(drawing, capture.gains[i]);
        std::vector<float> render =
            composite(drawing.rgb, drawing.mask, background->behind(*picture));
        std::vector<float> target(picture->rgb.size());
        std::ranges::transform(picture->rgb, target.begin(),
                               [](uint8_t b) { return static_cast<float>(b) / 255.0f; });
        std::vector<uint8_t> silhouette = drawing.mask;
        for (uint8_t& value : silhouette) value = value >= 128 ? 255 : 0;
        result.frames.push_back(
            measureFrame(frame.name, render, target, silhouette, picture->mask, w, h));
        FrameMetrics& metrics = result.frames.back();
        const PixelRect head =
            headRect(avatar.body, poser.pose(capture.theta[i], capture.trans[i], avatar.betas),
                     frame.camera);
        std::vector<PictureRegion> regions{regionOf("head", head, w, h)};
        for (size_t r = 0; r < settings.regions.size(); ++r) {
            const Drawing shown =
                drawer.draw(renderer.vertices(capture.theta[i], capture.trans[i]), frame.camera,
                            regionTextures[r], kRegionTexels, kSamples);
            PictureRegion region{settings.regions[r].name, std::vector<uint8_t>(shown.mask.size())};
            for (size_t p = 0; p < shown.mask.size(); ++p)
                region.pixels[p] = shown.rgb[3 * p] > .99f;  // and shows nothing else
            regions.push_back(std::move(region));
        }
        metrics.figures = pictureFigures(
            {w, h, render, target, drawing.rgb, drawing.mask, picture->mask, std::move(regions)});
        if (settings.lpips) metrics.lpips = settings.lpips->distance(render, target, w, h);
        if (settings.videoFeatures) {
            realVideo.push_back(VideoFeatures::prepare(target, w, h));
            renderedVideo.push_back(VideoFeatures::prepare(render, w, h));
        }
        if (i == 0 && !pictures.empty()) {  // nothing is left where no frame could be evaluated
            std::vector<std::string> names;
            for (const Frame& each : capture.frames) names.push_back(each.name);
            claimFiles(pictures, "eval", reportFiles(names));
        }
        if (!pictures.empty())
            writeReportPictures(pictures, frame.name, toImage(target, w, h), toImage(render, w, h),
                                differenceImage(target, render, w, h, 4), head);
        std::vector<float> person = target;
        for (size_t p = 0; p < person.size(); ++p)
            if (picture->mask[p / 3] == 0) person[p] = 0;
        if (lastRender.size() == drawing.rgb.size()) {
            result.change += meanDifference(drawing.rgb, lastRender);
            result.changeOfFrames += meanDifference(person, lastPerson);
            ++changes;
        }
        lastRender = std::move(drawing.rgb);
        lastPerson = std::move(person);
        if (i == 0) firstRender = lastRender;
        progress.update(static_cast<int64_t>(i) + 1,
                        {{"iou", metrics.iou}, {"psnr", metrics.psnrBody}});
    }
    if (!pictures.empty() && !result.frames.empty())
        writeReport(pictures, capture.name, result.frames);
    if (changes > 0) {
        result.change /= static_cast<double>(changes);
        result.changeOfFrames /= static_cast<double>(changes);
    }
    if (capture.size() > 0) {
        Drawing again = renderer.take();
        if (!capture.gains.empty()) applyGain(again, capture.gains[0]);
        result.changeHeldStill = greatestDifference(again.rgb, firstRender);
    }
    if (settings.videoFeatures) {
        result.realClips = clipFeatures(*settings.videoFeatures, realVideo);
        result.renderedClips = clipFeatures(*settings.videoFeatures, renderedVideo);
    }
    return result;
}

std::vector<FrameMetrics> evaluateAvatar(Device& device, const Avatar& avatar,
                                         const Capture& capture,
                                         const std::filesystem::path& pictures,
                                         TextureKind texture) {
    return evaluateCapture(device, avatar, capture, {.pictures = pictures, .texture = texture})
        .frames;
}

std::optional<double> videoDistance(const std::vector<std::vector<double>>& real,
                                    const std::vector<std::vector<double>>& rendered) {
    if (real.size() < 2 || rendered.size() < 2) return std::nullopt;
    return frechetDistance(fitGaussian(real), fitGaussian(rendered));
}

}  // namespace doppel
