#include "viewer/picture/pose_pictures.h"

#include <cmath>

#include "viewer/picture/orbit_camera.h"

namespace doppel {

void PosePictures::use(const Kind& kind) {
    if (kind == kind_) return;
    kind_ = kind;
    pictures_.clear();
}

const CanvasImage* PosePictures::find(const std::string& name, const Pose& pose) const {
    const auto found = pictures_.find(name);
    return found != pictures_.end() && found->second.first == pose ? &found->second.second
                                                                   : nullptr;
}

void PosePictures::draw(const std::string& name, const Pose& pose, Scene& scene) {
    constexpr MeshKind kMesh = MeshKind::Refined;
    constexpr int kSamples = 4;
    scene.setPose(thetaOf(pose), transOf(pose), kind_.betas);
    OrbitCamera camera;
    camera.frame(scene.vertices(kMesh), kind_.width, kind_.height);
    uint32_t behind = 0xff000000u;
    for (size_t c = 0; c < 3; ++c)
        behind |= static_cast<uint32_t>(std::lround(255 * kind_.behind[c])) << 8 * c;
    const std::vector<uint32_t> background(
        static_cast<size_t>(kind_.width) * static_cast<size_t>(kind_.height), behind);
    pictures_.insert_or_assign(
        name,
        std::pair(pose, CanvasImage{kind_.width, kind_.height,
                                    scene.draw(kMesh, camera.camera(kind_.width, kind_.height),
                                               camera.view(), kind_.shade, background, kSamples)}));
}

}  // namespace doppel
