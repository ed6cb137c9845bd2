#include "trainer/motion/estimates/estimate.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/files/zip.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMostBytes = uint64_t{4} << 30;

// In the order of their programs, whatever the order in which they were linked.
std::vector<EstimateFormat::Declaration>& formats() {
    static std::vector<EstimateFormat::Declaration> all;
    return all;
}

std::string knownFormats() {
    std::string text;
    for (size_t i = 0; i < formats().size(); ++i) {
        if (i > 0) text += i + 1 < formats().size() ? ", " : " or ";
        text += formats()[i].looks;
    }
    return text;
}

EstimateSource open(const fs::path& path) {
    EstimateSource source;
    source.path = path;
    std::error_code error;
    if (!fs::exists(path, error))
        throwInput("{}: expected poses of another program, found nothing", path.string());
    if (fs::is_directory(path, error)) {
        source.folder = true;
        return source;
    }
    if (endingOf(path) == ".npz") {
        source.npz = readNpz(path);
        return source;
    }
    const std::vector<uint8_t> magic = readFileHead(path, 2);
    if (!std::ranges::equal(magic, std::string_view("PK"))) {
        source.pickle = readPickle(path);
        return source;
    }
    source.bytes = readWholeFile(path, kMostBytes);
    const auto entries =
        zipEntries(source.bytes, {"a", "zip", "entries"}, path.string(), {.maxEntries = 65536});
    if (std::ranges::any_of(entries, [](const ZipEntry& entry) {
            return entry.name == "data.pkl" || entry.name.ends_with("/data.pkl");
        })) {
        source.torch = std::make_unique<TorchFile>(source.bytes, path.string());
    } else {
        source.npz = npzFromBytes(source.bytes, path.string());
    }
    return source;
}

const EstimateFormat::Declaration* formatOf(const EstimateSource& source) {
    for (const auto& format : formats())
        if (format.recognises(source)) return &format;
    return nullptr;
}

void check(const Estimates& estimates) {
    CHECK(!estimates.readings.empty() && !estimates.people.empty(),
          "a format reads people, in one way at least");
    for (const EstimatedPerson& person : estimates.people) {
        CHECK(!person.poses.empty(), "a person has poses");
        for (const EstimatedPose& pose : person.poses)
            CHECK(pose.views.size() == estimates.readings.size(), "each reading has its view");
    }
}

}  // namespace

EstimateFormat::EstimateFormat(const Declaration& declaration) {
    const auto before = [](const Declaration& a, const Declaration& b) {
        return std::string_view(a.looks) < b.looks;
    };
    formats().insert(std::upper_bound(formats().begin(), formats().end(), declaration, before),
                     declaration);
}

Estimates readEstimates(const fs::path& path) {
    if (auto estimates = findEstimates(path)) return std::move(*estimates);
    std::error_code error;
    throwInput("{}: expected poses of another program: {}; found {}", path.string(), knownFormats(),
               fs::is_directory(path, error) ? "a folder of other files" : "other content");
}

std::optional<Estimates> findEstimates(const fs::path& path) {
    EstimateSource source = open(path);
    const EstimateFormat::Declaration* format = formatOf(source);
    if (format == nullptr) return {};
    Estimates estimates;
    estimates.source = path;
    estimates.program = format->program;
    estimates.measured = format->measured;
    format->read(source, estimates);
    // In the order of the clip's pictures; of two poses for one picture the first one counts.
    for (EstimatedPerson& person : estimates.people) {
        std::ranges::stable_sort(person.poses, {}, &EstimatedPose::picture);
        const auto again = std::ranges::unique(person.poses, {}, &EstimatedPose::picture);
        person.poses.erase(again.begin(), again.end());
    }
    check(estimates);
    return estimates;
}

// ---- placing ------------------------------------------------------------------------------------

PlacedPose placePose(const EstimatedPose& pose, const EstimatedView& view, const Camera& clip,
                     bool known) {
    constexpr double kAway = 3.2;  // metres; all of a person is seen there
    using Focal = EstimatedView::Focal;
    PlacedPose placed{pose.theta, {}, clip};
    const double longest = std::max(clip.width, clip.height),
                 shortest = std::min(clip.width, clip.height);
    glm::dquat root = view.turn * jointRotation(pose.theta, joint::kPelvis);
    glm::dvec3 place(0, 0, kAway);
    // Through the clip's camera, where the pelvis is in the picture and as many pixels as a metre
    // has there. before: the direction in which the program saw it.
    const auto bySight = [&](glm::dvec2 pixel, double pixelsPerMetre, const glm::dvec3& before) {
        if (!(pixelsPerMetre > 0) || !std::isfinite(pixelsPerMetre)) return;
        const double depth = std::clamp(clip.fx / pixelsPerMetre, .1, 1e4);
        place = {(pixel.x - clip.cx) * depth / clip.fx, (pixel.y - clip.cy) * depth / clip.fy,
                 depth};
        root = turnBetween(before, glm::normalize(place)) * root;
    };
    const glm::dvec3 axis(0, 0, 1);  // the optical one, on which squares show the person
    if (view.kind == EstimatedView::Kind::Square) {
        const double side = view.side > 0 ? view.side : longest;
        const glm::dvec2 centre =
            view.side > 0 ? view.centre : glm::dvec2(clip.width, clip.height) / 2.;
        const double pixels = view.scale * side / 2;
        bySight(centre + pixels * glm::dvec2(view.pelvis), pixels, axis);
    } else if (view.kind == EstimatedView::Kind::Metres) {
        const double unit = view.of == Focal::Pixels     ? 1
                            : view.of == Focal::Longest  ? longest
                            : view.of == Focal::Shortest ? shortest
                                                         : std::hypot(longest, shortest);
        Camera camera = clip;
        if (view.of != Focal::Guess) camera.fx = camera.fy = view.focal * unit;
        if (view.principal) camera.cx = view.principal->x, camera.cy = view.principal->y;
        const bool assumed = view.of != Focal::Guess && view.of != Focal::Pixels;
        if (!view.nominal && !(known && assumed)) {
            placed.camera = camera;
            place = view.pelvis;
        } else if (view.pelvis.z > 0) {
            const auto [u, v] = camera.project({view.pelvis.x, view.pelvis.y, view.pelvis.z});
            bySight({u, v}, camera.fx / view.pelvis.z,
                    view.nominal ? axis : glm::normalize(view.pelvis));
        }
    }
    setJointRotation(placed.theta, joint::kPelvis, root);
    for (int c = 0; c < 3; ++c)
        placed.trans[static_cast<size_t>(c)] =
            static_cast<float>(place[c] - kRestPelvis[static_cast<size_t>(c)]);
    return placed;
}

}  // namespace doppel
