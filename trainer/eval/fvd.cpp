#include "trainer/eval/fvd.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/io/weights.h"
#include "nn/nets/perceptual.h"
#include "trainer/data/progress.h"

namespace doppel {

namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Matrix matrixOf(const Gaussian& g) {
    const auto size = static_cast<Eigen::Index>(g.mean.size());
    return Eigen::Map<const Matrix>(g.covariance.data(), size, size);
}

// The eigenvalues' roots; what rounding has made negative is zero.
Eigen::VectorXd roots(const Eigen::VectorXd& values) { return values.cwiseMax(0).cwiseSqrt(); }

}  // namespace

Gaussian fitGaussian(std::span<const std::vector<double>> rows) {
    CHECK(rows.size() >= 2, "a covariance takes two rows, not {}", rows.size());
    const auto n = static_cast<Eigen::Index>(rows.size());
    const auto d = static_cast<Eigen::Index>(rows[0].size());
    Matrix x(n, d);
    for (Eigen::Index i = 0; i < n; ++i) {
        CHECK(rows[size_t(i)].size() == size_t(d), "rows are of the same length");
        for (Eigen::Index j = 0; j < d; ++j) x(i, j) = rows[size_t(i)][size_t(j)];
    }
    const Eigen::RowVectorXd mean = x.colwise().mean();
    x.rowwise() -= mean;
    const Matrix covariance = x.transpose() * x / static_cast<double>(n - 1);
    return {{mean.data(), mean.data() + d}, {covariance.data(), covariance.data() + d * d}};
}

double frechetDistance(const Gaussian& a, const Gaussian& b) {
    const size_t d = a.mean.size();
    CHECK(b.mean.size() == d && a.covariance.size() == d * d && b.covariance.size() == d * d,
          "both have {} dimensions", d);
    double distance = 0;
    for (size_t i = 0; i < d; ++i) distance += std::pow(a.mean[i] - b.mean[i], 2);
    const Matrix sa = matrixOf(a), sb = matrixOf(b);
    // tr (A B)^(1/2) = tr (A^(1/2) B A^(1/2))^(1/2), which is symmetric.
    const Eigen::SelfAdjointEigenSolver<Matrix> ofA(sa);
    const Matrix rootA =
        ofA.eigenvectors() * roots(ofA.eigenvalues()).asDiagonal() * ofA.eigenvectors().transpose();
    const Matrix inner = rootA * sb * rootA;
    const Eigen::SelfAdjointEigenSolver<Matrix> ofInner((inner + inner.transpose()) / 2,
                                                        Eigen::EigenvaluesOnly);
    distance += sa.trace() + sb.trace() - 2 * roots(ofInner.eigenvalues()).sum();
    return std::max(distance, 0.0);
}

struct VideoFeatures::Recording {
    Graph graph;
    int frames;
    size_t pixels;
    Tensor x, logits;

    Recording(Device& device, const Safetensors& weights, int frames_, int height, int width)
        : graph(device), frames(frames_), pixels(size_t(height) * size_t(width)) {
        const Tensor32& bias = weights.at("logits.conv3d.bias");
        if (bias.shape.size() != 1)
            throwInput("{}: logits.conv3d.bias: expected one number per class, found shape {}",
                       weights.file, toString(bias.shape));
        x = graph.input({frames, 3, height, width});
        logits = inception3dLogits(
            graph, x, bias.shape[0], [&](const std::string& name, const Shape& shape) {
                const Tensor32& tensor = weights.at(name);
                if (tensor.shape != shape)
                    throwInput("{}: {}: expected shape {} for Inception-3D, found {}", weights.file,
                               name, toString(shape), toString(tensor.shape));
                return graph.constant(std::span<const float>(tensor.values), shape);
            });
        graph.output(logits);
        graph.compile();
    }
};

VideoFeatures::VideoFeatures(Device& device, const std::filesystem::path& file)
    : VideoFeatures(device, readWeights(file)) {}

VideoFeatures::VideoFeatures(Device& device, Safetensors weights, int frames, int height, int width)
    : recording_(std::make_unique<Recording>(device, weights, frames, height, width)) {}

VideoFeatures::~VideoFeatures() = default;

std::vector<float> VideoFeatures::prepare(std::span<const float> rgb, int width, int height) {
    CHECK(rgb.size() == 3 * size_t(width) * size_t(height), "a picture is [{}][{}][3]", height,
          width);
    // Of one pixel of the result along a side: the two pixels between which it lies, and how far.
    struct Between {
        size_t a, b;
        double part;
    };
    auto between = [](int i, int size) {
        double at = std::clamp((i + .5) * size / kSize - .5, 0.0, size - 1.0);
        auto a = static_cast<size_t>(at);
        return Between{a, std::min(a + 1, static_cast<size_t>(size - 1)),
                       at - static_cast<double>(a)};
    };
    std::vector<float> result(3 * size_t(kSize) * size_t(kSize));
    for (int y = 0; y < kSize; ++y) {
        const Between row = between(y, height);
        for (int x = 0; x < kSize; ++x) {
            const Between column = between(x, width);
            for (size_t c = 0; c < 3; ++c) {
                auto pixel = [&](size_t r, size_t k) {
                    return double(rgb[3 * (r * size_t(width) + k) + c]);
                };
                double above = pixel(row.a, column.a) * (1 - column.part) +
                               pixel(row.a, column.b) * column.part;
                double below = pixel(row.b, column.a) * (1 - column.part) +
                               pixel(row.b, column.b) * column.part;
                result[(c * kSize + size_t(y)) * kSize + size_t(x)] =
                    static_cast<float>(2 * (above * (1 - row.part) + below * row.part) - 1);
            }
        }
    }
    return result;
}

std::vector<double> VideoFeatures::operator()(std::span<const std::vector<float>> clip) {
    Recording& r = *recording_;
    CHECK(clip.size() == size_t(r.frames), "a clip has {} frames", r.frames);
    std::vector<float> x;
    for (const std::vector<float>& frame : clip) {
        CHECK(frame.size() == 3 * r.pixels, "a frame has {} pixels", r.pixels);
        x.insert(x.end(), frame.begin(), frame.end());
    }
    r.graph.write(r.x, x);
    r.graph.run();
    const std::vector<float> logits = r.graph.read<float>(r.logits);
    return {logits.begin(), logits.end()};
}

std::vector<std::vector<double>> clipFeatures(VideoFeatures& network,
                                              std::span<const std::vector<float>> prepared,
                                              int stride) {
    std::vector<std::vector<double>> rows;
    constexpr size_t kFrames = VideoFeatures::kFrames;
    for (size_t first = 0; first + kFrames <= prepared.size(); first += size_t(stride)) {
        if (interrupted()) throw Interrupted{};
        rows.push_back(network(prepared.subspan(first, kFrames)));
    }
    return rows;
}

}  // namespace doppel
