#include "trainer/data/pictures/crop.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/error.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::messageOf;

// A picture whose value at the pixel (x, y) is linear in the position of the pixel's centre.
Picture ramp(int width, int height) {
    Picture picture{width, height, {}, {}};
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            picture.rgb.insert(picture.rgb.end(), {uint8_t(x), uint8_t(y), uint8_t(x + y)});
            picture.mask.push_back(x < width / 2 ? 255 : 0);
        }
    }
    return picture;
}

TEST(Crop, PixelsShowWhatTheCropsCameraSees) {
    const Picture picture = ramp(120, 100);
    const Camera camera{200, 190, 61.5, 48.25, 120, 100};
    // Enlarged, as it is, and shrunk.
    for (const double half : {9.3, 16., 37.7}) {
        const CropBox box{55.2, 51.7, half};
        const int size = 32;
        // The mean of whole pixels follows a ramp up to an eighth of a pixel.
        const double tolerance = half > 16 ? .125 / (2 * half / size) : 1e-3;
        const Crop c = crop(picture, camera, box, size);
        EXPECT_EQ(c.camera.width, size);
        for (int y = 0; y < size; y += 3) {
            for (int x = 0; x < size; x += 3) {
                // The ray through this pixel's centre, projected by the frame's camera.
                const std::array<double, 3> point{(x + .5 - c.camera.cx) / c.camera.fx,
                                                  (y + .5 - c.camera.cy) / c.camera.fy, 1};
                const auto [u, v] = camera.project(point);
                const size_t p = size_t(y * size + x);
                EXPECT_NEAR(255 * c.image[3 * p], u - .5, tolerance) << half;
                EXPECT_NEAR(255 * c.image[3 * p + 1], v - .5, tolerance) << half;
                EXPECT_FLOAT_EQ(c.inside[p], 1);
            }
        }
    }
}

TEST(Crop, AreaIsKept) {
    const Picture picture = ramp(120, 100);
    const Camera camera{200, 190, 61.5, 48.25, 120, 100};
    // Beyond the border: the mask's area and the frame's own are those of the frame.
    const CropBox box{40, 50, 90};
    const Crop c = crop(picture, camera, box, 64);
    double mask = 0, inside = 0;
    for (size_t p = 0; p < c.mask.size(); ++p) mask += c.mask[p], inside += c.inside[p];
    const double pixel = (180. / 64) * (180. / 64);
    EXPECT_NEAR(mask * pixel, 60 * 100, .5);
    EXPECT_NEAR(inside * pixel, 120 * 100, .5);
    EXPECT_EQ(c.image[0], 0);
    EXPECT_EQ(c.inside[0], 0);
}

TEST(Crop, BoxHoldsTheBody) {
    const Camera camera{500, 500, 320, 240, 640, 480};
    std::vector<std::array<double, 3>> joints(24, {.1, .2, 4});
    joints[7] = {.1, 1.2, 4};
    joints[22] = {.9, .2, 4};
    const CropBox box = cropBox(camera, joints);
    EXPECT_DOUBLE_EQ(box.centreX, 332.5);
    EXPECT_DOUBLE_EQ(box.centreY, 265);
    EXPECT_NEAR(box.half, 1.1 * 125, 1e-9);
    const Camera c = cropCamera(camera, box, 256);
    const auto [u, v] = c.project(joints[0]);
    EXPECT_NEAR(u, 128, 1e-9);
    EXPECT_NEAR(v, 128, 1e-9);
    EXPECT_NEAR(c.project(joints[7])[1], 128 + 128 / 1.1, 1e-9);

    joints[3][2] = -1;
    EXPECT_EQ(messageOf<InputError>([&] { cropBox(camera, joints, "f3"); }),
              "f3: expected the body before the camera, found joint 3 at z = -1.000 m");
    // So far off that all joints fall on one point of the picture.
    joints.assign(24, {0, 0, 1e30});
    EXPECT_NE(messageOf<InputError>([&] { cropBox(camera, joints, "f3"); }).find("f3: expected"),
              std::string::npos);
}

}  // namespace
}  // namespace doppel
