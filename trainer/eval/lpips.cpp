#include "trainer/eval/lpips.h"

#include <fmt/ranges.h>

#include <regex>

#include "engine/error.h"
#include "engine/io/weights.h"
#include "nn/ops/features.h"

namespace doppel {

namespace {

// What the authors' network subtracts from colours in [-1,1], and divides them by.
constexpr double kShift[] = {-.030, -.088, -.188}, kScale[] = {.458, .448, .450};

// "net.slice2.3.squeeze.weight" -> "features.3.squeeze.weight", "lins.0.model.1.weight" -> "lin0".
std::string commonName(const std::string& name) {
    static const std::regex slice(R"((?:module\.)?net\.slice\d+\.(.+))");
    static const std::regex head(R"((?:module\.)?lins?\.?(\d+)\.model\.1\.weight)");
    std::smatch match;
    if (std::regex_match(name, match, slice)) return "features." + match[1].str();
    if (std::regex_match(name, match, head)) return "lin" + match[1].str();
    return name;
}

std::vector<Safetensors> readAll(const std::vector<std::filesystem::path>& files) {
    std::vector<Safetensors> result;
    for (const std::filesystem::path& file : files) result.push_back(readWeights(file));
    return result;
}

// The backbones' weights in this order everywhere, so that each network asks once.
std::vector<std::pair<std::string, Shape>> neededWeights(Device& device, LpipsNet net) {
    std::vector<std::pair<std::string, Shape>> needed;
    Graph graph(device);
    int64_t side = lpipsSmallestSide(net);
    lpipsFeatures(graph, net, graph.input({1, 3, side, side}),
                  [&](const std::string& name, const Shape& shape) {
                      needed.emplace_back(name, shape);
                      return graph.input(shape);
                  });
    for (size_t i = 0; i < lpipsChannels(net).size(); ++i)
        needed.emplace_back(fmt::format("lin{}", i), Shape{1, lpipsChannels(net)[i], 1, 1});
    return needed;
}

}  // namespace

struct Lpips::Recording {
    int width, height;
    Graph graph;
    Tensor x;
    std::vector<Tensor> maps;  // per compared layer, distances of pixels

    Recording(Device& device, LpipsNet net, const std::map<std::string, Tensor32>& weights,
              int width_, int height_)
        : width(width_), height(height_), graph(device) {
        x = graph.input({2, 3, height, width});
        std::vector<Tensor> features =
            lpipsFeatures(graph, net, x, [&](const std::string& name, const Shape& shape) {
                return graph.constant(std::span<const float>(weights.at(name).values), shape);
            });
        for (size_t i = 0; i < features.size(); ++i) {
            const std::vector<float>& head = weights.at(fmt::format("lin{}", i)).values;
            Tensor weight =
                graph.constant(std::span<const float>(head), {static_cast<int64_t>(head.size())});
            maps.push_back(
                featureDistance(graph, features[i].slice(0, 1), features[i].slice(1, 1), weight));
            graph.output(maps.back());
        }
        graph.compile();
    }
};

Lpips::Lpips(Device& device, LpipsNet net, const std::vector<std::filesystem::path>& files)
    : Lpips(device, net, readAll(files)) {}

Lpips::Lpips(Device& device, LpipsNet net, std::vector<Safetensors> files)
    : device_(device), net_(net) {
    std::map<std::string, std::pair<const Tensor32*, std::string>> given;  // and where
    std::vector<std::string> names;
    for (const Safetensors& file : files) {
        names.push_back(file.file);
        for (const auto& [name, tensor] : file.tensors)
            given.insert_or_assign(commonName(name), std::pair(&tensor, file.file + ": " + name));
    }
    for (const auto& [name, shape] : neededWeights(device, net)) {
        bool head = name.starts_with("lin");
        const auto found = given.find(name);
        if (found == given.end())
            throwInput(
                "{}: expected {} {} of LPIPS's {} network, found none; give backbone and "
                "heads as --lpips BACKBONE,HEADS",
                fmt::join(names, ","), head ? "the head" : "the backbone's tensor",
                head ? name + ".model.1.weight" : name, lpipsNetName(net));
        const auto& [tensor, where] = found->second;
        if (tensor->shape != shape)
            throwInput("{}: expected shape {} for LPIPS's {} network, found {}", where,
                       toString(shape), lpipsNetName(net), toString(tensor->shape));
        weights_[name] = *tensor;
    }
}

Lpips::~Lpips() = default;

double Lpips::distance(std::span<const float> a, std::span<const float> b, int width, int height) {
    size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
    CHECK(a.size() == 3 * pixels && b.size() == 3 * pixels, "pictures are [{}][{}][3]", height,
          width);
    if (std::min(width, height) < lpipsSmallestSide(net_))
        throwInput("LPIPS: expected pictures of at least {} pixels for the {} network, found {}x{}",
                   lpipsSmallestSide(net_), lpipsNetName(net_), width, height);
    if (!recording_ || recording_->width != width || recording_->height != height) {
        recording_.reset();  // the memory of the one before, first
        recording_ = std::make_unique<Recording>(device_, net_, weights_, width, height);
    }
    std::vector<float> x(6 * pixels);
    for (size_t n = 0; n < 2; ++n)
        for (size_t c = 0; c < 3; ++c)
            for (size_t p = 0; p < pixels; ++p) {
                double colour = 2 * double((n == 0 ? a : b)[3 * p + c]) - 1;
                x[(3 * n + c) * pixels + p] = static_cast<float>((colour - kShift[c]) / kScale[c]);
            }
    Graph& graph = recording_->graph;
    graph.write(recording_->x, x);
    graph.run();
    double distance = 0;
    for (const Tensor& map : recording_->maps) {
        double sum = 0;
        for (float value : graph.read<float>(map)) sum += double(value);
        distance += sum / static_cast<double>(map.elements());
    }
    return distance;
}

}  // namespace doppel
