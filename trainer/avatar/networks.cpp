#include "trainer/avatar/networks.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

#include "engine/io/image.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/gan.h"
#include "nn/ops/texture.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/data/sheet.h"

namespace doppel {

namespace {

TextureUnetConfig unetConfig(const TexturePreset& preset) {
    TextureUnetConfig config;
    config.size = preset.textureSize;
    config.width = preset.width;
    config.downs = preset.depth;
    return config;
}

double secondsNow() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

}  // namespace

// ---- stage 1 ------------------------------------------------------------------------------------

void declareMeshNet(Parameters& parameters, const Avatar& avatar, uint64_t seed) {
    addMeshNetParameters(parameters, meshNetConfig(avatar.preset.mesh),
                         static_cast<uint32_t>(seed));
}

MeshNetConfig meshNetConfig(const MeshPreset& preset) {
    return {.blocks = preset.blocks,
            .layers = preset.layers,
            .hidden = preset.hidden,
            .deviation = static_cast<float>(preset.deviation)};
}

ClampBounds clampsOf(const MeshPreset& preset) {
    return preset.clamps == "none"      ? ClampBounds::None
           : preset.clamps == "program" ? ClampBounds::Program
                                        : ClampBounds::Paper;
}

MeshNetwork meshNetwork(Graph& graph, const Avatar& avatar, const Parameters& parameters) {
    const MeshPreset& preset = avatar.preset.mesh;
    return meshNetwork(graph, avatar.body, meshNetConfig(preset), clampsOf(preset), parameters);
}

// ---- stage 2 ------------------------------------------------------------------------------------

TextureNet::TextureNet(Device& device, const TexturePreset& preset, uint64_t seed)
    : preset_(preset), unet_(unetConfig(preset), "texture", static_cast<uint32_t>(seed)) {
    unet_.allocate(device);
}

TextureNet::TextureNet(Device& device, const TexturePreset& preset, const WeightMap& weights)
    : preset_(preset), unet_(unetConfig(preset), "texture", std::nullopt) {
    unet_.allocate(device);
    loadWeights(unet_.parameters(), weights, "texture_net.safetensors");
    loadWeights(unet_.statistics(), weights, "texture_net.safetensors");
}

WeightMap TextureNet::weights() const { return weightsOf(unet_); }

std::vector<Tensor> TextureNet::forward(Graph& graph, const std::vector<Tensor>& maps,
                                        bool training) const {
    return paintTextures(graph, unet_, maps, {training, training && preset_.dropout > 0});
}

std::vector<float> paintedTexture(Device& device, const TextureNet& net) {
    Graph graph(device);
    Tensor texture = net.forward(graph, {}, false).at(0);
    graph.output(texture);
    graph.compile();
    graph.run();
    return graph.read<float>(texture);
}

void paintTexture(Device& device, Avatar& avatar) {
    TextureNet net(device, avatar.preset.texture, avatar.textureNet);
    avatar.textureSize = avatar.preset.texture.textureSize;
    avatar.texture = paintedTexture(device, net);
}

// ---- stage 3 ------------------------------------------------------------------------------------

RefineConfig refineConfig(const Preset& preset) {
    const RefinePreset& p = preset.refine;
    auto f = [](double value) { return static_cast<float>(value); };
    RefineConfig config;
    config.size = p.size;
    config.textureSize = preset.texture.textureSize;
    config.width = p.width;
    config.depth = p.depth;
    config.discriminatorWidth = p.discriminatorWidth;
    config.faceSize = p.faceSize;
    config.batch = p.batch;
    config.dropout = p.dropout > 0;
    config.imageDiscriminator = p.imageDiscriminator;
    config.faceDiscriminator = p.faceDiscriminator;
    config.leastSquares = p.loss == "squares";
    config.adversarial = f(p.adversarial);
    config.reconstruction = f(p.reconstruction);
    config.misaligned = f(p.misaligned);
    config.unionRegion = p.region == "union";
    config.ownMasks = p.masks == "own";
    config.oneSided = p.apart == "rendered";
    config.residual = p.residual == "program" ? Residual::Program : Residual::Clamped;
    config.generatorOptimiser = adamwOptions(p.beta1, p.beta2, p.weightDecay);
    config.discriminatorOptimiser = config.generatorOptimiser;
    config.discriminatorOptimiser.rateScale = f(p.lrDiscriminator / p.lr);
    return config;
}

RefineNet::RefineNet(Device& device, const Avatar& avatar)
    : unet_(refineUnetConfig(refineConfig(avatar.preset)), "refine", std::nullopt),
      residual_(refineConfig(avatar.preset).residual) {
    unet_.allocate(device);
    loadWeights(unet_.parameters(), avatar.refineNet, "refine_net.safetensors");
    loadWeights(unet_.statistics(), avatar.refineNet, "refine_net.safetensors");
}

Tensor RefineNet::forward(Graph& graph, const TextureNet& coarse, std::span<const float> constant,
                          const Tensor& map) const {
    int64_t size = unet_.config().size;
    Tensor maps = map.reshaped({1, 1, size, size}), planes;
    if (constant.empty())
        planes =
            scaleShift(graph, coarse.unet().forward(graph, maps, {.frozen = true}), 0.5f, 0.5f);
    else
        planes = planar(graph, {graph.constant(constant, {size, size, 3})});
    return interleave(graph,
                      refineTextures(graph, unet_, planes, maps, {.frozen = true}, residual_))
        .at(0);
}

WeightMap weightsOf(const TextureUnet& unet) {
    WeightMap all = readWeights(unet.parameters());
    all.merge(readWeights(unet.statistics()));
    return all;
}

// ---- what the stages share ----------------------------------------------------------------------

AdamWOptions adamwOptions(double beta1, double beta2, double weightDecay) {
    AdamWOptions options;
    options.beta1 = static_cast<float>(beta1);
    options.beta2 = static_cast<float>(beta2);
    options.weightDecay = static_cast<float>(weightDecay);
    return options;
}

StepParams stepParams(int64_t i, uint64_t seed, double rate, const AdamWOptions& options) {
    StepParams params =
        adamwStepParams(static_cast<uint32_t>(i + 1), static_cast<float>(rate), options);
    params.seed = static_cast<uint32_t>(seed);
    return params;
}

std::map<std::string, std::string> stageIdentity(const Avatar& avatar, const std::string& stage) {
    std::map<std::string, std::string> identity;
    identity["vertices"] = fmt::format("{}", avatar.body.vertexCount);
    for (const auto& [name, value] : presetValues(avatar.preset))
        if (name.starts_with(stage + ".")) identity[name] = value;
    return identity;
}

double readLoss(Graph& graph, const Tensor& loss, const char* stage, int64_t step, int back) {
    double value = static_cast<double>(graph.readScalar(loss, back));
    if (!std::isfinite(value))
        throwMachine("stage {}: a loss became {} at step {}; a lower learning rate may help", stage,
                     value, step + 1);
    return value;
}

void printPlan(const char* stage, const Graph& graph, const Parameters& parameters) {
    auto mib = [](uint64_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
    fmt::print(
        "stage {}: {} dispatches; parameters with gradients and moments {:.1f} MiB, "
        "activations {:.1f} MiB planned ({:.1f} MiB without reuse)\n",
        stage, graph.dispatchCount(), mib(parameters.elements() * 4 * Parameters::kSectionCount),
        mib(graph.temporaryBytes()), mib(graph.unsharedBytes()));
}

void printProfile(const char* stage, Graph& graph) {
    struct Sum {
        int count = 0;
        double mib = 0, gflop = 0, milliseconds = 0;
    };
    std::map<std::string, Sum> sums;
    Sum all;
    for (const OpProfile& op : graph.profile())
        for (Sum* sum : {&sums[op.name], &all}) {
            sum->count += 1;
            sum->mib += static_cast<double>(op.bytes) / (1 << 20);
            sum->gflop += op.flops * 1e-9;
            sum->milliseconds += op.milliseconds;
        }
    std::vector<std::pair<std::string, Sum>> rows(sums.begin(), sums.end());
    std::ranges::sort(rows, [](const auto& a, const auto& b) {
        return a.second.milliseconds > b.second.milliseconds;
    });
    rows.emplace_back("all", all);
    fmt::print("{:<36} {:>6} {:>10} {:>9} {:>10}\n", std::string("stage ") + stage, "ops", "MiB",
               "GFLOP", "ms");
    for (const auto& [name, sum] : rows)
        fmt::print("{:<36} {:>6} {:>10.1f} {:>9.2f} {:>10.2f}\n", name, sum.count, sum.mib,
                   sum.gflop, sum.milliseconds);
}

PictureClock::PictureClock(double seconds) : seconds_(seconds), last_(secondsNow()) {}

bool PictureClock::due() {
    if (seconds_ <= 0 || secondsNow() - last_ < seconds_) return false;
    last_ = secondsNow();
    return true;
}

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
