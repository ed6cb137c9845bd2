// An avatar raises an arm: reads its folder, poses it, draws it, and writes the picture.
#include <cstdio>
#include <exception>

#include "engine/device.h"
#include "engine/io/image.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/rendering.h"

int main(int argc, char** argv) try {
    if (argc != 3) {
        std::fprintf(stderr, "usage: wave AVATAR PICTURE.png\n");
        return 2;
    }
    const doppel::Avatar avatar = doppel::readAvatar(argv[1]);
    doppel::Device device;  // the best one; its options choose another
    constexpr int kSize = 256;
    doppel::Shot shot = doppel::restShot(device, avatar, kSize);

    // A pose is an axis times an angle for each of SMPL's joints. In the rest pose the arms point
    // to the sides, the right one along -x: turned by a negative angle about z it is raised.
    const size_t shoulder = *doppel::jointNumber("right_shoulder");
    for (size_t k = 0; k < 3; ++k) shot.theta[3 * shoulder + k] = k == 2 ? -0.7f : 0.f;

    doppel::AvatarRenderer renderer(device, avatar);
    const doppel::Drawing drawing = renderer.draw(shot.theta, shot.trans, shot.camera, 3);
    doppel::Image picture(drawing.width, drawing.height, 3);
    for (size_t i = 0; i < picture.data.size(); ++i)
        picture.data[i] = static_cast<uint8_t>(drawing.rgb[i] * 255 + 0.5f);
    doppel::writeImage(argv[2], picture);
    std::printf("%s: %zu vertices, drawn by %s\n", argv[2], size_t(avatar.body.vertexCount),
                device.info().name.c_str());
} catch (const std::exception& error) {
    std::fprintf(stderr, "wave: %s\n", error.what());
    return 1;
}
