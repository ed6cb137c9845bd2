// Networks for other programs, run by those programs: OpenCV's dnn and ONNX Runtime.
#include "trainer/avatar/formats/network_files.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <sstream>

#ifdef DOPPEL_OPENCV_DNN
#include <opencv2/dnn.hpp>
#endif

#include "engine/error.h"
#include "nn/ops/body.h"
#include "nn/ops/texture.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/commands/cli.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

std::vector<float> randomFloats(size_t count, double least, double most, uint32_t seed) {
    const std::vector<double> drawn = uniform({int64_t(count)}, least, most, seed).data;
    return {drawn.begin(), drawn.end()};
}

struct Given {
    std::string name;
    std::vector<int64_t> shape;
    std::vector<float> values;
};

// What a network of ours makes of its inputs.
struct Case {
    std::string network;
    std::vector<Given> inputs;
    std::vector<float> expected;
};

Case meshCase(const Avatar& avatar) {
    // The body in a pose with all joints bent, without global orientation.
    Graph posing(testDevice());
    std::vector<float> theta = randomFloats(kThetaSize, -.4, .4, 3), zeros(3);
    std::fill_n(theta.begin(), 3, 0.f);
    Tensor posed = lbs(posing, lbsModel(posing, avatar.body),
                       posing.constant(avatar.body.restVertices(), {avatar.body.vertexCount, 3}),
                       posing.constant(std::span<const float>(theta), {kThetaSize}),
                       posing.constant(std::span<const float>(avatar.betas), {10}),
                       posing.constant(std::span<const float>(zeros), {3}))
                       .verts;
    posing.output(posed);
    posing.compile();
    posing.run();
    const std::vector<float> verts = posing.read<float>(posed);

    Parameters parameters;
    declareMeshNet(parameters, avatar, 0);
    parameters.allocate(testDevice());
    loadWeights(parameters, avatar.meshNet, "mesh_net");
    Graph graph(testDevice());
    Tensor refined = meshNetwork(graph, avatar, parameters)
                         .net.refine(graph.constant(verts, {avatar.body.vertexCount, 3}))
                         .back();
    graph.output(refined);
    graph.compile();
    graph.run();
    Case result{"mesh_net",
                {{"vertices", {avatar.body.vertexCount, 3}, verts}},
                graph.read<float>(refined)};
    double most = 0;
    for (size_t i = 0; i < verts.size(); ++i)
        most = std::max(most, std::abs(double{result.expected[i]} - double{verts[i]}));
    EXPECT_GT(most, .001) << "the network moves vertices";
    return result;
}

// Our textures have channels side by side, networks have them one after the other.
std::vector<float> planesOf(const std::vector<float>& texture) {
    std::vector<float> planes(texture.size());
    const size_t pixels = texture.size() / 3;
    for (size_t i = 0; i < texture.size(); ++i) planes[i % 3 * pixels + i / 3] = texture[i];
    return planes;
}

Given visibilityOf(const Avatar& avatar) {
    const int64_t size = avatar.preset.texture.textureSize;
    return {"visibility", {1, 1, size, size}, randomFloats(size_t(size * size), 0, 1, 7)};
}

Case textureCase(const Avatar& avatar) {
    const Given map = visibilityOf(avatar);
    const int64_t size = map.shape[2];
    TextureNet net(testDevice(), avatar);
    Graph graph(testDevice());
    Tensor texture = net.forward(graph, {graph.constant(map.values, {size, size})}, false).at(0);
    graph.output(texture);
    graph.compile();
    graph.run();
    return {"texture_net", {map}, planesOf(graph.read<float>(texture))};
}

Case refineCase(const Avatar& avatar) {
    const Given map = visibilityOf(avatar);
    const int64_t size = map.shape[2];
    const Case coarse = textureCase(avatar);
    TextureNet net(testDevice(), avatar);
    RefineNet refineNet(testDevice(), avatar);
    Graph graph(testDevice());
    Tensor texture = refineNet.forward(graph, net, {}, graph.constant(map.values, {size, size}));
    graph.output(texture);
    graph.compile();
    graph.run();
    return {"refine_net",
            {{"coarse", {1, 3, size, size}, coarse.expected}, map},
            planesOf(graph.read<float>(texture))};
}

void expectTheSame(const std::vector<float>& found, const Case& expected) {
    ASSERT_EQ(found.size(), expected.expected.size()) << expected.network;
    double most = 0;
    for (size_t i = 0; i < found.size(); ++i)
        most = std::max(most, std::abs(double{found[i]} - double{expected.expected[i]}));
    EXPECT_LT(most, 1e-4) << expected.network;
    const auto [least, largest] = std::ranges::minmax(expected.expected);
    EXPECT_GT(largest - least, .1) << expected.network << " paints something";
    fmt::print("{}: {:.1e} at most\n", expected.network, most);
}

// Small networks that were trained, over texels and in blocks of 2×2 pixels; and others as they are
// drawn, without either, that bend what they can.
class NetworkFiles : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<Folder>();
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = test::tinyPreset();
        avatar.preset.refine.steps = 20;
        TrainSettings settings;
        settings.out = *folder_ / "trained";
        settings.stages = {"fit", "texels", "mesh", "texture", "refine"};
        settings.pictureSeconds = 0;
        trainAvatar(testDevice(), avatar, test::tinyCapture(*folder_ / "capture"), settings);

        avatar.preset.texture.block = 1;
        avatar.preset.texture.depth = 6;
        avatar.preset.mesh.blocks = 2;
        avatar.preset.mesh.clamps = ClampBounds::None;
        avatar.preset.refine.residual = Residual::Program;
        avatar.textureSize = avatar.preset.texture.textureSize;
        avatar.texture.assign(size_t(3 * avatar.textureSize * avatar.textureSize), .5f);
        Parameters mesh;
        declareMeshNet(mesh, avatar, 1);
        mesh.allocate(testDevice());
        avatar.meshNet = readWeights(mesh);
        uint32_t seed = 11;
        for (auto& [name, tensor] : avatar.meshNet)
            tensor.values = randomFloats(tensor.values.size(), -.2, .2, ++seed);
        avatar.textureNet = TextureNet(testDevice(), avatar, 1).weights();
        TextureUnet refine(refineUnetConfig(avatar.preset.refine, avatar.preset.texture), "refine",
                           1);
        refine.allocate(testDevice());
        avatar.refineNet = weightsOf(refine);
        // As they are drawn, networks paint hardly anything.
        for (WeightMap* weights : {&avatar.textureNet, &avatar.refineNet})
            for (auto& [name, tensor] : *weights)
                if (tensor.shape.size() == 4)
                    for (float& weight : tensor.values) weight *= 4;
        writeAvatar(*folder_ / "drawn", avatar);
    }
    static void TearDownTestSuite() { folder_.reset(); }

    // Writes the avatar's networks as the command does.
    static fs::path written(const std::string& name) {
        const fs::path out = *folder_ / (name + "-networks");
        std::ostringstream text, errors;
        EXPECT_EQ(runCommandLine({"export", (*folder_ / name).string(), "--networks", out.string()},
                                 text, errors),
                  0)
            << errors.str();
        return out;
    }

    static std::unique_ptr<Folder> folder_;
};
std::unique_ptr<Folder> NetworkFiles::folder_;

TEST_F(NetworkFiles, HoldAllThatNetworksStandOn) {
    const fs::path out = written("trained");
    const Avatar avatar = readAvatar(*folder_ / "trained");
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(out))
        if (entry.path().filename() != ".doppel-files") names.push_back(entry.path().filename());
    std::ranges::sort(names);
    EXPECT_EQ(names, (std::vector<std::string>{
                         "README.txt", "mesh_net.onnx", "mesh_net.safetensors", "refine_net.onnx",
                         "refine_net.safetensors", "texture_net.onnx", "texture_net.safetensors"}));
    const std::string note = test::bytesOf(out / "README.txt");
    EXPECT_NE(note.find(fmt::format("input   vertices [{},3]", avatar.body.vertexCount)),
              std::string::npos)
        << note;
    const auto expectHeld = [&](const char* name, const WeightMap& weights,
                                std::vector<std::string> beside) {
        const WeightMap read = readSafetensors(out / (std::string(name) + ".safetensors")).tensors;
        EXPECT_EQ(read.size(), weights.size() + beside.size()) << name;
        for (const auto& [tensor, content] : weights) {
            ASSERT_TRUE(read.contains(tensor)) << tensor;
            EXPECT_EQ(read.at(tensor).values, content.values) << tensor;
            EXPECT_NE(
                note.find(fmt::format("    {} [{}]\n", tensor, fmt::join(content.shape, ","))),
                std::string::npos)
                << tensor;
        }
        for (const std::string& tensor : beside) EXPECT_TRUE(read.contains(tensor)) << tensor;
    };
    expectHeld("mesh_net", avatar.meshNet, {"mesh.limit"});
    expectHeld("texture_net", avatar.textureNet, {"texels"});
    expectHeld("refine_net", avatar.refineNet, {});

    // The same again, to the byte, over what was there.
    const std::string before = test::bytesOf(out / "mesh_net.onnx");
    written("trained");
    EXPECT_EQ(test::bytesOf(out / "mesh_net.onnx"), before);
}

TEST_F(NetworkFiles, Refusals) {
    Folder folder;
    Avatar plain;
    plain.bodyArrays = readBodyArrays("default");
    plain.body = bodyFromNpz(plain.bodyArrays);
    plain.preset = test::tinyPreset();
    writeAvatar(folder / "plain", plain);
    const auto refused = [](const std::vector<std::string>& words) {
        std::ostringstream out, errors;
        EXPECT_EQ(runCommandLine(words, out, errors), 2);
        return errors.str();
    };
    EXPECT_NE(refused({"export", (folder / "plain").string(), "--networks",
                       (folder / "networks").string()})
                  .find("plain: it has no networks yet; train stage mesh, texture or refine first"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "networks"));
    // An avatar.toml that was edited.
    Avatar other = readAvatar(*folder_ / "drawn");
    other.preset.mesh.hidden = 24;
    EXPECT_NE(messageOf<InputError>([&] {
                  writeNetworks(folder.path(), other);
              }).find("mesh_net.safetensors: mesh.block0.layer0.weight0"),
              std::string::npos);
    const auto refusedBeside = [&](const std::vector<std::string>& more) {
        std::vector<std::string> words{"export", "a", "--networks", "b"};
        words.insert(words.end(), more.begin(), more.end());
        return refused(words);
    };
    EXPECT_NE(refusedBeside({"--out", "a.glb"}).find("found --out and --networks"),
              std::string::npos);
    EXPECT_NE(
        refusedBeside({"--shapes"}).find("--shapes: expected --out or --web, found --networks"),
        std::string::npos);
    EXPECT_NE(refusedBeside({"--motion", "c"}).find("--motion: expected --out or --web"),
              std::string::npos);
}

TEST_F(NetworkFiles, OpenCvPaintsTheSameTextures) {
#ifdef DOPPEL_OPENCV_DNN
    for (const char* name : {"trained", "drawn"}) {
        const fs::path out = written(name);
        const Avatar avatar = readAvatar(*folder_ / name);
        for (const Case& expected : {textureCase(avatar), refineCase(avatar)}) {
            cv::dnn::Net net =
                cv::dnn::readNetFromONNX((out / (expected.network + ".onnx")).string());
            for (const Given& given : expected.inputs) {
                const std::vector<int> shape(given.shape.begin(), given.shape.end());
                net.setInput(cv::Mat(shape, CV_32F, const_cast<float*>(given.values.data())),
                             given.name);
            }
            const cv::Mat result = net.forward("texture");
            const auto* begin = result.ptr<float>();
            expectTheSame({begin, begin + result.total()}, expected);
        }
    }
#else
    GTEST_SKIP() << "built without OpenCV's dnn: libopencv-dnn-dev was not installed";
#endif
}

TEST_F(NetworkFiles, OnnxRuntimeMakesTheSameOfThem) {
    if (std::system("node -e \"require('onnxruntime-node')\" 2>/dev/null") != 0)
        GTEST_SKIP() << "no node, or no package onnxruntime-node";
    for (const char* name : {"trained", "drawn"}) {
        const fs::path out = written(name);
        const Avatar avatar = readAvatar(*folder_ / name);
        for (const Case& expected : {meshCase(avatar), textureCase(avatar), refineCase(avatar)}) {
            Folder folder;
            const auto bytes = [](const std::vector<float>& values) {
                return std::span(reinterpret_cast<const uint8_t*>(values.data()),
                                 values.size() * sizeof(float));
            };
            nlohmann::json scene{{"model", (out / (expected.network + ".onnx")).string()},
                                 {"output", (folder / "output").string()},
                                 {"inputs", nlohmann::json::array()}};
            for (const Given& given : expected.inputs) {
                folder.write(given.name, bytes(given.values));
                scene["inputs"].push_back({{"name", given.name},
                                           {"shape", given.shape},
                                           {"file", (folder / given.name).string()}});
            }
            folder.write("scene.json", scene.dump());
            ASSERT_EQ(std::system(fmt::format("node '{}/tests/onnx/run.js' '{}'",
                                              test::sourceFolder().string(),
                                              (folder / "scene.json").string())
                                      .c_str()),
                      0);
            const std::string result = test::bytesOf(folder / "output");
            std::vector<float> found(result.size() / sizeof(float));
            std::memcpy(found.data(), result.data(), found.size() * sizeof(float));
            expectTheSame(found, expected);
        }
    }
}

}  // namespace
}  // namespace doppel
