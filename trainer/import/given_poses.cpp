#include "trainer/import/given_poses.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/progress.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/clip.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr int kRows = 240;              // of the pictures that are compared
constexpr size_t kTried = 8;            // frames on which readings are tried
constexpr int64_t kMostBetween = 12;    // pictures without a pose that are filled
constexpr double kLeastOverlap = .3;    // below that these are poses of somebody else
constexpr double kClearlyBetter = .01;  // overlap by which a less likely reading is taken

// ---- which picture is which ---------------------------------------------------------------------

// The number of a frame that doppel cut from a clip.
std::optional<int64_t> numberIn(const std::string& name) {
    int64_t number = 0;
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), number);
    if (error != std::errc() || end != name.data() + name.size() || number < 0) return {};
    return number;
}

struct Pictures {
    std::vector<int64_t> numbers;  // of the capture's frames
    ImageSize size;                // of the source's pictures, before frames were scaled
};

// Where frames and poses both have names, poses are given the numbers of the frames.
Pictures matchPictures(const Capture& capture, const GivenPosesRequest& request,
                       Estimates& estimates) {
    std::error_code error;
    Pictures pictures;
    const Camera& first = capture.frames[0].camera;
    pictures.size = {first.width, first.height};
    bool numbered = true;
    for (const Frame& frame : capture.frames) {
        const auto number = numberIn(frame.name);
        numbered = numbered && number;
        pictures.numbers.push_back(number.value_or(0));
    }
    std::vector<std::string> stems;  // by number
    if (numbered && fs::is_regular_file(request.source, error)) {
        const VideoReader video(request.source);
        pictures.size = {video.width(), video.height()};
        return pictures;
    }
    const auto files = picturesOfFolder(request.source);
    if (numbered && !files.empty()) {
        pictures.size = imageSize(files[0]);
        for (const fs::path& file : files) stems.push_back(file.stem().string());
    } else if (!numbered) {
        for (size_t f = 0; f < capture.size(); ++f) {
            pictures.numbers[f] = static_cast<int64_t>(f);
            stems.push_back(capture.frames[f].name);
        }
    }
    std::map<std::string, int64_t> byName;
    for (size_t i = 0; i < stems.size(); ++i) byName[stems[i]] = static_cast<int64_t>(i);
    std::set<std::string> common;
    for (const EstimatedPerson& person : estimates.people)
        for (const EstimatedPose& pose : person.poses)
            if (byName.contains(pose.name)) common.insert(pose.name);
    if (2 * common.size() < std::min(stems.size(), capture.size()) || common.empty())
        return pictures;
    for (EstimatedPerson& person : estimates.people) {
        std::erase_if(person.poses,
                      [&](const EstimatedPose& pose) { return !byName.contains(pose.name); });
        for (EstimatedPose& pose : person.poses) pose.picture = byName.at(pose.name);
        std::ranges::stable_sort(person.poses, {}, &EstimatedPose::picture);
    }
    return pictures;
}

// ---- masks --------------------------------------------------------------------------------------

// Where a mask is: the middle, and the height, of what lies between its outermost pixels but for
// one in a hundred on either side.
struct Extent {
    double x = 0, y = 0, height = 0;
    double left = 0, right = 0, top = 0, bottom = 0;
    bool whole = false;  // does not touch the picture's top or bottom
};

std::optional<Extent> extentOf(const std::vector<uint8_t>& mask, int width, int height) {
    std::vector<int64_t> rows(static_cast<size_t>(height)), columns(static_cast<size_t>(width));
    int64_t count = 0;
    for (size_t y = 0, i = 0; y < rows.size(); ++y)
        for (size_t x = 0; x < columns.size(); ++x, ++i)
            if (mask[i] > 0) ++rows[y], ++columns[x], ++count;
    if (count < 4) return {};
    const auto ends = [&](const std::vector<int64_t>& sums) {
        const int64_t few = count / 100;
        size_t low = 0, high = sums.size() - 1;
        for (int64_t sum = sums[low]; sum <= few; sum += sums[++low]) {
        }
        for (int64_t sum = sums[high]; sum <= few; sum += sums[--high]) {
        }
        return std::pair(static_cast<double>(low), static_cast<double>(high + 1));
    };
    Extent extent;
    std::tie(extent.left, extent.right) = ends(columns);
    std::tie(extent.top, extent.bottom) = ends(rows);
    extent.x = (extent.left + extent.right) / 2;
    extent.y = (extent.top + extent.bottom) / 2;
    extent.height = extent.bottom - extent.top;
    extent.whole = rows.front() == 0 && rows.back() == 0;
    return extent;
}

Camera scaledCamera(Camera camera, int width, int height) {
    const double scale = static_cast<double>(height) / camera.height;
    camera.fx *= scale, camera.fy *= scale, camera.cx *= scale, camera.cy *= scale;
    camera.width = width, camera.height = height;
    return camera;
}

// ---- the search ---------------------------------------------------------------------------------

class Search {
public:
    Search(const Capture& capture, const Estimates& estimates, const Pictures& pictures, bool known,
           const DrawBody& drawBody)
        : capture_(capture),
          estimates_(estimates),
          pictures_(pictures),
          known_(known),
          draw_(drawBody),
          cache_(capture, size_t{64} << 20),
          masks_(capture.size()) {}

    struct Found {
        PlacedPose placed;  // the camera is of the source's size
        size_t person = 0;
        double overlap = 0;
        bool filled = false;
    };

    // The pose of a person in a frame, by one reading.
    std::optional<Found> poseAt(size_t frame, size_t person, size_t reading, double away) {
        const auto& poses = estimates_.people[person].poses;
        const int64_t number = pictures_.numbers[frame] - first_;
        const auto after = std::ranges::lower_bound(poses, number, {}, &EstimatedPose::picture);
        if (after == poses.end()) return {};
        Found found;
        found.person = person;
        if (after->picture == number) {
            found.placed = place(frame, *after, reading);
        } else {
            if (after == poses.begin()) return {};
            const auto before = after - 1;
            if (after->picture - before->picture > kMostBetween + 1) return {};
            const PlacedPose one = place(frame, *before, reading),
                             other = place(frame, *after, reading);
            const double share = static_cast<double>(number - before->picture) /
                                 static_cast<double>(after->picture - before->picture);
            found.placed = one;
            found.placed.theta = thetaBetween(one.theta, other.theta, share);
            found.placed.trans = transBetween(one.trans, other.trans, share);
            found.filled = true;
        }
        for (size_t c = 0; c < 3; ++c)
            found.placed.trans[c] = static_cast<float>(
                away * (double(found.placed.trans[c]) + kRestPelvis[c]) - kRestPelvis[c]);
        return found;
    }

    // Of the people in a frame the one whose body covers the mask best; its overlap is known where
    // there is a mask, and `always` it is measured or there are several.
    std::optional<Found> bestAt(size_t frame, size_t reading, double away, bool always) {
        std::vector<Found> near;
        const std::optional<Extent> mask = maskExtent(frame);
        const bool nowhere = isNowhere(reading);
        for (size_t person = 0; person < estimates_.people.size(); ++person) {
            auto found = poseAt(frame, person, reading, away);
            if (found && (!capture_.frames[frame].mask ||
                          (mask && (nowhere || isNear(*found, *mask, maskOf(frame).height)))))
                near.push_back(std::move(*found));
        }
        if (near.empty()) return {};
        if (!capture_.frames[frame].mask)
            return *std::ranges::max_element(near, {}, [&](const Found& found) {
                return estimates_.people[found.person].poses.size();
            });
        for (Found& found : near) {
            if (nowhere) standInMask(frame, found, reading);
            if (always || near.size() > 1) found.overlap = overlapOf(frame, found.placed);
        }
        return *std::ranges::max_element(near, {}, &Found::overlap);
    }

    // The picture of the clip that is the file's first one.
    void countFrom(int64_t first) { first_ = first; }

    struct Reading {
        double overlap = 0;  // mean over the frames that were tried
        double away = 1;     // factor of the distance from the camera
    };
    Reading tryReading(size_t reading, const std::vector<size_t>& frames) {
        const auto score = [&](double away, std::vector<double>* ratios) {
            double sum = 0;
            for (const size_t f : frames) {
                const auto best = bestAt(f, reading, away, true);
                if (!best) continue;
                sum += best->overlap;
                const auto mask = maskExtent(f);
                if (ratios == nullptr || !mask || !mask->whole) continue;
                if (const auto body = bodyExtent(f, best->placed); body && body->whole)
                    ratios->push_back(body->height / mask->height);
            }
            return sum / static_cast<double>(frames.size());
        };
        std::vector<double> ratios;
        Reading result;
        result.overlap = score(1, &ratios);
        if (ratios.empty() || isNowhere(reading)) return result;
        std::ranges::nth_element(ratios, ratios.begin() + std::ptrdiff_t(ratios.size() / 2));
        const double ratio = ratios[ratios.size() / 2];
        if (!(ratio > .5 && ratio < 2)) return result;
        const double other = score(ratio, nullptr);
        if (other > result.overlap) result = {other, ratio};
        return result;
    }

private:
    bool isNowhere(size_t reading) const {
        return estimates_.people[0].poses[0].views[reading].kind == EstimatedView::Kind::Nowhere;
    }

    PlacedPose place(size_t frame, const EstimatedPose& pose, size_t reading) const {
        const Camera clip = scaledCamera(capture_.frames[frame].camera, pictures_.size.width,
                                         pictures_.size.height);
        return placePose(pose, pose.views[reading], clip, known_);
    }

    struct Mask {
        int width = 0, height = 0;
        std::vector<uint8_t> values;
        std::optional<Extent> extent;
    };
    const Mask& maskOf(size_t frame) {
        Mask& mask = masks_[frame];
        if (mask.width > 0) return mask;
        const auto picture = cache_.load(frame);
        mask.height = std::min(kRows, picture->height);
        mask.width = std::max(1, static_cast<int>(std::lround(static_cast<double>(picture->width) *
                                                              mask.height / picture->height)));
        Image image(picture->width, picture->height, 1);
        for (size_t i = 0; i < picture->mask.size(); ++i)
            image.data[i] = picture->mask[i] > 0 ? 255 : 0;
        mask.values = resize(image, mask.width, mask.height).data;
        for (uint8_t& value : mask.values) value = value >= 128 ? 255 : 0;
        mask.extent = extentOf(mask.values, mask.width, mask.height);
        return mask;
    }
    std::optional<Extent> maskExtent(size_t frame) {
        if (!capture_.frames[frame].mask) return {};
        return maskOf(frame).extent;
    }

    std::vector<uint8_t> bodyMask(size_t frame, const PlacedPose& placed) {
        const Mask& mask = maskOf(frame);
        return draw_(scaledCamera(placed.camera, mask.width, mask.height), placed.theta,
                     placed.trans, capture_.betas)
            .mask;
    }
    double overlapOf(size_t frame, const PlacedPose& placed) {
        return intersectionOverUnion(bodyMask(frame, placed), maskOf(frame).values);
    }
    std::optional<Extent> bodyExtent(size_t frame, const PlacedPose& placed) {
        const Mask& mask = maskOf(frame);
        return extentOf(bodyMask(frame, placed), mask.width, mask.height);
    }

    // Whether the pelvis is seen within the mask or beside it: others need not be drawn.
    bool isNear(const Found& found, const Extent& mask, int rows) const {
        const auto pelvis = [&](size_t c) {
            return double(found.placed.trans[c]) + kRestPelvis[c];
        };
        if (!(pelvis(2) > .05)) return false;
        const Camera& camera = found.placed.camera;
        const auto [u, v] = camera.project({pelvis(0), pelvis(1), pelvis(2)});
        const double scale = static_cast<double>(rows) / camera.height;
        const double about = .3 * mask.height, x = u * scale, y = v * scale;
        return x > mask.left - about && x < mask.right + about && y > mask.top - about &&
               y < mask.bottom + about;
    }

    // Puts a body that is nowhere where it covers the mask's extent.
    void standInMask(size_t frame, Found& found, size_t reading) {
        const Mask& mask = maskOf(frame);
        if (!mask.extent) return;
        const bool nominal = estimates_.people[found.person].poses[0].views[reading].nominal;
        const Theta given = found.placed.theta;
        for (int step = 0; step < 4; ++step) {
            Trans& trans = found.placed.trans;
            const auto body = bodyExtent(frame, found.placed);
            if (!body) return;
            const Camera camera = scaledCamera(found.placed.camera, mask.width, mask.height);
            glm::dvec3 pelvis(trans[0], trans[1], trans[2]);
            for (int c = 0; c < 3; ++c) pelvis[c] += kRestPelvis[static_cast<size_t>(c)];
            // The body keeps its place in the picture while it moves away, then goes across.
            pelvis *= std::clamp(body->height / mask.extent->height, .25, 4.);
            pelvis.x += (mask.extent->x - body->x) * pelvis.z / camera.fx;
            pelvis.y += (mask.extent->y - body->y) * pelvis.z / camera.fy;
            if (nominal) {
                const glm::dquat turn = turnBetween({0, 0, 1}, glm::normalize(pelvis));
                setJointRotation(found.placed.theta, joint::kPelvis,
                                 turn * jointRotation(given, joint::kPelvis));
            }
            for (int c = 0; c < 3; ++c)
                trans[static_cast<size_t>(c)] =
                    static_cast<float>(pelvis[c] - kRestPelvis[static_cast<size_t>(c)]);
        }
    }

    const Capture& capture_;
    const Estimates& estimates_;
    const Pictures& pictures_;
    bool known_;
    int64_t first_ = 0;
    const DrawBody& draw_;
    FrameCache cache_;
    std::vector<Mask> masks_;
};

// Programs that were given a part of a clip count from its first picture, while its name still has
// the number in the clip, from 0 or from 1.
std::vector<int64_t> firstPictures(const Estimates& estimates) {
    std::optional<int64_t> ahead;
    for (const EstimatedPerson& person : estimates.people)
        for (const EstimatedPose& pose : person.poses) {
            const auto number = numberIn(pose.name);
            if (!number || (ahead && *ahead != *number - pose.picture)) return {0};
            ahead = *number - pose.picture;
        }
    if (!ahead || *ahead < 2) return {0};
    return {0, *ahead - 1, *ahead};
}

// Frames in which somebody is, evenly over all of them.
std::vector<size_t> framesToTry(Search& search, const Capture& capture, size_t people) {
    std::vector<size_t> posed;
    for (size_t f = 0; f < capture.size(); ++f)
        for (size_t person = 0; person < people; ++person)
            if (capture.frames[f].mask && search.poseAt(f, person, 0, 1)) {
                posed.push_back(f);
                break;
            }
    std::vector<size_t> tried;
    const size_t count = std::min(posed.size(), kTried);
    for (size_t i = 0; i < count; ++i)
        tried.push_back(posed[(2 * i + 1) * posed.size() / (2 * count)]);
    return tried;
}

// A clip's quality.json, changed; nothing where there is none.
template <typename Change>
void changeQuality(const fs::path& workspace, Change change) {
    const fs::path path = workspace / "quality.json";
    std::error_code error;
    if (workspace.empty() || !fs::exists(path, error)) return;
    const std::vector<uint8_t> bytes = readWholeFile(path);
    auto json = nlohmann::ordered_json::parse(bytes.begin(), bytes.end());
    change(json);
    AtomicFile file(path);
    file.write(json.dump(1) + "\n");
    file.commit();
}

// What belongs to frames that are left out goes from the workspace.
void leaveOut(Capture& capture, const std::vector<size_t>& kept, const fs::path& workspace) {
    std::vector<bool> stays(capture.size());
    for (const size_t f : kept) stays[f] = true;
    std::error_code ignored;
    for (size_t f = 0; f < capture.size(); ++f) {
        if (stays[f] || workspace.empty()) continue;
        const Frame& frame = capture.frames[f];
        if (frame.image.parent_path() == workspace / "images") fs::remove(frame.image, ignored);
        if (frame.mask && frame.mask->parent_path() == workspace / "masks")
            fs::remove(*frame.mask, ignored);
    }
    changeQuality(workspace, [&](nlohmann::ordered_json& json) {
        for (size_t f = 0; f < capture.size(); ++f) {
            if (stays[f]) continue;
            const auto frame = json["per_frame"].find(capture.frames[f].name);
            nlohmann::ordered_json left{{"frame", numberIn(capture.frames[f].name).value_or(0)},
                                        {"why", "no pose was given"}};
            if (frame != json["per_frame"].end()) {
                if (frame->contains("picture")) left["picture"] = frame->at("picture");
                json["per_frame"].erase(frame);
            }
            json["left_out"].push_back(std::move(left));
        }
        json["frames"] = kept.size();
    });
    const fs::path landmarks = workspace / "landmarks.npz";
    if (!workspace.empty() && fs::exists(landmarks, ignored)) {
        const Npz all = readNpz(landmarks);
        Npz part;
        for (const auto& [name, array] : all) {
            Array rows = array;
            const size_t size = array.bytes.size() / capture.size();
            rows.shape[0] = static_cast<int64_t>(kept.size());
            rows.bytes.clear();
            for (const size_t f : kept)
                rows.bytes.insert(rows.bytes.end(), array.bytes.begin() + std::ptrdiff_t(f * size),
                                  array.bytes.begin() + std::ptrdiff_t((f + 1) * size));
            part.set(name, std::move(rows));
        }
        writeNpz(landmarks, part, false);
    }
    capture = capture.subset(kept);
}

}  // namespace

GivenPoses takeGivenPoses(Capture& capture, const GivenPosesRequest& request,
                          const DrawBody& drawBody) {
    Estimates estimates = readEstimates(request.poses);
    const Pictures pictures = matchPictures(capture, request, estimates);
    std::erase_if(estimates.people, [](const EstimatedPerson& p) { return p.poses.empty(); });
    // Only a clip's camera is a guess, and says so.
    const auto camera = capture.source.find("camera");
    const bool known =
        camera == capture.source.end() || camera->second.find("guessed") == std::string::npos;
    Search search(capture, estimates, pictures, known, drawBody);

    std::vector<size_t> tried;
    size_t reading = 0;
    int64_t first = 0;
    Search::Reading best;
    for (const int64_t from : firstPictures(estimates)) {
        search.countFrom(from);
        const auto frames = framesToTry(search, capture, estimates.people.size());
        for (size_t r = 0; r < estimates.readings.size() && !frames.empty(); ++r) {
            const Search::Reading found = search.tryReading(r, frames);
            if (!tried.empty() && found.overlap <= best.overlap + kClearlyBetter) continue;
            reading = r, best = found, first = from, tried = frames;
        }
    }
    search.countFrom(first);
    if (!tried.empty() && best.overlap < kLeastOverlap)
        throwInput(
            "{}: expected poses of the person in the masks, found an overlap (IoU) of {:.2f} with "
            "them in the mean of {} frames; are they of another clip, or of pictures that were cut "
            "or scaled?",
            request.poses.string(), best.overlap, tried.size());

    const Camera before = capture.frames[0].camera;
    std::vector<size_t> kept;
    std::set<size_t> people;
    size_t filled = 0;
    const size_t frames = capture.size();
    Progress progress("take the poses", int64_t(frames));
    for (size_t f = 0; f < frames; ++f) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(f) + 1);
        const auto found = search.bestAt(f, reading, best.away, false);
        if (!found) continue;
        kept.push_back(f);
        people.insert(found->person);
        if (found->filled) ++filled;
        Frame& frame = capture.frames[f];
        frame.camera = scaledCamera(found->placed.camera, frame.camera.width, frame.camera.height);
        capture.theta[f] = found->placed.theta;
        capture.trans[f] = found->placed.trans;
    }
    if (kept.empty())
        throwInput(
            "{}: expected poses of the capture's frames, found poses of other pictures: {} frames "
            "from {} on, poses from picture {} on",
            request.poses.string(), frames, pictures.numbers[0],
            estimates.people.empty() ? 0 : estimates.people[0].poses[0].picture);

    GivenPoses given;
    given.told = estimates.program;
    given.measured = estimates.measured;
    if (estimates.people.size() > 1) {
        std::string names;
        for (const size_t person : people)
            names +=
                fmt::format("{}{}", names.empty() ? "" : " and ", estimates.people[person].name);
        given.told += fmt::format(", person {} of {} people", names, estimates.people.size());
    }
    if (!estimates.readings[reading].empty())
        given.told += fmt::format(", {}", estimates.readings[reading]);
    if (first > 0) given.told += fmt::format(", from picture {} on", first);
    if (tried.empty()) given.told += ", not compared with masks, of which there are none";
    if (filled > 0) given.filled = fmt::format("{} between their neighbours", filled);
    if (kept.size() < frames) {
        given.filled += fmt::format("{}frames left out, which have none: {}",
                                    given.filled.empty() ? "" : ", ", frames - kept.size());
        leaveOut(capture, kept, request.workspace);
    }
    const Camera& lens = capture.frames[0].camera;
    // The way to the source's pixels and back rounds.
    if (std::abs(lens.fx - before.fx) > 1e-6 * before.fx || std::abs(lens.cx - before.cx) > 1e-6) {
        const double degrees =
            2 * std::atan(std::max(lens.width, lens.height) / (2 * lens.fx)) * 180 / std::acos(-1.);
        capture.source["camera"] =
            fmt::format("{:.0f} degrees along the longer side, as {}'s poses were found with",
                        degrees, estimates.program);
    }
    capture.source["poses"] = "given: " + given.told;
    capture.source.erase("heads");  // where they look is the given poses' as well
    if (!given.filled.empty()) capture.source["poses_filled"] = given.filled;
    for (const EstimatedPerson& person : estimates.people)
        if (people.size() == 1 && &person == &estimates.people[*people.begin()] && person.betas)
            capture.sourceBetas = person.betas;
    return given;
}

void notePoseOverlaps(const fs::path& workspace, const Capture& capture,
                      std::span<const double> overlaps) {
    changeQuality(workspace, [&](nlohmann::ordered_json& json) {
        double sum = 0;
        for (size_t f = 0; f < overlaps.size(); ++f) {
            json["per_frame"][capture.frames[f].name]["pose_iou"] = overlaps[f];
            sum += overlaps[f];
        }
        if (!overlaps.empty()) json["pose_iou"] = sum / static_cast<double>(overlaps.size());
    });
}

}  // namespace doppel
