#include "viewer/live_avatar.h"

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

std::shared_ptr<LoadedAvatar> read(const fs::path& folder, bool training) {
    auto loaded = std::make_shared<LoadedAvatar>();
    loaded->avatar = readAvatar(folder);
    loaded->training = training;
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
LiveAvatar::Stamp LiveAvatar::newest() const {
    Stamp newest;
    for (const fs::path& path : {folder_, liveFolder(folder_)}) {
        std::error_code error;
        fs::file_time_type time = fs::last_write_time(path / "avatar.toml", error);
        if (!error && (newest.first.empty() || time > newest.second)) newest = {path, time};
    }
    return newest;
}

std::shared_ptr<LoadedAvatar> LiveAvatar::load() {
    Stamp stamp = newest();
    std::shared_ptr<LoadedAvatar> loaded =
        read(stamp.first.empty() ? folder_ : stamp.first, stamp.first == liveFolder(folder_));
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
    Stamp stamp = newest();
    if (stamp.first.empty() || stamp == seen_) return nullptr;
    seen_ = stamp;
    reading_ =
        std::async(std::launch::async, read, stamp.first, stamp.first == liveFolder(folder_));
    return nullptr;
}

}  // namespace doppel
