// What a motion comes from, beside the avatar that performs it: the capture's frame where it has
// pictures, or else the body of the motion, before it was fitted to the avatar's.
#include "viewer/compare/source_body.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

Avatar clayAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.textureSize = 1;  // which nobody sees
    avatar.texture = {.7f, .7f, .7f};
    return avatar;
}

}  // namespace

SourceBody::SourceBody(Device& device) : avatar_(clayAvatar()), scene_(device, avatar_) {}

bool Viewer::hasSource() const {
    const OpenedMotion* opened = openedMotion();
    return capture() || (opened && opened->source);
}

size_t Viewer::frameNow() const {
    return static_cast<size_t>(
        std::clamp<int64_t>(static_cast<int64_t>(timeline_), 0, frameCount() - 1));
}

std::vector<uint32_t> Viewer::sourceFrame(const Pane& pane) {
    std::shared_ptr<const Picture> frame;
    try {
        frame = capture()->frames->load(frameNow());
    } catch (const std::exception& error) {
        if (message() != error.what()) say(error.what(), true);
    }
    const BackdropSource source{.colour = settings_.colour, .frame = frame.get()};
    return partOfView(backdropPixels(pane.viewWidth, pane.height, source), pane);
}

void Viewer::drawSource(size_t i, std::optional<int> refinement) {
    const Pane& pane = panes_[i];
    if (capture()) {
        if (!refinement) panePictures_[i] = {.pixels = sourceFrame(pane)};
        return;
    }
    panePictures_[i].inFront.clear();
    if (!sourceBody_) sourceBody_ = std::make_unique<SourceBody>(*device_);
    Scene& scene = sourceBody_->scene();
    const Motion& source = *openedMotion()->source;
    const size_t frame = std::min(frameNow(), source.size() - 1);
    // The default body's; other models' coefficients mean something else.
    const Betas betas = source.shape == ShapeSpace::Body ? source.betas : Betas{};
    scene.setPose(source.theta[frame], source.trans[frame], betas);
    ShadeOptions clay = shadeOptions(pane);
    clay.paint = kPaintClay;
    clay.inset = 0;
    drawPane(i, scene, MeshKind::Body, clay, backgroundOf(pane), refinement);
}

}  // namespace doppel
