// An avatar's folder that may change while it is looked at: a training that goes on in it.
#pragma once

#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "trainer/avatar/avatar.h"

namespace doppel {

struct LoadedAvatar {
    Avatar avatar;
    bool training = false;  // it is the state of a run that has not ended
    std::string stage;      // that the run is in: "stage mesh, 4 of 6"
    bool textured = true;   // false: no texture yet; the avatar has a grey one
};

// Reads AVATAR, or AVATAR/checkpoints/live where a run has left its state there more recently.
class LiveAvatar {
public:
    explicit LiveAvatar(std::filesystem::path folder);
    // Whether the folder is an avatar's, or that of a run that has left its state.
    static bool isAvatar(const std::filesystem::path& folder);
    // The avatar's folder that a path stands for: it, its avatar.toml, or the folder of a person
    // or a demo that has it as `avatar`.
    static std::optional<std::filesystem::path> at(const std::filesystem::path& path);

    // InputError where there is no avatar.
    std::shared_ptr<LoadedAvatar> load();
    // The avatar as it is now, where it has changed since the last time; null where it has not, or
    // is not there any more. Reads in the background: never waits.
    std::shared_ptr<LoadedAvatar> changed();

    const std::filesystem::path& folder() const { return folder_; }

private:
    using Stamp = std::pair<std::filesystem::path, std::filesystem::file_time_type>;
    static Stamp newest(const std::filesystem::path& folder);

    std::filesystem::path folder_;
    Stamp seen_;
    std::future<std::shared_ptr<LoadedAvatar>> reading_;
};

}  // namespace doppel
