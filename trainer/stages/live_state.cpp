#include "trainer/stages/live_state.h"

#include <algorithm>

#include "engine/io/image.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/sheet.h"
#include "trainer/data/pictures/crop.h"

namespace doppel {

void writeState(Device& device, const Avatar& avatar, const Capture& capture, FrameCache& frames,
                const std::filesystem::path& out) {
    constexpr size_t kShown = 4;
    constexpr int kSide = 256;
    AvatarRenderer renderer(device, avatar);
    MeshDrawer drawer(device, avatar.body);
    BodyPoser poser(device, avatar.body);
    std::vector<Image> above, below;
    for (size_t k = 0; k < std::min(kShown, capture.size()); ++k) {
        size_t i = k * capture.size() / std::min(kShown, capture.size());
        PosedMesh posed = poser.pose(capture.theta[i], capture.trans[i], avatar.betas);
        CropBox box = cropBox(capture.frames[i].camera, posed.joints, capture.frames[i].name);
        Crop cut = crop(*frames.load(i), capture.frames[i].camera, box, kSide);
        std::vector<float> verts = renderer.vertices(capture.theta[i], capture.trans[i]);
        Drawing drawing =
            avatar.texture.empty()
                ? drawer.drawShaded(verts, cut.camera)
                : drawer.draw(verts, cut.camera, renderer.texture(verts), avatar.textureSize, 2);
        std::vector<float> over(cut.image.size());
        for (size_t p = 0; p < over.size(); ++p)
            over[p] = drawing.rgb[p] +
                      (1 - static_cast<float>(drawing.mask[p / 3]) / 255.0f) * cut.image[p];
        above.push_back(toImage(cut.image, kSide, kSide));
        below.push_back(toImage(over, kSide, kSide));
    }
    writeImage(out / "progress.png", contactSheet({above, below}));
    writeLiveAvatar(out, avatar);
}

}  // namespace doppel
