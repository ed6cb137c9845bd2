#include "trainer/import/masks/matting.h"

#ifdef DOPPEL_OPENCV_DNN
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#endif

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/onnx.h"

namespace doppel {

namespace {

MattingKind kindOf(std::string_view kind) {
    if (kind == "modnet") return MattingKind::Modnet;
    if (kind == "isnet") return MattingKind::Isnet;
    throwInput("--matting-kind: expected modnet or isnet, found \"{}\"", kind);
}

}  // namespace

#ifdef DOPPEL_OPENCV_DNN

bool MattingNetwork::available() { return true; }

struct MattingNetwork::Net {
    cv::dnn::Net net;
    std::vector<std::string> outputs;  // in the file's order; OpenCV has them by their letters
};

namespace {

// OpenCV's errors are the file's, as far as the user is concerned.
template <typename Call>
auto guarded(const std::string& path, Call call) {
    try {
        return call();
    } catch (const cv::Exception& error) {
        throwInput(
            "{}: expected an ONNX network of 32-bit floats with one input [1,3,H,W] that OpenCV {} "
            "can run; it says: {}",
            path, CV_VERSION, error.err);
    }
}

}  // namespace

MattingNetwork::MattingNetwork(const std::filesystem::path& file, std::string_view kind)
    : name_(file.filename().string()), path_(file.string()), kind_(kindOf(kind)) {
    const std::vector<uint8_t> bytes = readWholeFile(file, uint64_t{2} << 30);
    net_ = std::make_unique<Net>();
    // What it cannot run is in the error; it would print it as well.
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    guarded(path_, [&] {
        net_->net = cv::dnn::readNetFromONNX(bytes);
        const std::vector<std::string> found = net_->net.getUnconnectedOutLayersNames();
        for (const std::string& name :
             onnxOutputs({reinterpret_cast<const char*>(bytes.data()), bytes.size()}))
            if (std::ranges::find(found, name) != found.end() &&
                std::ranges::find(net_->outputs, name) == net_->outputs.end())
                net_->outputs.push_back(name);
        if (net_->outputs.empty()) net_->outputs = found;
        return 0;
    });
}

std::vector<float> MattingNetwork::share(const Image& rgb) {
    const int side = kind_ == MattingKind::Modnet ? 512 : 1024;
    const double scale = kind_ == MattingKind::Modnet ? 1 / 127.5 : 1 / 255.;
    const Image square = resize(rgb, side, side);
    const int shape[] = {1, 3, side, side};
    cv::Mat input(4, shape, CV_32F);
    const size_t plane = size_t(side) * size_t(side);
    auto* values = input.ptr<float>();
    for (size_t i = 0; i < plane; ++i)
        for (size_t c = 0; c < 3; ++c)
            values[c * plane + i] = float((square.data[3 * i + c] - 127.5) * scale);
    const cv::Mat matte = guarded(path_, [&] {
        net_->net.setInput(input);
        std::vector<cv::Mat> outputs;
        net_->net.forward(outputs, net_->outputs);
        // Networks with several scales give the finest as their largest, or all as large and the
        // finest first, as ISNet does.
        cv::Mat best;
        for (const cv::Mat& output : outputs) {
            const bool one = output.dims == 4 && output.size[0] == 1 && output.size[1] == 1 &&
                             output.type() == CV_32F && output.isContinuous();
            if (one && (best.empty() || output.total() > best.total())) best = output;
        }
        return best;
    });
    if (matte.empty()) throwInput("{}: expected an output [1,1,H,W] of floats, found none", path_);
    Image small(matte.size[3], matte.size[2], 1);
    const auto* given = matte.ptr<float>();
    for (size_t i = 0; i < small.data.size(); ++i) {
        const float v = std::isfinite(given[i]) ? std::clamp(given[i], 0.f, 1.f) : 0.f;
        small.data[i] = uint8_t(std::lround(255 * v));
    }
    const Image whole = resize(small, rgb.width, rgb.height);
    std::vector<float> share;
    for (uint8_t v : whole.data) share.push_back(float(v) / 255);
    return share;
}

#else

bool MattingNetwork::available() { return false; }

struct MattingNetwork::Net {};

MattingNetwork::MattingNetwork(const std::filesystem::path& file, std::string_view kind)
    : name_(file.filename().string()), path_(file.string()), kind_(kindOf(kind)) {
    throwInput(
        "--matting: expected a build with OpenCV's dnn, found one without: install "
        "libopencv-dnn-dev and build anew (cmake --preset release && cmake --build build)");
}

std::vector<float> MattingNetwork::share(const Image&) { return {}; }

#endif

MattingNetwork::~MattingNetwork() = default;

}  // namespace doppel
