#include "trainer/motion/motion.h"

#include <algorithm>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// In the order of their descriptions, whatever the order in which they were linked.
std::vector<MotionFormat::Declaration>& formats() {
    static std::vector<MotionFormat::Declaration> all;
    return all;
}

// "A, B or C".
std::string knownFormats() {
    std::string text;
    for (size_t i = 0; i < formats().size(); ++i) {
        if (i > 0) text += i + 1 < formats().size() ? ", " : " or ";
        text += formats()[i].looks;
    }
    return text;
}

std::string beginOf(const fs::path& path) {
    const std::vector<uint8_t> begin = readFileHead(path, 4096);
    return {begin.begin(), begin.end()};
}

}  // namespace

MotionFormat::MotionFormat(const Declaration& declaration) {
    const auto before = [](const Declaration& a, const Declaration& b) {
        return std::string_view(a.looks) < b.looks;
    };
    formats().insert(std::upper_bound(formats().begin(), formats().end(), declaration, before),
                     declaration);
}

Motion Motion::subset(std::span<const size_t> indices) const {
    Motion part{source,   name, note, selectedRate(fps, indices), {}, {}, betas, shape,
                skeleton, {},   {}};
    for (size_t i : indices) {
        CHECK(i < size(), "frame {} is one of the motion's {}", i, size());
        part.theta.push_back(theta[i]);
        part.trans.push_back(trans[i]);
        if (!cameras.empty()) part.cameras.push_back(cameras[i]);
        if (!views.empty()) part.views.push_back(views[i]);
    }
    return part;
}

namespace {

// By the name's ending, or else by content; null where none knows it.
const MotionFormat::Declaration* formatOf(const fs::path& path) {
    std::error_code error;
    std::string begin;
    if (!fs::is_directory(path, error)) {
        const std::string ending = endingOf(path);
        for (const auto& format : formats())
            if (!ending.empty() && ending == format.ending) return &format;
        begin = beginOf(path);
    }
    for (const auto& format : formats())
        if (format.recognises(path, begin)) return &format;
    return nullptr;
}

}  // namespace

bool isMotion(const fs::path& path) {
    std::error_code error;
    return fs::exists(path, error) && formatOf(path) != nullptr;
}

Motion readMotion(const fs::path& path) {
    std::error_code error;
    if (!fs::exists(path, error))
        throwInput("{}: expected a motion: {}, found nothing", path.string(), knownFormats());
    if (const MotionFormat::Declaration* format = formatOf(path)) return format->read(path);
    throwInput("{}: expected a motion: {}, found another kind of file", path.string(),
               knownFormats());
}

Motion throughCameras(Motion motion, const fs::path& path) {
    Cameras cameras = readCameras(path, motion.size());
    for (size_t f = 0; f < motion.size(); ++f)
        movePose(cameras.extrinsics[f], motion.theta[f], motion.trans[f]);
    motion.cameras = std::move(cameras.cameras);
    motion.views = std::move(cameras.extrinsics);
    if (std::ranges::all_of(motion.views, [](const RigidMotion& v) { return v == RigidMotion{}; }))
        motion.views.clear();
    return motion;
}

}  // namespace doppel
