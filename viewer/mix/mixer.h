// An avatar that is dressed by others, in the background: a mix takes about a second.
#pragma once

#include <array>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <vector>

#include "trainer/avatar/mix/mix.h"
#include "viewer/live/live_avatar.h"

namespace doppel {

class Mixer {
public:
    struct Giver {
        std::filesystem::path folder;
        std::shared_ptr<const LoadedAvatar> avatar;
    };
    // One who is among them is read anew. InputError, with nothing changed, where there is no
    // avatar, or one without a texture.
    void add(const std::filesystem::path& folder);
    const std::vector<Giver>& givers() const { return givers_; }

    // Who gives each of kMixParts: 0 the avatar itself, else the giver of that number less one.
    using Choice = std::array<int, kMixParts.size()>;
    Choice chosen{};
    bool mixes() const { return chosen != Choice{}; }

    // What is chosen, onto the avatar of a folder; after the mix that is under way, which is
    // forgotten.
    void begin(std::shared_ptr<const LoadedAvatar> base, const std::filesystem::path& folder);
    bool busy() const { return mixing_.valid() || wish_; }
    struct Mixed {
        std::shared_ptr<LoadedAvatar> avatar;
        bool capsWorn = true;  // Mix::capsWorn
    };
    // Once it has ended. InputError as mixAvatars'.
    std::optional<Mixed> take();

private:
    struct Wish {
        Giver base;
        std::vector<Giver> givers;
        Choice chosen{};
    };
    static Mixed mixed(const Wish& wish);
    void start();

    std::vector<Giver> givers_;
    std::optional<Wish> wish_;
    std::future<Mixed> mixing_;
};

}  // namespace doppel
