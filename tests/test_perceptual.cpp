// LPIPS and Inception-3D on random weights against PyTorch's numbers (tests/networks), and the
// Fréchet distance against closed forms. Weights are a hash of their names, so that both sides have
// the same without a file.
#include <zlib.h>

#include <cmath>
#include <random>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/eval/fvd.h"
#include "trainer/eval/lpips.h"

namespace doppel {
namespace {

std::vector<double> hashed(const std::string& name, int64_t count) {
    auto seed = static_cast<uint32_t>(
        crc32(0, reinterpret_cast<const Bytef*>(name.data()), static_cast<uInt>(name.size())));
    std::vector<double> values;
    for (int64_t i = 0; i < count; ++i) {
        uint32_t x = seed + static_cast<uint32_t>(i) * 2654435761u;
        x ^= x >> 16, x *= 0x85ebca6b, x ^= x >> 13, x *= 0xc2b2ae35, x ^= x >> 16;
        values.push_back(x / 4294967296.0);
    }
    return values;
}

Tensor32 hashedWeights(const std::string& name, const Shape& shape) {
    Tensor32 tensor{shape, {}};
    double fan = 1;
    for (size_t d = 1; d < shape.size(); ++d) fan *= static_cast<double>(shape[d]);
    for (double u : hashed(name, elementCount(shape))) {
        double value = .2 * (2 * u - 1);
        if (name.ends_with("running_var") || name.ends_with("bn.weight"))
            value = .5 + u;
        else if (name.starts_with("lin"))
            value = u;
        else if (shape.size() > 1)
            value = (2 * u - 1) * std::sqrt(6 / fan);
        tensor.values.push_back(static_cast<float>(value));
    }
    return tensor;
}

std::vector<float> picture(const std::string& name, size_t count) {
    std::vector<double> values = hashed(name, static_cast<int64_t>(count));
    return {values.begin(), values.end()};
}

// Backbone and heads as torchvision and LPIPS's authors call them.
struct LpipsFiles {
    Safetensors backbone, heads;

    explicit LpipsFiles(LpipsNet net) {
        backbone.file = "backbone", heads.file = "heads";
        Graph graph(testDevice());
        lpipsFeatures(graph, net, graph.input({1, 3, 64, 64}),
                      [&](const std::string& name, const Shape& shape) {
                          backbone.tensors[name] = hashedWeights(name, shape);
                          return graph.input(shape);
                      });
        for (size_t i = 0; i < lpipsChannels(net).size(); ++i) {
            std::string name = fmt::format("lin{}", i);
            heads.tensors[name + ".model.1.weight"] =
                hashedWeights(name, {1, lpipsChannels(net)[i], 1, 1});
        }
    }
};

// b is 0.7 a + 0.3 of other noise.
std::pair<std::vector<float>, std::vector<float>> pictures(size_t count) {
    std::vector<float> a = picture("a", count), b = picture("b", count);
    for (size_t i = 0; i < count; ++i)
        b[i] = static_cast<float>(.7 * double(a[i]) + .3 * double(b[i]));
    return {a, b};
}

TEST(Lpips, AgreesWithPyTorch) {
    Npz golden = readNpz(test::sourceFolder() / "tests/networks/lpips.npz");
    int height = int(golden.at("height").integer()), width = int(golden.at("width").integer());
    auto [a, b] = pictures(3 * size_t(height) * size_t(width));
    for (LpipsNet net : {LpipsNet::alex, LpipsNet::vgg, LpipsNet::squeeze}) {
        SCOPED_TRACE(lpipsNetName(net));
        LpipsFiles files(net);
        Lpips lpips(testDevice(), net, {files.backbone, files.heads});
        double expected = golden.at(lpipsNetName(net)).scalar();
        EXPECT_NEAR(lpips.distance(a, b, width, height), expected, 2e-5 * expected);
        EXPECT_NEAR(lpips.distance(b, a, width, height), expected, 2e-5 * expected);
        EXPECT_EQ(lpips.distance(a, a, width, height), 0);
        // The pictures' size may change, and change back.
        EXPECT_GT(lpips.distance(std::span(a).first(3 * 32 * 40), std::span(b).first(3 * 32 * 40),
                                 40, 32),
                  0);
        EXPECT_NEAR(lpips.distance(a, b, width, height), expected, 2e-5 * expected);
    }
}

TEST(Lpips, TakesAWholeModelsNames) {
    LpipsFiles files(LpipsNet::squeeze);
    Safetensors one;
    one.file = "lpips.pth";
    for (const auto& [name, tensor] : files.backbone.tensors)
        one.tensors["net.slice2." + name.substr(9)] = tensor;  // "features."
    for (const auto& [name, tensor] : files.heads.tensors)
        one.tensors["lins." + name.substr(3)] = tensor;
    auto [a, b] = pictures(3 * 40 * 32);
    EXPECT_EQ(Lpips(testDevice(), LpipsNet::squeeze, {one}).distance(a, b, 40, 32),
              Lpips(testDevice(), LpipsNet::squeeze, {files.heads, files.backbone})
                  .distance(a, b, 40, 32));
}

TEST(Lpips, Refusals) {
    LpipsFiles files(LpipsNet::alex);
    auto with = [&](std::vector<Safetensors> given) {
        return [given, &files] {
            (void)files;
            Lpips(testDevice(), LpipsNet::alex, given);
        };
    };
    expectInputError(with({files.heads}),
                     "heads: expected the backbone's tensor features.0.weight of LPIPS's alex "
                     "network, found none; give backbone and heads as --lpips BACKBONE,HEADS");
    expectInputError(with({files.backbone}), "expected the head lin0.model.1.weight");
    Safetensors other = files.backbone;
    other.tensors["features.3.weight"].shape = {64, 192, 5, 5};
    expectInputError(with({other, files.heads}),
                     "backbone: features.3.weight: expected shape [192,64,5,5] for LPIPS's alex "
                     "network, found [64,192,5,5]");
    Lpips lpips(testDevice(), LpipsNet::alex, {files.backbone, files.heads});
    std::vector<float> small(3 * 30 * 40);
    expectInputError([&] { lpips.distance(small, small, 40, 30); },
                     "expected pictures of at least 31 pixels for the alex network, found 40x30");
    std::vector<float> least(3 * 31 * 31);
    EXPECT_EQ(lpips.distance(least, least, 31, 31), 0);
    expectInputError([] { lpipsNetByName("resnet", "--lpips-net"); },
                     "--lpips-net: expected alex, vgg or squeeze, found \"resnet\"");
}

// ---- Inception-3D -------------------------------------------------------------------------------

Safetensors inceptionFile(int64_t classes) {
    Safetensors file;
    file.file = "i3d.pt";
    Graph graph(testDevice());
    inception3dLogits(graph, graph.input({16, 3, 32, 32}), classes,
                      [&](const std::string& name, const Shape& shape) {
                          file.tensors[name] = hashedWeights(name, shape);
                          return graph.input(shape);
                      });
    return file;
}

TEST(VideoFeatures, AgreesWithPyTorch) {
    Npz golden = readNpz(test::sourceFolder() / "tests/networks/inception3d.npz");
    int frames = int(golden.at("frames").integer()), height = int(golden.at("height").integer()),
        width = int(golden.at("width").integer());
    Safetensors file = inceptionFile(golden.at("logits").shape[0]);
    size_t pixels = 3 * size_t(height) * size_t(width);
    std::vector<float> video = picture("video", size_t(frames) * pixels);
    std::vector<std::vector<float>> clip;
    for (size_t i = 0; i < size_t(frames); ++i) {
        clip.emplace_back(video.begin() + long(i * pixels), video.begin() + long((i + 1) * pixels));
        for (float& value : clip.back()) value = static_cast<float>(2 * double(value) - 1);
    }
    VideoFeatures network(testDevice(), file, frames, height, width);
    EXPECT_LE(relativeError(network(clip), golden.at("logits").toF64(), 1e-6), 2e-5);

    file.tensors.erase("Mixed_4c.b1b.bn.running_mean");
    expectInputError([&] { VideoFeatures(testDevice(), file, frames, height, width); },
                     "i3d.pt: expected a tensor 'Mixed_4c.b1b.bn.running_mean'");
    file = inceptionFile(5);
    file.tensors["Conv3d_2b_1x1.conv3d.weight"].shape = {64, 64};
    expectInputError([&] { VideoFeatures(testDevice(), file, frames, height, width); },
                     "i3d.pt: Conv3d_2b_1x1.conv3d.weight: expected shape [64,64,1,1,1] for "
                     "Inception-3D, found [64,64]");
}

TEST(VideoFeatures, PreparesPictures) {
    // A ramp stays a ramp: pixel centres keep their places.
    constexpr int kSize = VideoFeatures::kSize, kWidth = 4 * kSize, kHeight = 100;
    std::vector<float> rgb(3 * size_t(kWidth * kHeight));
    for (size_t i = 0; i < rgb.size(); ++i)
        rgb[i] = (float(i / 3 % size_t(kWidth)) + .5f) / float(kWidth) * float(i % 3) / 2;
    std::vector<float> prepared = VideoFeatures::prepare(rgb, kWidth, kHeight);
    ASSERT_EQ(prepared.size(), size_t(3 * kSize * kSize));
    for (size_t i = 0; i < prepared.size(); ++i) {
        double x = (double(i % kSize) + .5) / kSize, channel = double(i / (kSize * kSize));
        ASSERT_NEAR(prepared[i], 2 * x * channel / 2 - 1, 1e-5) << i;
    }
}

// ---- the Fréchet distance -----------------------------------------------------------------------

std::vector<double> multiplied(const std::vector<double>& a, const std::vector<double>& b, size_t n,
                               bool transposeB) {
    std::vector<double> c(n * n);
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j)
            for (size_t k = 0; k < n; ++k)
                c[i * n + j] += a[i * n + k] * (transposeB ? b[j * n + k] : b[k * n + j]);
    return c;
}

// An orthogonal matrix: Gram-Schmidt on random rows.
std::vector<double> rotation(size_t n) {
    std::vector<double> q = random({int64_t(n), int64_t(n)}, 5).data;
    for (size_t i = 0; i < n; ++i) {
        for (size_t j = 0; j < i; ++j) {
            double dot = 0;
            for (size_t k = 0; k < n; ++k) dot += q[i * n + k] * q[j * n + k];
            for (size_t k = 0; k < n; ++k) q[i * n + k] -= dot * q[j * n + k];
        }
        double norm = 0;
        for (size_t k = 0; k < n; ++k) norm += q[i * n + k] * q[i * n + k];
        for (size_t k = 0; k < n; ++k) q[i * n + k] /= std::sqrt(norm);
    }
    return q;
}

std::vector<double> diagonal(const std::vector<double>& values) {
    std::vector<double> d(values.size() * values.size());
    for (size_t i = 0; i < values.size(); ++i) d[i * values.size() + i] = values[i];
    return d;
}

TEST(FrechetDistance, ClosedForms) {
    // One dimension: (m - n)^2 + (s - t)^2.
    EXPECT_NEAR(frechetDistance({{1}, {4}}, {{-2}, {25}}), 9 + 9, 1e-12);
    // Covariances that commute, Q diag(a) Q^T and Q diag(b) Q^T: sum of (sqrt a - sqrt b)^2. One is
    // singular.
    const std::vector<double> a{4, 9, 0, 1e-6, 2.5}, b{1, 16, 0.25, 0, 2.5}, m{1, 2, 3, 4, 5},
        n{1, 0, 3, 5, 5};
    const std::vector<double> q = rotation(5);
    double expected = 4 + 1;
    for (size_t i = 0; i < 5; ++i) expected += std::pow(std::sqrt(a[i]) - std::sqrt(b[i]), 2);
    Gaussian first{m, multiplied(multiplied(q, diagonal(a), 5, false), q, 5, true)};
    Gaussian second{n, multiplied(multiplied(q, diagonal(b), 5, false), q, 5, true)};
    EXPECT_NEAR(frechetDistance(first, second), expected, 1e-7);
    EXPECT_NEAR(frechetDistance(second, first), expected, 1e-7);
    EXPECT_NEAR(frechetDistance(first, first), 0, 1e-7);
    // Two by two that do not commute: tr sqrt(AB) = sqrt(tr AB + 2 sqrt(det AB)).
    const std::vector<double> A{2, 1, 1, 3}, B{1, -.5, -.5, 4};
    double trace = 2 * 1 + 1 * -.5 + 1 * -.5 + 3 * 4, det = 5 * 3.75;
    EXPECT_NEAR(frechetDistance({{0, 0}, A}, {{0, 0}, B}),
                5 + 5 - 2 * std::sqrt(trace + 2 * std::sqrt(det)), 1e-12);
}

TEST(FrechetDistance, OfSamples) {
    const std::vector<std::vector<double>> rows{{1, 2}, {3, 2}, {2, 5}};
    Gaussian g = fitGaussian(rows);
    EXPECT_EQ(g.mean, (std::vector<double>{2, 3}));
    EXPECT_EQ(g.covariance, (std::vector<double>{1, 0, 0, 3}));
    EXPECT_NEAR(frechetDistance(g, g), 0, 1e-12);
    // The same cloud somewhere else: the squared way.
    std::vector<std::vector<double>> moved = rows;
    for (auto& row : moved) row[0] += 3, row[1] -= 4;
    EXPECT_NEAR(frechetDistance(g, fitGaussian(moved)), 25, 1e-12);
    // Many draws of two known normal distributions come near their distance.
    std::mt19937 generator(3);
    std::normal_distribution<double> normal;
    std::vector<std::vector<double>> p, s;
    for (int i = 0; i < 20000; ++i) {
        p.push_back({normal(generator), 2 * normal(generator)});
        s.push_back({1 + 3 * normal(generator), normal(generator)});
    }
    EXPECT_NEAR(frechetDistance(fitGaussian(p), fitGaussian(s)), 1 + 4 + 1, .2);
}

TEST(FrechetDistance, MoreDimensionsThanClips) {
    // Five clips of 400 classes: covariances of rank 4.
    std::vector<std::vector<double>> rows;
    for (uint32_t i = 0; i < 5; ++i) rows.push_back(random({400}, i + 1).data);
    Gaussian g = fitGaussian(rows);
    EXPECT_NEAR(frechetDistance(g, g), 0, 1e-3);
    std::vector<std::vector<double>> twice = rows;
    for (auto& row : twice)
        for (double& value : row) value *= 2;
    double trace = 0, mean = 0;
    for (size_t i = 0; i < 400; ++i) {
        trace += g.covariance[i * 401];
        mean += g.mean[i] * g.mean[i];
    }
    EXPECT_NEAR(frechetDistance(g, fitGaussian(twice)), mean + trace, 1e-3);
}

}  // namespace
}  // namespace doppel
