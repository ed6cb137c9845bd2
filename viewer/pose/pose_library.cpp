#include "viewer/pose/pose_library.h"

#include <fmt/format.h>

#include <algorithm>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"
#include "trainer/data/output_folder.h"
#include "viewer/pose/pose_text.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kLargestFile = uint64_t{64} << 10;
constexpr size_t kLongestName = 60;  // bytes
constexpr std::string_view kEnding = ".json";

bool isName(const std::string& name) {
    return !name.empty() && name.size() <= kLongestName && name[0] != '.' &&
           std::ranges::none_of(name, [](char c) {
               return c == '/' || static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
           });
}

}  // namespace

PoseLibrary::PoseLibrary(fs::path folder) : folder_(std::move(folder)) { read(); }

fs::path PoseLibrary::fileOf(const std::string& name) const {
    return folder_ / (name + std::string(kEnding));
}

void PoseLibrary::read() {
    poses_.clear();
    std::error_code error;
    if (folder_.empty()) return;
    for (fs::directory_iterator entry(folder_, error), end; !error && entry != end;
         entry.increment(error)) {
        const std::string name = entry->path().stem().string();
        std::error_code ignored;
        if (entry->path().extension() != kEnding || !isName(name) ||
            !entry->is_regular_file(ignored))
            continue;
        try {
            const std::vector<uint8_t> bytes = readWholeFile(entry->path(), kLargestFile);
            KeptPose kept{name, {}};
            readPoseText({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, kept.pose);
            poses_.push_back(std::move(kept));
        } catch (const std::exception&) {
            continue;  // somebody else's
        }
    }
    std::ranges::sort(poses_, {}, &KeptPose::name);
    if (poses_.size() > kMost) poses_.resize(kMost);
}

size_t PoseLibrary::keep(const Pose& pose, const Betas& betas) {
    if (folder_.empty()) throwInput("there is no folder to keep poses in ($HOME is not set)");
    if (poses_.size() >= kMost) throwInput("{} poses are kept; forget one first", kMost);
    std::string name;
    for (int number = 1; name.empty() || fs::exists(fs::symlink_status(fileOf(name))); ++number)
        name = fmt::format("pose {}", number);
    createFolders(folder_);
    AtomicFile file(fileOf(name));
    file.write(poseText(pose, betas) + "\n");
    file.commit();
    read();
    return static_cast<size_t>(std::ranges::find(poses_, name, &KeptPose::name) - poses_.begin());
}

void PoseLibrary::rename(const std::string& name, const std::string& to) {
    if (name == to) return;
    if (!isName(to))
        throwInput("a pose's name has 1 to {} bytes, no / and no dot first; found \"{}\"",
                   kLongestName, printable(to));
    if (fs::exists(fs::symlink_status(fileOf(to)))) throwInput("\"{}\" is there already", to);
    std::error_code error;
    fs::rename(fileOf(name), fileOf(to), error);
    if (error) throwMachine("{}: {}", fileOf(to).string(), error.message());
    read();
}

void PoseLibrary::forget(const std::string& name) {
    std::error_code error;
    fs::remove(fileOf(name), error);
    if (error) throwMachine("{}: {}", fileOf(name).string(), error.message());
    read();
}

Pose withRotationsOf(const Pose& pose, const Pose& kept) {
    Pose result = pose;
    result.rotation = kept.rotation;
    return result;
}

}  // namespace doppel
