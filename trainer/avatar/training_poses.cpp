#include "trainer/avatar/training_poses.h"

#include <algorithm>
#include <map>
#include <span>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr const char* kFile = "poses.npz";
constexpr size_t kRow = kThetaSize + 3;
using Row = std::array<float, kRow>;

Row rowOf(const Theta& theta, const Trans& trans) {
    Row row;
    std::ranges::copy(trans, std::ranges::copy(theta, row.begin()).out);
    return row;
}

constexpr Gain kNoGain{1, 1, 1};

// Of so many frames; empty where there are none.
std::vector<Gain> gainsIn(const std::filesystem::path& path, size_t frames) {
    const Npz arrays = readNpz(path);
    const Array* gain = arrays.find("gain");
    if (!gain) return {};
    const std::vector<float> values = gain->requireShape({static_cast<int64_t>(frames), 3}).toF32();
    std::vector<Gain> gains(frames);
    for (size_t i = 0; i < values.size(); ++i) {
        if (!(values[i] >= kLeastGain && values[i] <= kMostGain))
            throwInput("{}: gain: expected numbers from {} to {}, found {} in frame {}",
                       path.string(), kLeastGain, kMostGain, values[i], i / 3);
        gains[i / 3][i % 3] = values[i];
    }
    return gains;
}

// Numbers of an avatar's training frames, of which there are so many, by the poses that the capture
// had.
std::map<Row, size_t> framesByGivenPose(const std::filesystem::path& path, size_t frames) {
    const std::vector<float> rows = readNpz(path)
                                        .at("given")
                                        .requireShape({static_cast<int64_t>(frames), int64_t{kRow}})
                                        .toF32();
    std::map<Row, size_t> known;
    for (size_t f = 0; f < frames; ++f) {
        Row row;
        std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(f * kRow), kRow, row.begin());
        known.emplace(row, f);
    }
    return known;
}

// Those of these poses that the avatar's training was given.
std::vector<TrainedFrame> framesAmong(const std::filesystem::path& avatar,
                                      std::span<const Theta> theta, std::span<const Trans> trans) {
    if (!std::filesystem::exists(avatar / kFile)) return {};
    const Poses trained = readPoses(avatar / kFile, true);
    const std::vector<Gain> gains = gainsIn(avatar / kFile, trained.theta.size());
    const std::map<Row, size_t> known = framesByGivenPose(avatar / kFile, trained.theta.size());
    std::vector<TrainedFrame> found;
    for (size_t f = 0; f < theta.size(); ++f)
        if (const auto at = known.find(rowOf(theta[f], trans[f])); at != known.end())
            found.push_back({f, trained.theta[at->second], trained.trans[at->second],
                             gains.empty() ? kNoGain : gains[at->second]});
    return found;
}

}  // namespace

Npz posesOf(const Capture& capture) {
    Npz arrays = posesArrays(capture.theta, capture.trans, capture.betas);
    if (capture.gains.empty()) return arrays;
    std::vector<float> values;
    for (const Gain& gain : capture.gains) values.insert(values.end(), gain.begin(), gain.end());
    arrays.set("gain", Array::f32({static_cast<int64_t>(capture.size()), 3}, values));
    return arrays;
}

void takePoses(const std::filesystem::path& path, Capture& capture) {
    const Poses poses = readPoses(path, true);
    if (poses.theta.size() != capture.size())
        throwInput("{}: expected {} poses, as many as the capture has frames, found {}",
                   path.string(), capture.size(), poses.theta.size());
    capture.gains = gainsIn(path, capture.size());
    capture.theta = poses.theta;
    capture.trans = poses.trans;
    capture.betas = poses.betas;
}

void writeTrainingPoses(const std::filesystem::path& avatar, const Capture& given,
                        const Capture& trained) {
    CHECK(given.size() == trained.size(), "{} frames are not {}", given.size(), trained.size());
    Npz arrays = posesOf(trained);
    std::vector<float> rows;
    for (size_t f = 0; f < given.size(); ++f)
        std::ranges::copy(rowOf(given.theta[f], given.trans[f]), std::back_inserter(rows));
    arrays.set("given", Array::f32({static_cast<int64_t>(given.size()), int64_t{kRow}}, rows));
    writeNpz(avatar / kFile, arrays, true);
}

size_t takeTrainingPoses(const std::filesystem::path& avatar, Capture& capture) {
    const std::vector<TrainedFrame> known = framesAmong(avatar, capture.theta, capture.trans);
    const bool gained = std::ranges::any_of(
        known, [](const TrainedFrame& trained) { return trained.gain != kNoGain; });
    if (gained) capture.gains.resize(capture.size(), kNoGain);
    for (const TrainedFrame& trained : known) {
        capture.theta[trained.frame] = trained.theta;
        capture.trans[trained.frame] = trained.trans;
        if (gained) capture.gains[trained.frame] = trained.gain;
    }
    return known.size();
}

std::vector<TrainedFrame> trainedFrames(const std::filesystem::path& avatar, const Motion& motion) {
    if (motion.cameras.empty()) return {};
    return framesAmong(avatar, motion.theta, motion.trans);
}

std::optional<TrainedOn> trainedOn(const std::filesystem::path& folder, const Avatar& avatar) {
    std::vector<std::filesystem::path> places;
    if (const auto named = avatar.provenance.find("capture_folder");
        named != avatar.provenance.end())
        places.push_back(folder / named->second);
    // By the names on the way here: the avatar may be a link to elsewhere.
    const std::filesystem::path own = std::filesystem::absolute(folder / "").lexically_normal();
    places.push_back(own.parent_path().parent_path() / "capture");
    for (const std::filesystem::path& place : places) {
        try {
            if (!std::filesystem::is_directory(place)) continue;
            Motion motion = readMotion(place);
            std::vector<TrainedFrame> frames = trainedFrames(folder, motion);
            if (!frames.empty())
                return TrainedOn{place.lexically_normal(), std::move(frames),
                                 std::move(motion.cameras)};
        } catch (const std::exception&) {
            continue;  // it was moved away, or is another one now: nobody has asked for it
        }
    }
    return {};
}

std::string captureFolder(const std::filesystem::path& avatar,
                          const std::filesystem::path& capture) {
    std::error_code error;
    const std::filesystem::path path = std::filesystem::proximate(capture, avatar, error);
    return error ? std::string() : path.generic_string();
}

void takeTrainingPoses(std::span<const TrainedFrame> known, Motion& motion) {
    // What training changed of a frame.
    struct Correction {
        std::array<glm::dquat, kJointCount> turn;
        glm::dvec3 way;
    };
    const auto placeOf = [](const Trans& t) { return glm::dvec3(t[0], t[1], t[2]); };
    std::vector<Correction> corrections;
    for (const TrainedFrame& trained : known) {
        Correction& correction = corrections.emplace_back();
        for (size_t j = 0; j < kJointCount; ++j)
            correction.turn[j] = glm::inverse(jointRotation(motion.theta[trained.frame], j)) *
                                 jointRotation(trained.theta, j);
        correction.way = placeOf(trained.trans) - placeOf(motion.trans[trained.frame]);
    }
    const double reach = motion.fps / 2;  // frames
    auto next = known.begin();            // the first that is not before the frame
    for (size_t f = 0; f < motion.size(); ++f) {
        while (next != known.end() && next->frame < f) ++next;
        if (next != known.end() && next->frame == f) {
            motion.theta[f] = next->theta;
            motion.trans[f] = next->trans;
            continue;
        }
        const auto gap = [&](auto at) {
            return std::abs(static_cast<double>(at->frame) - static_cast<double>(f));
        };
        const auto before = next == known.begin() ? known.end() : next - 1;
        const bool hasBefore = before != known.end() && gap(before) <= reach;
        const bool hasNext = next != known.end() && gap(next) <= reach;
        if (!hasBefore && !hasNext) continue;
        const double share = !hasBefore ? 1
                             : !hasNext ? 0
                                        : gap(before) / (gap(before) + gap(next));
        const Correction& a = corrections[size_t((hasBefore ? before : next) - known.begin())];
        const Correction& b = corrections[size_t((hasNext ? next : before) - known.begin())];
        for (size_t j = 0; j < kJointCount; ++j)
            setJointRotation(
                motion.theta[f], j,
                jointRotation(motion.theta[f], j) * glm::slerp(a.turn[j], b.turn[j], share));
        const glm::dvec3 place = placeOf(motion.trans[f]) + glm::mix(a.way, b.way, share);
        for (int k = 0; k < 3; ++k) motion.trans[f][size_t(k)] = static_cast<float>(place[k]);
    }
}

}  // namespace doppel
