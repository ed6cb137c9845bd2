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
    const std::filesystem::path path = avatar / kFile;
    if (!std::filesystem::exists(path)) return 0;
    const Poses trained = readPoses(path, true);
    const std::vector<float> rows =
        readNpz(path)
            .at("given")
            .requireShape({static_cast<int64_t>(trained.theta.size()), int64_t{kRow}})
            .toF32();
    std::map<Row, size_t> known;
    for (size_t f = 0; f < trained.theta.size(); ++f) {
        Row row;
        std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(f * kRow), kRow, row.begin());
        known.emplace(row, f);
    }
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

}  // namespace doppel
