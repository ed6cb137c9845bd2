// Another avatar, to be seen beside the one that is edited: in the same pose, from the same place.
#pragma once

#include <memory>

#include "viewer/live/live_avatar.h"
#include "viewer/picture/scene.h"

namespace doppel {

// It follows a training as the viewer's own does, and is shown with the texture that is the best
// for all views.
class Compared {
public:
    // InputError where there is no avatar. The device outlives it.
    Compared(Device& device, const std::filesystem::path& folder);

    // Whether what is on disk has changed, and is shown from now on.
    bool reload();
    // betas: of `edited`, as they are set; what was changed of them changes here as well.
    void setPose(const Theta& theta, const Trans& trans, const Betas& betas, const Avatar& edited);

    Betas betasFor(const Betas& betas, const Avatar& edited) const;

    Scene& scene() { return *scene_; }
    // The best for all views.
    const std::vector<float>& texture() const {
        return avatar().bakedTexture.empty() ? avatar().texture : avatar().bakedTexture;
    }
    const Avatar& avatar() const { return avatar_->avatar; }
    const std::shared_ptr<LoadedAvatar>& loaded() const { return avatar_; }
    // The mesh network's where it has one and that is wanted.
    MeshKind mesh(MeshKind wanted) const;
    const std::filesystem::path& folder() const { return source_.folder(); }

private:
    void use(std::shared_ptr<LoadedAvatar> avatar);

    Device& device_;
    LiveAvatar source_;
    std::shared_ptr<LoadedAvatar> avatar_;
    std::unique_ptr<Scene> scene_;
};

}  // namespace doppel
