#include "viewer/live/live_avatar.h"

#include <optional>
#include <sstream>

#include "engine/error.h"
#include "trainer/avatar/checkpoint.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// By the run's record; a run that has just ended has none any more.
std::string stageOf(const fs::path& avatar) {
    try {
        const std::optional<RunRecord> run = readRunRecord(avatar);
        if (!run || !run->asked.contains("stages")) return "its last state";
        std::istringstream asked(run->asked.at("stages"));  // in their order
        int count = 0, done = 0;
        std::string now;
        for (std::string stage; std::getline(asked, stage, ',');) {
            ++count;
            if (run->isDone(stage))
                ++done;
            else if (now.empty())
                now = stage;
        }
        if (now.empty()) return "its last state";
        return fmt::format("stage {}, {} of {}", now, done + 1, count);
    } catch (const std::exception&) {
        return "its present state";  // being written
    }
}

std::shared_ptr<LoadedAvatar> read(const fs::path& folder, const fs::path& from) {
    auto loaded = std::make_shared<LoadedAvatar>();
    loaded->avatar = readAvatar(from);
    loaded->training = from == liveFolder(folder);
    if (loaded->training) loaded->stage = stageOf(folder);
    if (loaded->avatar.texture.empty()) {
        constexpr int kSize = 16;
        loaded->textured = false;
        loaded->avatar.textureSize = kSize;
        loaded->avatar.texture.assign(size_t{kSize} * kSize * 3, 0.7f);
    }
    return loaded;
}

}  // namespace

LiveAvatar::LiveAvatar(fs::path folder) : folder_(std::move(folder)) {}

// avatar.toml is the last file of an avatar to be written.
LiveAvatar::Stamp LiveAvatar::newest(const fs::path& folder) {
    Stamp newest;
    for (const fs::path& path : {folder, liveFolder(folder)}) {
        std::error_code error;
        fs::file_time_type time = fs::last_write_time(path / "avatar.toml", error);
        if (!error && (newest.first.empty() || time > newest.second)) newest = {path, time};
    }
    return newest;
}

bool LiveAvatar::isAvatar(const fs::path& folder) { return !newest(folder).first.empty(); }

std::optional<fs::path> LiveAvatar::at(const fs::path& path) {
    const fs::path folder = path.filename() == "avatar.toml" ? path.parent_path() : path;
    if (isAvatar(folder)) return folder;
    std::error_code ignored;
    const bool capture = fs::exists(folder / "poses.npz", ignored);  // that an avatar lies in
    if (!capture && isAvatar(folder / "avatar")) return folder / "avatar";
    return {};
}

std::shared_ptr<LoadedAvatar> LiveAvatar::load() {
    Stamp stamp = newest(folder_);
    std::shared_ptr<LoadedAvatar> loaded =
        read(folder_, stamp.first.empty() ? folder_ : stamp.first);
    seen_ = stamp;
    return loaded;
}

std::shared_ptr<LoadedAvatar> LiveAvatar::changed() {
    if (reading_.valid()) {
        if (reading_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return nullptr;
        try {
            return reading_.get();
        } catch (const std::exception&) {
            seen_ = {};  // it was being replaced, or went away: once more
            return nullptr;
        }
    }
    Stamp stamp = newest(folder_);
    if (stamp.first.empty() || stamp == seen_) return nullptr;
    seen_ = stamp;
    reading_ = std::async(std::launch::async, read, folder_, stamp.first);
    return nullptr;
}

}  // namespace doppel
