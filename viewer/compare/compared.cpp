#include "viewer/compare/compared.h"

namespace doppel {

Compared::Compared(Device& device, const std::filesystem::path& folder)
    : device_(device), source_(folder) {
    use(source_.load());
}

void Compared::use(std::shared_ptr<LoadedAvatar> avatar) {
    scene_.reset();  // which looks at the one before
    avatar_ = std::move(avatar);
    const Avatar& now = avatar_->avatar;
    scene_ = std::make_unique<Scene>(device_, now);
    scene_->setTexture(texture());
}

bool Compared::reload() {
    std::shared_ptr<LoadedAvatar> now = source_.changed();
    if (!now) return false;
    use(std::move(now));
    return true;
}

void Compared::setPose(const Theta& theta, const Trans& trans, const Betas& betas,
                       const Avatar& edited) {
    scene_->setPose(theta, trans, betasFor(betas, edited));
}

Betas Compared::betasFor(const Betas& betas, const Avatar& edited) const {
    Betas own = avatar_->avatar.betas;
    for (size_t k = 0; k < own.size(); ++k) own[k] += betas[k] - edited.betas[k];
    return own;
}

MeshKind Compared::mesh(MeshKind wanted) const {
    return scene_->hasRefinedMesh() ? wanted : MeshKind::Body;
}

}  // namespace doppel
