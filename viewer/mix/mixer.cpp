#include "viewer/mix/mixer.h"

#include <algorithm>
#include <utility>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

void Mixer::add(const fs::path& folder) {
    Giver giver{folder, LiveAvatar(folder).load()};
    if (!giver.avatar->textured)
        throwInput("{}: expected an avatar with a texture, which gives clothes, found none",
                   folder.string());
    std::error_code error;
    const auto same = std::ranges::find_if(
        givers_, [&](const Giver& other) { return fs::equivalent(other.folder, folder, error); });
    if (same == givers_.end())
        givers_.push_back(std::move(giver));
    else
        *same = std::move(giver);
}

void Mixer::begin(std::shared_ptr<const LoadedAvatar> base, const fs::path& folder) {
    wish_ = {{folder, std::move(base)}, givers_, chosen};
    start();
}

void Mixer::start() {
    if (mixing_.valid() || !wish_) return;
    mixing_ = std::async(std::launch::async, mixed, *std::exchange(wish_, std::nullopt));
}

std::optional<Mixer::Mixed> Mixer::take() {
    start();
    if (!mixing_.valid() || mixing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
        return {};
    std::future<Mixed> ended = std::move(mixing_);
    const bool forgotten = wish_.has_value();
    start();
    if (forgotten) return {};
    return ended.get();
}

Mixer::Mixed Mixer::mixed(const Wish& wish) {
    auto avatar = std::make_shared<LoadedAvatar>();
    MixParts parts{.base = &wish.base.avatar->avatar};
    for (size_t p = 0; p < kMixParts.size(); ++p)
        if (const int chosen = wish.chosen[p])
            parts.*kMixParts[p].giver =
                &wish.givers.at(static_cast<size_t>(chosen - 1)).avatar->avatar;
    Mix mix = mixAvatars(parts);
    avatar->avatar = std::move(mix.avatar);
    std::map<std::string, std::string>& source = avatar->avatar.provenance;
    source["mixed"] = wish.base.folder.string();
    for (size_t p = 0; p < kMixParts.size(); ++p)
        if (const int chosen = wish.chosen[p])
            source[kMixParts[p].name] =
                wish.givers.at(static_cast<size_t>(chosen - 1)).folder.string();
    return {std::move(avatar), mix.capsWorn};
}

}  // namespace doppel
