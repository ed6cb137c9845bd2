// An avatar that is told from its pictures, and what others' pictures of it are held to.
#pragma once

#include <gtest/gtest.h>

#include <cmath>

#include "engine/io/image.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/bake.h"

namespace doppel::test {

// The default body in stripes that go on across the atlas's seams.
inline Avatar stripedAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = presetByName("ci");
    avatar.textureSize = 512;
    const std::vector<TexelPlace> places = texelPlaces(avatar.body, avatar.textureSize);
    avatar.texture.assign(3 * places.size(), 0);
    for (size_t t = 0; t < places.size(); ++t)
        for (size_t c = 0; c < 3 && places[t].face >= 0; ++c) {
            double at = 0;
            for (size_t i = 0; i < 3; ++i) {
                const auto v = size_t(avatar.body.faces[3 * size_t(places[t].face) + i]);
                at +=
                    double{places[t].corners[i]} * double{avatar.body.templateVertices[3 * v + c]};
            }
            avatar.texture[3 * t + c] = float(.5 + .4 * std::sin(20 * at));
        }
    spreadCharts(places, avatar.textureSize, avatar.texture);
    return avatar;
}

// A square picture of R, G, B, A, colours as they are where alpha is less, is what we draw through
// a camera of this focal length, pixels: IoU over .97, over 32 dB over the union.
inline void expectShows(const Image& shown, const Avatar& avatar, const Theta& theta,
                        const Trans& trans, double focal) {
    const int size = shown.width;
    ASSERT_EQ(shown.height, size);
    ASSERT_EQ(shown.channels, 4);
    const Camera camera{focal, focal, size / 2., size / 2., size, size};
    const Drawing drawn = AvatarRenderer(testDevice(), avatar).draw(theta, trans, camera, 4);
    double both = 0, either = 0, squares = 0;
    for (size_t i = 0; i < drawn.mask.size(); ++i) {
        const uint8_t* pixel = &shown.data[4 * i];
        const bool ours = drawn.mask[i] > 127, theirs = pixel[3] > 127;
        both += ours && theirs;
        if (!ours && !theirs) continue;
        ++either;
        for (size_t c = 0; c < 3; ++c) {
            const double difference =
                double(pixel[c]) * pixel[3] / 255. / 255. - double{drawn.rgb[3 * i + c]};
            squares += difference * difference;
        }
    }
    EXPECT_GT(either, 5000);
    EXPECT_GT(both / either, .97);
    EXPECT_GT(-10 * std::log10(squares / (3 * either)), 32);
}

}  // namespace doppel::test
