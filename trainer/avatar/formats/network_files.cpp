#include "trainer/avatar/formats/network_files.h"

#include <algorithm>
#include <array>
#include <optional>

#include "engine/files/atomic_file.h"
#include "engine/io/onnx.h"
#include "engine/io/safetensors.h"
#include "nn/body/mesh_topology.h"
#include "nn/ops/conv/conv.h"
#include "shaders/mesh/params.h"
#include "trainer/avatar/networks.h"
#include "trainer/data/version.h"

namespace doppel {

namespace fs = std::filesystem;

namespace {

using Shape64 = std::vector<int64_t>;

struct Value {
    std::string name;
    Shape64 shape;
    std::string about;
};

// A network that is being written down.
class Sheet {
public:
    Sheet(std::string name, std::string about, Safetensors weights)
        : weights_(std::move(weights)), name_(std::move(name)), about_(std::move(about)) {
        graph.emplace(name_, about_);
    }

    std::string input(const Value& value) {
        inputs_.push_back(value);
        return graph->input(value.name, value.shape, value.about);
    }
    void output(const std::string& what, const Value& value) {
        output_ = value;
        graph->output(value.name, what, value.shape, value.about);
    }
    // A tensor of the network, as a constant of the graph.
    std::string weight(const std::string& name, const Shape64& shape) {
        return graph->constant(name, weights_.at(name, shape));
    }
    // What the network stands on and is not trained; goes into the tensors' file as well.
    std::string given(const std::string& name, Tensor32 tensor) {
        weights_.tensors[name] = std::move(tensor);
        return graph->constant(name, weights_.tensors[name]);
    }

    void write(const fs::path& folder) {
        graph->write(folder / (name_ + ".onnx"));
        graph.reset();
        weights_.metadata["format"] = "doppel";
        writeSafetensors(folder / (name_ + ".safetensors"), weights_);
    }
    std::string note() const {
        std::string text = fmt::format("{}: {}\n", name_, about_);
        const auto line = [&](const char* kind, const Value& value) {
            text += fmt::format("  {:<7} {} [{}]: {}\n", kind, value.name,
                                fmt::join(value.shape, ","), value.about);
        };
        for (const Value& value : inputs_) line("input", value);
        line("output", output_);
        text += fmt::format("  tensors of {}.safetensors, float32:\n", name_);
        for (const auto& [name, tensor] : weights_.tensors)
            text += fmt::format("    {} [{}]\n", name, fmt::join(tensor.shape, ","));
        return text + "\n";
    }

    std::optional<OnnxGraph> graph;

private:
    Safetensors weights_;
    std::string name_, about_;
    std::vector<Value> inputs_;
    Value output_;
};

Sheet sheet(const char* name, const char* about, const WeightMap& weights) {
    Safetensors file;
    file.tensors = weights;
    file.file = std::string(name) + ".safetensors";
    return {name, about, std::move(file)};
}

// ---- the mesh network ---------------------------------------------------------------------------

// Lists by row, all as long as the longest: what is missing is `filling(row)`.
struct Table {
    int64_t width = 1;
    std::vector<int64_t> entries;  // [V,width]
};

template <typename Entry, typename Filling>
Table table(const std::vector<int32_t>& begin, Entry entry, Filling filling) {
    Table result;
    for (size_t v = 0; v + 1 < begin.size(); ++v)
        result.width = std::max<int64_t>(result.width, begin[v + 1] - begin[v]);
    for (size_t v = 0; v + 1 < begin.size(); ++v)
        for (int64_t k = 0; k < result.width; ++k)
            result.entries.push_back(k < begin[v + 1] - begin[v] ? entry(size_t(begin[v] + k))
                                                                 : filling(v));
    return result;
}

// Runtimes have no operation along lists of neighbours of different lengths, so that lists are
// padded: with a vertex itself, whose corner then has no area, or with a row of zeros behind the
// last vertex.
class MeshSheet {
public:
    MeshSheet(OnnxGraph& graph, const MeshTopology& mesh, int64_t hidden)
        : g_(graph), vertices_(mesh.vertexCount) {
        const auto self = [](size_t v) { return static_cast<int64_t>(v); };
        const auto corner = [&](int side) {
            return table(
                mesh.cornerBegin,
                [&, side](size_t i) { return int64_t{mesh.corners[3 * i + size_t(side)]}; }, self);
        };
        const Table next = corner(1), previous = corner(2);
        const Table neighbours = table(
            mesh.adjacency.begin, [&](size_t i) { return int64_t{mesh.adjacency.neighbours[i]}; },
            [&](size_t) { return mesh.vertexCount; });
        next_ = g_.list("corners_next", next.entries, {vertices_, next.width});
        previous_ = g_.list("corners_previous", previous.entries, {vertices_, next.width});
        neighbours_ = g_.list("neighbours", neighbours.entries, {vertices_, neighbours.width});
        forward_ = g_.list("axes_yzx", {1, 2, 0});
        backward_ = g_.list("axes_zxy", {2, 0, 1});
        smallest_ = g_.number("smallest_normal", kNormalEpsilon);
        nothing_ = g_.constant("no_neighbour",
                               {{1, hidden}, std::vector<float>(static_cast<size_t>(hidden))});
    }

    // n = s / max(|s|, epsilon), s the sum of the corners' cross products.
    std::string normals(const std::string& verts) {
        const std::string here = g_.add("Unsqueeze", {verts}, {{"axes", Shape64{1}}});
        const auto edge = [&](const std::string& to) {
            return g_.add("Sub", {g_.add("Gather", {verts, to}, {{"axis", int64_t{0}}}), here});
        };
        const auto turned = [&](const std::string& edges, const std::string& axes) {
            return g_.add("Gather", {edges, axes}, {{"axis", int64_t{2}}});
        };
        const std::string a = edge(next_), b = edge(previous_);
        const std::string cross =
            g_.add("Sub", {g_.add("Mul", {turned(a, forward_), turned(b, backward_)}),
                           g_.add("Mul", {turned(a, backward_), turned(b, forward_)})});
        const std::string sum = summed(cross);
        const std::string length =
            g_.add("ReduceL2", {sum}, {{"axes", Shape64{1}}, {"keepdims", int64_t{1}}});
        return g_.add("Div", {sum, g_.add("Max", {length, smallest_})});
    }

    // ReLU(W0 x_i + b0 + the sum over the neighbours j of (W1 x_j + b1)).
    std::string graphConv(const std::string& x, const std::array<std::string, 4>& weights) {
        const std::string own = linear(x, weights[0], weights[1]);
        const std::string given = linear(x, weights[2], weights[3]);
        const std::string padded = g_.add("Concat", {given, nothing_}, {{"axis", int64_t{0}}});
        const std::string gathered =
            g_.add("Gather", {padded, neighbours_}, {{"axis", int64_t{0}}});
        return g_.add("Relu", {g_.add("Add", {own, summed(gathered)})});
    }

    std::string linear(const std::string& x, const std::string& weight, const std::string& bias) {
        return g_.add("Gemm", {x, weight, bias}, {{"transB", int64_t{1}}});
    }

private:
    // Over the lists: [V,width,C] -> [V,C].
    std::string summed(const std::string& x) {
        return g_.add("ReduceSum", {x}, {{"axes", Shape64{1}}, {"keepdims", int64_t{0}}});
    }

    OnnxGraph& g_;
    int64_t vertices_;
    std::string next_, previous_, neighbours_, forward_, backward_, smallest_, nothing_;
};

Sheet meshSheet(const Avatar& avatar) {
    Sheet net = sheet("mesh_net", "moves the vertices of a posed body so that it wears its clothes",
                      avatar.meshNet);
    const BodyModel& body = avatar.body;
    const MeshNetConfig config = meshNetConfig(avatar.preset.mesh);
    const int64_t V = body.vertexCount, H = config.hidden;
    OnnxGraph& graph = *net.graph;
    std::string now = net.input(
        {"vertices",
         {V, 3},
         "the body posed without global orientation and translation, metres: x to its left, y up"});
    MeshSheet mesh(graph, meshTopology(body.faces, V, body.file), H);
    std::vector<float> limit = clampBounds(body, avatar.preset.mesh.clamps), lowest = limit;
    for (float& bound : lowest) bound = -bound;
    const std::string highest = net.given("mesh.limit", {{V, 1}, limit});
    const std::string least = graph.constant("mesh.least", {{V, 1}, lowest});

    std::string features;
    for (int b = 0; b < config.blocks; ++b) {
        const std::string normals = mesh.normals(now);
        const auto withNormals = [&](const std::string& x) {
            return x.empty() ? normals : graph.add("Concat", {x, normals}, {{"axis", int64_t{1}}});
        };
        for (int l = 0; l < config.layers; ++l) {
            const std::string name = fmt::format("mesh.block{}.layer{}.", b, l);
            const int64_t inputs = features.empty() ? 3 : H + 3;
            features = mesh.graphConv(
                withNormals(features),
                {net.weight(name + "weight0", {H, inputs}), net.weight(name + "bias0", {H}),
                 net.weight(name + "weight1", {H, inputs}), net.weight(name + "bias1", {H})});
        }
        const std::string name = fmt::format("mesh.block{}.offset.", b);
        const std::string offset = graph.add(
            "Tanh", {mesh.linear(withNormals(features), net.weight(name + "weight", {3, H + 3}),
                                 net.weight(name + "bias", {3}))});
        now =
            graph.add("Add", {now, graph.add("Min", {graph.add("Max", {offset, least}), highest})});
    }
    net.output(now, {"refined", {V, 3}, "the refined mesh, in the same frame"});
    return net;
}

// ---- the texture networks -----------------------------------------------------------------------

class UnetSheet {
public:
    // InputError where the sizes do not fit.
    UnetSheet(Sheet& net, const TextureUnetConfig& config)
        : net_(net), g_(*net.graph), c_(TextureUnet(config, "checked", std::nullopt).config()) {}

    // x [1,inputs,size,size] -> [1,outputs,size,size] in [-1,1].
    std::string forward(const std::string& x, int64_t inputs) {
        const int64_t n = c_.downs, r = c_.block, side = c_.size / r;
        std::string h = x;
        if (r > 1) {  // channels of a block's pixels, by channel, row, column
            h = reshaped("unshuffle", h, {1, inputs, side, r, side, r});
            h = g_.add("Transpose", {h}, {{"perm", Shape64{0, 1, 3, 5, 2, 4}}});
            h = reshaped("unshuffled", h, {1, inputs * r * r, side, side});
        }
        std::vector<std::string> encoded;
        int64_t channels = inputs * r * r;
        for (int64_t i = 1; i <= n; ++i) {
            const std::string layer = fmt::format("enc{}", i);
            const int64_t out = features(i);
            h = convolved("Conv", h, layer, {out, channels, 4, 4}, out, i == 1 || i == n);
            channels = out;
            if (i == n) break;
            if (i > 1) h = normalised(h, layer, out);
            h = g_.add("LeakyRelu", {h}, {{"alpha", TextureUnet::kSlope}});
            encoded.push_back(h);
        }
        for (int64_t j = 1; j <= n; ++j) {
            const std::string layer = fmt::format("dec{}", j);
            const int64_t out = j == n ? r * r * c_.outputChannels : features(n - j);
            if (j > 1) {
                h = g_.add("Concat", {h, encoded[size_t(n - j)]}, {{"axis", int64_t{1}}});
                channels *= 2;
            }
            h = g_.add("Relu", {h});
            h = convolved("ConvTranspose", h, layer, {channels, out, 4, 4}, out, j == n);
            if (j < n) h = normalised(h, layer, out);
            channels = out;
        }
        h = g_.add("Tanh", {h});
        if (r == 1) return h;
        h = reshaped("shuffle", h, {1, c_.outputChannels, r, r, side, side});
        h = g_.add("Transpose", {h}, {{"perm", Shape64{0, 1, 4, 2, 5, 3}}});
        return reshaped("shuffled", h, {1, c_.outputChannels, c_.size, c_.size});
    }

    // a x + b, and x between two numbers.
    std::string scaled(const std::string& x, float a, float b) {
        const std::string times = g_.add("Mul", {x, number(a)});
        return b == 0 ? times : g_.add("Add", {times, number(b)});
    }
    std::string clamped(const std::string& x, float least, float most) {
        return g_.add("Clip", {x}, {{"min", least}, {"max", most}});
    }

private:
    int64_t features(int64_t step) const {
        return c_.width * (int64_t{1} << std::min<int64_t>(step - 1, 3));
    }
    std::string number(float value) {
        return g_.number(fmt::format("number_{}", numbers_++), value);
    }
    std::string reshaped(const std::string& name, const std::string& x, const Shape64& shape) {
        return g_.add("Reshape", {x, g_.list(name, shape)});
    }
    std::string convolved(const char* operation, const std::string& x, const std::string& layer,
                          const Shape64& shape, int64_t out, bool biased) {
        std::vector<std::string> inputs{x, net_.weight(layer + ".weight", shape)};
        if (biased) inputs.push_back(net_.weight(layer + ".bias", {out}));
        return g_.add(operation, inputs,
                      {{"kernel_shape", Shape64{4, 4}},
                       {"strides", Shape64{2, 2}},
                       {"pads", Shape64{1, 1, 1, 1}}});
    }
    std::string normalised(const std::string& x, const std::string& layer, int64_t channels) {
        const Shape64 shape{channels};
        return g_.add(
            "BatchNormalization",
            {x, net_.weight(layer + "_bn.weight", shape), net_.weight(layer + "_bn.bias", shape),
             net_.weight(layer + "_bn.running_mean", shape),
             net_.weight(layer + "_bn.running_var", shape)},
            {{"epsilon", BatchNormOptions().epsilon}});
    }

    Sheet& net_;
    OnnxGraph& g_;
    TextureUnetConfig c_;
    int numbers_ = 0;
};

Value visibility(int64_t size) {
    return {"visibility",
            {1, 1, size, size},
            "of each texel how far it faces the camera, 0 to 1; ones: all sides at once"};
}
Value texture(int64_t size) {
    return {"texture", {1, 3, size, size}, "red, green, blue, sRGB from 0 to 1"};
}

Sheet textureSheet(const Avatar& avatar) {
    Sheet net = sheet("texture_net", "paints the coarse texture for what faces the camera",
                      avatar.textureNet);
    const TextureUnetConfig config = textureUnetConfig(avatar.preset.texture);
    const int64_t size = config.size;
    UnetSheet unet(net, config);
    std::string x = net.input(visibility(size));
    std::string under;
    if (const std::vector<float> texels = texelsOf(avatar); !texels.empty()) {
        under = net.given("texels", {{1, 3, size, size}, TextureUnet::planesOf(texels)});
        x = net.graph->add("Concat", {under, x}, {{"axis", int64_t{1}}});
    }
    std::string y = unet.forward(x, under.empty() ? 1 : 4);
    if (!under.empty())
        y = unet.clamped(
            net.graph->add("Add", {under, unet.scaled(y, TextureUnet::kTexelResidual, 0)}), -1, 1);
    net.output(unet.scaled(y, .5f, .5f), texture(size));
    return net;
}

Sheet refineSheet(const Avatar& avatar) {
    Sheet net = sheet("refine_net", "adds what the coarse texture lacks, for what faces the camera",
                      avatar.refineNet);
    const TextureUnetConfig config = refineUnetConfig(avatar.preset.refine, avatar.preset.texture);
    const int64_t size = config.size;
    UnetSheet unet(net, config);
    const std::string coarse =
        net.input({"coarse", {1, 3, size, size}, "what texture_net makes of the same visibility"});
    const std::string map = net.input(visibility(size));
    const std::string x = net.graph->add("Concat", {coarse, map}, {{"axis", int64_t{1}}});
    const std::string half = unet.scaled(unet.forward(x, 4), .5f, 0);
    const bool program = avatar.preset.refine.residual == Residual::Program;
    net.output(program ? net.graph->add("Add", {unet.scaled(coarse, .5f, .5f), half})
                       : unet.clamped(net.graph->add("Add", {coarse, half}), 0, 1),
               texture(size));
    return net;
}

}  // namespace

std::vector<std::string> writeNetworks(const fs::path& folder, const Avatar& avatar) {
    struct Network {
        const char* name;
        const WeightMap& weights;
        Sheet (*make)(const Avatar&);
    };
    const std::array<Network, 3> networks{{{"mesh_net", avatar.meshNet, meshSheet},
                                           {"texture_net", avatar.textureNet, textureSheet},
                                           {"refine_net", avatar.refineNet, refineSheet}}};
    std::vector<std::string> written;
    std::string note = fmt::format(
        "Networks of an avatar, by Doppel {}. NAME.onnx (opset {}) runs in ONNX Runtime and its "
        "like;\nNAME.safetensors holds the same tensors. Shapes are fixed.\n\n",
        kVersion, kOnnxOpset);
    for (const Network& network : networks) {
        if (network.weights.empty()) continue;
        Sheet net = network.make(avatar);
        net.write(folder);
        note += net.note();
        written.emplace_back(network.name);
    }
    if (written.empty()) return written;
    AtomicFile file(folder / "README.txt");
    file.write(note);
    file.commit();
    return written;
}

}  // namespace doppel
