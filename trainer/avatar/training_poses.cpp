#include "trainer/avatar/training_poses.h"

#include <algorithm>
#include <map>

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
    if (!std::filesystem::exists(avatar / kFile)) return 0;
    const Poses trained = readPoses(avatar / kFile, true);
    const std::map<Row, size_t> known = framesByGivenPose(avatar / kFile, trained.theta.size());
    size_t taken = 0;
    for (size_t f = 0; f < capture.size(); ++f) {
        const auto found = known.find(rowOf(capture.theta[f], capture.trans[f]));
        if (found == known.end()) continue;
        capture.theta[f] = trained.theta[found->second];
        capture.trans[f] = trained.trans[found->second];
        ++taken;
    }
    return taken;
}

bool wasTrainedOn(const std::filesystem::path& avatar, const Motion& motion) {
    if (motion.cameras.empty() || !std::filesystem::exists(avatar / kFile)) return false;
    const size_t frames = readPoses(avatar / kFile, true).theta.size();
    const std::map<Row, size_t> known = framesByGivenPose(avatar / kFile, frames);
    for (size_t f = 0; f < motion.size(); ++f)
        if (known.contains(rowOf(motion.theta[f], motion.trans[f]))) return true;
    return false;
}

}  // namespace doppel
