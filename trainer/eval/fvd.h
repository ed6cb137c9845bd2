// The Fréchet video distance of Unterthiner et al., Towards Accurate Generative Models of Video
// (2018): how far apart the features of real and of rendered clips lie, on our own ops with the
// user's weights of Inception-3D.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "engine/device.h"
#include "engine/io/safetensors.h"

namespace doppel {

// Mean and (unbiased) covariance of features.
struct Gaussian {
    std::vector<double> mean;        // [D]
    std::vector<double> covariance;  // [D][D]
};

// rows: at least two, of the same length.
Gaussian fitGaussian(std::span<const std::vector<double>> rows);

// |m_a - m_b|^2 + tr(S_a + S_b - 2 (S_a S_b)^(1/2)), in double precision; covariances may be
// singular. Never negative.
double frechetDistance(const Gaussian& a, const Gaussian& b);

// Features of clips.
class VideoFeatures {
public:
    static constexpr int kFrames = 16, kSize = 224;

    // The RGB Inception-3D trained on Kinetics as its PyTorch ports store it
    // ("Conv3d_1a_7x7.conv3d.weight", "logits.conv3d.weight"); see readWeights. InputError that
    // says which tensor is missing or has another shape.
    VideoFeatures(Device& device, const std::filesystem::path& file);
    VideoFeatures(Device& device, Safetensors weights, int frames = kFrames, int height = kSize,
                  int width = kSize);
    ~VideoFeatures();

    // A picture [H][W][3] in [0,1] as the network sees it: [3][kSize][kSize] in [-1,1], bilinear
    // without smoothing, pixel centres at a half, as the metric's authors resize.
    static std::vector<float> prepare(std::span<const float> rgb, int width, int height);

    // Logits [classes] of kFrames prepared pictures.
    std::vector<double> operator()(std::span<const std::vector<float>> clip);

private:
    struct Recording;
    std::unique_ptr<Recording> recording_;
};

// The clips of a film: kFrames in a row, a new one every stride frames; none where it is shorter.
// prepared: see VideoFeatures::prepare. One row of features per clip.
constexpr int kClipStride = 4;
std::vector<std::vector<double>> clipFeatures(VideoFeatures& network,
                                              std::span<const std::vector<float>> prepared,
                                              int stride = kClipStride);

}  // namespace doppel
