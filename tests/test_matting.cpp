// Networks of users that cut people out, on one that is written here, byte by byte.
#include "trainer/import/masks/matting.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <string>

#include "engine/error.h"
#include "engine/io/onnx.h"
#include "tests/files.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/masks/clip_cutter.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

// ---- protocol buffers, as far as ONNX takes them ------------------------------------------------

std::string varint(uint64_t value) {
    std::string bytes;
    for (; value >= 128; value >>= 7) bytes += char(value % 128 + 128);
    return bytes + char(value);
}
std::string number(int field, uint64_t value) {
    return varint(uint64_t(field) * 8) + varint(value);
}
std::string text(int field, const std::string& bytes) {
    return varint(uint64_t(field) * 8 + 2) + varint(bytes.size()) + bytes;
}

std::string integers(const std::string& name, const std::vector<uint64_t>& values) {
    std::string attribute = text(1, name);
    for (uint64_t v : values) attribute += number(8, v);
    return text(5, attribute + number(20, 7));
}

std::string tensor(const std::string& name, const std::vector<uint64_t>& dims,
                   const std::vector<float>& values) {
    std::string bytes, raw;
    for (uint64_t d : dims) bytes += number(1, d);
    for (float v : values) {
        const auto bits = std::bit_cast<uint32_t>(v);
        for (int k = 0; k < 4; ++k) raw += char(bits >> 8 * k & 255);
    }
    return text(5, bytes + number(2, 1) + text(8, name) + text(9, raw));
}

std::string value(int field, const std::string& name, const std::vector<uint64_t>& dims) {
    std::string shape;
    for (uint64_t d : dims) shape += text(1, number(1, d));
    const std::string type = text(1, number(1, 1) + text(2, shape));
    return text(field, text(1, name) + text(2, type));
}

// sigmoid(weights · colour + bias) of each pixel, `channels` times.
std::string network(uint64_t side, const std::vector<float>& weights, float bias,
                    uint64_t channels = 1) {
    std::vector<float> all, biases(channels, bias);
    for (uint64_t k = 0; k < channels; ++k) all.insert(all.end(), weights.begin(), weights.end());
    const std::string convolution = text(1, "x") + text(1, "w") + text(1, "b") + text(2, "y") +
                                    text(3, "conv") + text(4, "Conv") +
                                    integers("kernel_shape", {1, 1}) + integers("strides", {1, 1}) +
                                    integers("pads", {0, 0, 0, 0}) + integers("dilations", {1, 1});
    const std::string sigmoid =
        text(1, "y") + text(2, "z") + text(3, "sigmoid") + text(4, "Sigmoid");
    const std::string graph = text(1, convolution) + text(1, sigmoid) + text(2, "g") +
                              tensor("w", {channels, 3, 1, 1}, all) +
                              tensor("b", {channels}, biases) + value(11, "x", {1, 3, side, side}) +
                              value(12, "z", {1, channels, side, side});
    return number(1, 7) + text(7, graph) + text(8, text(1, "") + number(2, 11));
}

// As network(), with a second result that is as large, all 1, and before the first by its letters.
std::string twoResults(uint64_t side, const std::vector<float>& weights) {
    auto convolution = [&](const std::string& w, const std::string& b, const std::string& y) {
        return text(1, text(1, "x") + text(1, w) + text(1, b) + text(2, y) + text(3, y) +
                           text(4, "Conv") + integers("kernel_shape", {1, 1}) +
                           integers("strides", {1, 1}) + integers("pads", {0, 0, 0, 0}) +
                           integers("dilations", {1, 1}));
    };
    auto sigmoid = [](const std::string& of, const std::string& z) {
        return text(1, text(1, of) + text(2, z) + text(3, z) + text(4, "Sigmoid"));
    };
    const std::string graph =
        convolution("w", "b", "y") + convolution("v", "c", "q") + sigmoid("y", "matte") +
        sigmoid("q", "coarse") + text(2, "g") + tensor("w", {1, 3, 1, 1}, weights) +
        tensor("b", {1}, {0}) + tensor("v", {1, 3, 1, 1}, {0, 0, 0}) + tensor("c", {1}, {40}) +
        value(11, "x", {1, 3, side, side}) + value(12, "matte", {1, 1, side, side}) +
        value(12, "coarse", {1, 1, side, side});
    return number(1, 7) + text(7, graph) + text(8, text(1, "") + number(2, 11));
}

// -------------------------------------------------------------------------------------------------

TEST(Matting, WithoutOpenCvItIsRefused) {
    if (MattingNetwork::available()) GTEST_SKIP() << "this build has OpenCV's dnn";
    EXPECT_NE(messageOf<InputError>([] {
                  MattingNetwork("a.onnx", "modnet");
              }).find("--matting: expected a build with OpenCV's dnn"),
              std::string::npos);
}

// A red disc before green, and a second one elsewhere.
struct Scene {
    Image picture{120, 90, 3};
    std::vector<float> share = std::vector<float>(120 * 90);
    std::vector<uint8_t> truth = std::vector<uint8_t>(120 * 90);

    Scene() {
        for (int y = 0; y < 90; ++y)
            for (int x = 0; x < 120; ++x) {
                const bool person = std::hypot(x + .5 - 40, y + .5 - 45) < 22;
                const bool other = std::hypot(x + .5 - 105, y + .5 - 20) < 9;
                uint8_t* p = picture.pixel(x, y);
                p[person || other ? 0 : 1] = 220;
                const auto i = size_t(y * 120 + x);
                truth[i] = person ? 255 : 0;
                share[i] = std::hypot(x + .5 - 42, y + .5 - 45) < 20 ? 1.f : 0.f;
            }
    }
};

TEST(Matting, AUsersNetworkDecides) {
    if (!MattingNetwork::available()) GTEST_SKIP() << "libopencv-dnn-dev is not installed";
    Folder folder;
    folder.write("red.onnx", network(512, {8, -8, 0}, 0));
    const Scene scene;
    MattingNetwork net(folder / "red.onnx", "modnet");
    const std::vector<float> matte = net.share(scene.picture);
    EXPECT_GT(matte[45 * 120 + 40], .99);
    EXPECT_LT(matte[80 * 120 + 100], .01);
    EXPECT_GT(matte[20 * 120 + 105], .99);  // the other one as well
    ClipCutter cutter("", std::make_unique<MattingNetwork>(folder / "red.onnx", "modnet"));
    const ClipView sample{scene.picture, scene.share, std::vector<uint8_t>(scene.share.size()),
                          100};
    cutter.learn(sample);
    cutter.finish({&sample, 1});
    EXPECT_EQ(cutter.source(), "the matting network red.onnx");
    const FrameCut cut =
        cutter.cut(0, sample, [&](size_t) { return std::make_shared<ClipView>(sample); });
    double both = 0, any = 0;
    for (size_t i = 0; i < cut.mask.size(); ++i) {
        both += cut.mask[i] && scene.truth[i];
        any += cut.mask[i] || scene.truth[i];
    }
    EXPECT_GT(both / any, .93);
    EXPECT_EQ(cut.mask[20 * 120 + 105], 0);  // who is not the person
    // ISNet's colours go from −.5 to .5, so that half the weight is half as sure.
    folder.write("isnet.onnx", network(1024, {2, -2, 0}, 0));
    const std::vector<float> weak =
        MattingNetwork(folder / "isnet.onnx", "isnet").share(scene.picture);
    EXPECT_NEAR(weak[45 * 120 + 40], 1 / (1 + std::exp(-2 * 220 / 255.)), .01);
}

// Somebody who is small in a large picture is seen from near, to the pixel.
TEST(Matting, ANetworkLooksWhereThePersonIs) {
    if (!MattingNetwork::available()) GTEST_SKIP() << "libopencv-dnn-dev is not installed";
    Folder folder;
    folder.write("red.onnx", network(512, {8, -8, 0}, 0));
    constexpr int kWidth = 2400, kHeight = 1800;
    Image picture(kWidth, kHeight, 3);
    std::vector<float> share(size_t(kWidth * kHeight));
    std::vector<uint8_t> truth(share.size());
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const double far = std::hypot(x + .5 - 2300, y + .5 - 900);
            picture.pixel(x, y)[far < 40 ? 0 : 1] = 220;
            const auto i = size_t(y * kWidth + x);
            truth[i] = far < 40 ? 255 : 0;
            share[i] = far < 36 ? 1.f : 0.f;
        }
    ClipCutter cutter("", std::make_unique<MattingNetwork>(folder / "red.onnx", "modnet"));
    const ClipView sample{picture, share, std::vector<uint8_t>(share.size()), 100};
    cutter.learn(sample);
    cutter.finish({&sample, 1});
    const FrameCut cut =
        cutter.cut(0, sample, [&](size_t) { return std::make_shared<ClipView>(sample); });
    EXPECT_GT(intersectionOverUnion(cut.mask, truth), .98);
}

// ISNet gives six mattes of one size, of which the file's first is the finest.
TEST(Matting, OfSeveralResultsTheFilesFirstCounts) {
    const std::string file = twoResults(512, {8, -8, 0});
    EXPECT_EQ(onnxOutputs(file), (std::vector<std::string>{"matte", "coarse"}));
    // Files of strangers may be cut short, or nothing of the kind.
    for (size_t size = 0; size < file.size(); ++size)
        EXPECT_LE(onnxOutputs(file.substr(0, size)).size(), 2u);
    EXPECT_TRUE(onnxOutputs(std::string(40, '\xff')).empty());
    if (!MattingNetwork::available()) GTEST_SKIP() << "libopencv-dnn-dev is not installed";
    Folder folder;
    folder.write("two.onnx", file);
    const Scene scene;
    const std::vector<float> matte =
        MattingNetwork(folder / "two.onnx", "modnet").share(scene.picture);
    EXPECT_GT(matte[45 * 120 + 40], .99);
    EXPECT_LT(matte[80 * 120 + 100], .01);
}

TEST(Matting, OtherFilesAreRefused) {
    if (!MattingNetwork::available()) GTEST_SKIP() << "libopencv-dnn-dev is not installed";
    Folder folder;
    folder.write("text.onnx", std::string("no network"));
    EXPECT_NE(messageOf<InputError>([&] {
                  MattingNetwork(folder / "text.onnx", "modnet");
              }).find("text.onnx: expected an ONNX network of 32-bit floats with one input"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  MattingNetwork(folder / "none.onnx", "modnet");
              }).find("none.onnx"),
              std::string::npos);
    folder.write("three.onnx", network(512, {1, 0, 0}, 0, 3));
    EXPECT_NE(messageOf<InputError>([&] {
                  MattingNetwork(folder / "three.onnx", "modnet").share(Scene().picture);
              }).find("three.onnx: expected an output [1,1,H,W]"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  MattingNetwork(folder / "three.onnx", "rvm");
              }).find("--matting-kind: expected modnet or isnet, found \"rvm\""),
              std::string::npos);
}

}  // namespace
}  // namespace doppel
