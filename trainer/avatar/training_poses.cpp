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
    const std::map<Row, size_t> known = framesByGivenPose(avatar / kFile, trained.theta.size());
    std::vector<TrainedFrame> found;
    for (size_t f = 0; f < theta.size(); ++f)
        if (const auto at = known.find(rowOf(theta[f], trans[f])); at != known.end())
            found.push_back({f, trained.theta[at->second], trained.trans[at->second]});
    return found;
}

}  // namespace

void writeTrainingPoses(const std::filesystem::path& avatar, const Capture& given,
                        const Capture& trained) {
    CHECK(given.size() == trained.size(), "{} frames are not {}", given.size(), trained.size());
    Npz arrays = posesArrays(trained.theta, trained.trans, trained.betas);
    std::vector<float> rows;
    for (size_t f = 0; f < given.size(); ++f)
        std::ranges::copy(rowOf(given.theta[f], given.trans[f]), std::back_inserter(rows));
    arrays.set("given", Array::f32({static_cast<int64_t>(given.size()), int64_t{kRow}}, rows));
    writeNpz(avatar / kFile, arrays, true);
}

size_t takeTrainingPoses(const std::filesystem::path& avatar, Capture& capture) {
    const std::vector<TrainedFrame> known = framesAmong(avatar, capture.theta, capture.trans);
    for (const TrainedFrame& trained : known) {
        capture.theta[trained.frame] = trained.theta;
        capture.trans[trained.frame] = trained.trans;
    }
    return known.size();
}

std::vector<TrainedFrame> trainedFrames(const std::filesystem::path& avatar, const Motion& motion) {
    if (motion.cameras.empty()) return {};
    return framesAmong(avatar, motion.theta, motion.trans);
}

bool wasTrainedOn(const std::filesystem::path& avatar, const Motion& motion) {
    return !trainedFrames(avatar, motion).empty();
}

}  // namespace doppel
