// Several processes that train one avatar: what they exchange, and that a split batch does what a
// whole one does.
#include "nn/core/ranks.h"

#include <gtest/gtest.h>

#include <signal.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>

#include "nn/ops/conv/conv.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/optim.h"
#include "tests/files.h"
#include "tests/thread_ranks.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar.h"
#include "trainer/stages/train.h"

namespace doppel::test {
namespace {

namespace fs = std::filesystem;

std::vector<float> noise(size_t count, uint32_t seed) {
    std::vector<float> values(count);
    for (float& value : values) {
        seed = seed * 1664525u + 1013904223u;
        value = static_cast<float>(seed >> 8) / (1 << 23) - 1;
    }
    return values;
}

TEST(Ranks, AverageInOneOrderWithTheFewestBytes) {
    for (int count : {1, 2, 3, 5})
        for (size_t size : {1u, 4u, 1001u}) {
            std::vector<std::vector<float>> given, found(static_cast<size_t>(count));
            for (int r = 0; r < count; ++r) given.push_back(noise(size, uint32_t(r) + 7));
            std::atomic<uint64_t> sent = 0;
            ThreadRanks::run(count, [&](Ranks& ranks) {
                const auto r = static_cast<size_t>(ranks.rank());
                found[r] = given[r];
                ranks.average(found[r]);
                sent += ranks.bytesSent();
                ranks.barrier();
            });
            for (size_t i = 0; i < size; ++i) {
                double sum = 0;
                for (const auto& one : given) sum += static_cast<double>(one[i]);
                EXPECT_EQ(found[0][i], static_cast<float>(sum * (1.0 / count)));
            }
            for (const auto& one : found) EXPECT_EQ(one, found[0]);
            // Every number from each rank but one to the one that sums it, and back.
            EXPECT_EQ(sent, 2 * sizeof(float) * size * (static_cast<size_t>(count) - 1));
        }
}

TEST(Ranks, GatherRowsSideBySide) {
    ThreadRanks::run(3, [](Ranks& ranks) {
        const auto r = static_cast<float>(ranks.rank());
        std::vector<float> mine{r, r + 10, r + 20, r + 30}, all(12);
        ranks.gather(mine, all, 2);
        EXPECT_EQ(all, (std::vector<float>{0, 10, 1, 11, 2, 12, 20, 30, 21, 31, 22, 32}));
    });
}

TEST(Ranks, PartsOfABatchAreItsOwnOrder) {
    const std::vector<int> batch{1, 2, 3, 4, 5, 6};
    EXPECT_EQ(partOf(nullptr, batch).size(), 6u);
    ThreadRanks::run(3, [&](Ranks& ranks) {
        const std::span<const int> mine = partOf(&ranks, batch);
        EXPECT_EQ(std::vector<int>(mine.begin(), mine.end()),
                  (std::vector<int>{2 * ranks.rank() + 1, 2 * ranks.rank() + 2}));
    });
}

// A network of two layers with batch normalisation and dropout on x [N,C,S,S], three of its steps.
struct Small {
    static constexpr int64_t kImages = 4, kChannels = 3;
    int64_t side;
    Parameters net, statistics;
    Graph graph;
    Tensor x, y;

    Small(Device& device, Ranks* ranks, int64_t side_) : side(side_), graph(device) {
        auto add = [&](const char* name, Shape shape, uint32_t seed) {
            const auto count = static_cast<size_t>(elementCount(shape));
            net.add(name, std::move(shape), noise(count, seed));
        };
        add("first", {8, kChannels, 4, 4}, 1);
        add("scale", {8}, 2);
        add("shift", {8}, 3);
        add("second", {2, 8, 4, 4}, 4);
        net.allocate(device);
        statistics.add("mean", {8}, std::vector<float>(8));
        statistics.add("variance", {8}, std::vector<float>(8, 1));
        statistics.allocate(device);
        auto running = [&](const char* name) {
            return graph.attach(statistics.view(*statistics.find(name), Parameters::kValues), {8});
        };
        auto parameter = [&](const char* name) { return graph.parameter(net, name); };
        graph.join(ranks);
        x = graph.input({kImages / sizeOf(ranks), kChannels, side, side});
        Tensor h = conv2d(graph, x, parameter("first"), {}, 2, 1);
        h = batchNorm2d(graph, h, parameter("scale"), parameter("shift"), {.slope = .2f},
                        {running("mean"), running("variance")});
        h = dropout(graph, h, .25f, 5);
        y = conv2d(graph, h, parameter("second"), {}, 2, 1);
        // Of the mean of the squares.
        graph.backward({{y, scaleShift(graph, y, 2 / static_cast<float>(y.elements()), 0)}});
        adamwStep(graph, net);
        graph.output(y);
        graph.compile({.poison = true});
    }

    std::vector<float> values() const {
        std::vector<float> all;
        for (const Parameters* each : {&net, &statistics})
            for (const Parameters::Entry& entry : each->entries())
                std::ranges::copy(each->read(entry), std::back_inserter(all));
        return all;
    }

    void steps(Ranks* ranks) {
        const auto pictures = noise(static_cast<size_t>(kImages * kChannels * side * side), 9);
        for (uint32_t i = 1; i <= 3; ++i) {
            const std::span<const float> mine = partOf(ranks, pictures);
            graph.write(x, mine);
            StepParams params = adamwStepParams(i, .01f, {});
            params.seed = 3;
            graph.setStep(params);
            graph.submit();
        }
        graph.wait();
    }
};

double farthest(const std::vector<float>& a, const std::vector<float>& b) {
    EXPECT_EQ(a.size(), b.size());
    double most = 0;
    for (size_t i = 0; i < std::min(a.size(), b.size()); ++i)
        most = std::max(most, std::abs(static_cast<double>(a[i] - b[i])));
    return most;
}

// Sums of blocks, of strides and of whole channels, by the picture's size.
TEST(Ranks, ASplitBatchIsNormalisedDroppedAndLearntFromAsAWhole) {
    for (int64_t side : {12, 64, 256}) {
        Small whole(testDevice(), nullptr, side);
        const std::vector<float> before = whole.values();
        whole.steps(nullptr);
        const std::vector<float> expected = whole.values();
        ASSERT_GT(farthest(before, expected), .02) << "three steps move it";
        for (int count : {2, 4}) {
            std::vector<std::vector<float>> found(static_cast<size_t>(count)), outputs(found);
            ThreadRanks::run(count, [&](Ranks& ranks, Device& device) {
                Small part(device, &ranks, side);
                part.steps(&ranks);
                found[static_cast<size_t>(ranks.rank())] = part.values();
                outputs[static_cast<size_t>(ranks.rank())] = part.graph.read(part.y);
            });
            EXPECT_LT(farthest(found[0], expected), 2e-5) << side << " of " << count;
            for (const auto& one : found) EXPECT_EQ(one, found[0]);
            std::vector<float> all;
            for (const auto& one : outputs) all.insert(all.end(), one.begin(), one.end());
            EXPECT_LT(farthest(all, whole.graph.read(whole.y)), 2e-4);
        }
    }
}

// Without the others' sums the same network learns something else: what the test above sees.
TEST(Ranks, PartsThatDoNotShareLearnOtherThings) {
    Small whole(testDevice(), nullptr, 12);
    whole.steps(nullptr);
    std::vector<float> alone;
    ThreadRanks::run(2, [&](Ranks& ranks, Device& device) {
        Small part(device, &ranks, 12);
        ranks.barrier();
        if (ranks.rank() == 0) alone = part.values();
    });
    EXPECT_GT(farthest(alone, whole.values()), .01);
}

// ---- a whole training ---------------------------------------------------------------------------

Preset sharedPreset() {
    Preset preset = tinyPreset();
    preset.fit.passes = 2;
    preset.fit.batch = 4;
    preset.shape.steps = preset.texels.steps = 4;
    preset.shape.batch = preset.texels.batch = 4;
    preset.texels.fine = .5;
    preset.mesh.steps = preset.texture.steps = preset.refine.steps = 3;
    preset.mesh.batch = preset.texture.batch = preset.refine.batch = 4;
    preset.texture.constantInput = false;
    preset.texture.dropout = preset.refine.dropout = .5;
    return preset;
}

// In `out`, on top of what is there.
void train(Device& device, const fs::path& capture, const fs::path& out, Ranks* ranks,
           const std::vector<std::string>& stages,
           const std::function<void(TrainSettings&)>& change = {},
           const Preset& preset = sharedPreset()) {
    Avatar avatar;
    if (fs::exists(out / "avatar.toml")) {
        avatar = readAvatar(out);
    } else {
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
    }
    avatar.preset = preset;
    TrainSettings settings;
    settings.stages = stages;
    settings.out = out;
    settings.pictureSeconds = 0;
    settings.ranks = ranks;
    if (change) change(settings);
    trainAvatar(device, std::move(avatar), readCapture(capture), settings);
}

class SharedTraining : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<Folder>();
        tinyCapture(capture());
        train(testDevice(), capture(), *folder_ / "base", nullptr, stageNames());
    }
    static void TearDownTestSuite() { folder_.reset(); }
    static fs::path capture() { return *folder_ / "capture"; }
    static fs::path copyOfBase(const std::string& name) {
        fs::copy(*folder_ / "base", *folder_ / name, fs::copy_options::recursive);
        return *folder_ / name;
    }

    // Stops a training after so many steps of a stage; what its checkpoint holds.
    static WeightMap stoppedAfter(int64_t steps, const std::string& stage, int count,
                                  const fs::path& out, const Preset& preset = sharedPreset()) {
        catchInterrupts();
        std::atomic<int> stopped = 0;
        ThreadRanks::run(count, [&](Ranks& ranks, Device& device) {
            try {
                train(
                    device, capture(), out, count > 1 ? &ranks : nullptr, {stage},
                    [&](TrainSettings& settings) {
                        settings.afterStep = [&](const std::string&, int64_t done) {
                            if (done == steps && ranks.rank() == count - 1) raise(SIGINT);
                        };
                    },
                    preset);
            } catch (const Interrupted& stop) {
                ++stopped;
                EXPECT_EQ(stop.kept.empty(), ranks.rank() != 0) << "rank 0 alone keeps";
            }
        });
        EXPECT_EQ(stopped, count) << "whoever is told to stop, all do";
        catchInterrupts();
        signal(SIGINT, SIG_DFL);
        return readSafetensors(out / "checkpoints" / (stage + ".safetensors")).tensors;
    }

    static std::unique_ptr<Folder> folder_;
};
std::unique_ptr<Folder> SharedTraining::folder_;

// The first moments of parameters are means of their gradients: of two steps, for the second is
// under way when the first is reported.
TEST_F(SharedTraining, GradientsOfASplitBatchAreTheWholeBatchs) {
    // Networks hardly move, for Adam's first step has the sign of each gradient, whatever its size:
    // where that is a rounding it would lead the second step's gradients apart.
    Preset preset = sharedPreset();
    preset.mesh.lr = preset.texture.lr = preset.refine.lr = preset.refine.lrDiscriminator = 1e-9;
    for (const std::string& stage : stageNames()) {
        if (stage == "caps") continue;  // which has no gradients
        auto first = [&](int count) {
            return stoppedAfter(1, stage, count, copyOfBase(fmt::format("{}{}", stage, count)),
                                preset);
        };
        const WeightMap whole = first(1);
        for (int count : {2, 4}) {
            const WeightMap shared = first(count);
            double square = 0, all = 0;
            std::string apart;  // whose gradients are
            for (const auto& [name, tensor] : whole) {
                if (name.find("moment1") == std::string::npos) continue;
                const std::vector<float>& found = shared.at(name).values;
                double ofThis = 0, allOfThis = 0;
                for (size_t i = 0; i < tensor.values.size(); ++i) {
                    ofThis += std::pow(static_cast<double>(found[i] - tensor.values[i]), 2);
                    allOfThis += std::pow(static_cast<double>(tensor.values[i]), 2);
                }
                if (ofThis > 1e-6 * allOfThis)
                    apart += fmt::format(", {} {:.1e}", name, std::sqrt(ofThis / allOfThis));
                square += ofThis, all += allOfThis;
            }
            ASSERT_GT(all, 0) << stage;
            fmt::print("{} of {}: gradients {:.1e} apart\n", stage, count, std::sqrt(square / all));
            // Roundings, and pixels whose difference has another sign for them.
            EXPECT_LT(std::sqrt(square / all), 1e-4) << stage << " of " << count << apart;
        }
    }
}

// One process, two, and four that go on with what two left.
TEST_F(SharedTraining, AllRanksEndWithTheSameAvatarAndOthersGoOn) {
    stoppedAfter(2, "mesh", 2, copyOfBase("left"));
    fs::copy(*folder_ / "left", *folder_ / "left4", fs::copy_options::recursive);
    for (const auto& [name, count] : {std::pair{"left", 1}, {"left4", 4}}) {
        const fs::path out = *folder_ / name;
        ThreadRanks::run(count, [&](Ranks& ranks, Device& device) {
            train(device, capture(), out, count > 1 ? &ranks : nullptr, {"mesh"},
                  [](TrainSettings& settings) { settings.resume = true; });
        });
        EXPECT_FALSE(fs::exists(out / "checkpoints"));
        const std::string curve = bytesOf(out / "log/losses_mesh.csv");
        EXPECT_EQ(std::ranges::count(curve, '\n'), 4) << "one curve: " << curve;
    }
    const WeightMap one = readAvatar(*folder_ / "left").meshNet,
                    four = readAvatar(*folder_ / "left4").meshNet;
    for (const auto& [name, tensor] : one)
        EXPECT_LT(farthest(tensor.values, four.at(name).values), 2e-3) << "a step's length";
    // The same number of ranks, the same bits.
    std::vector<std::string> bits;
    for (const char* name : {"again", "andAgain"}) {
        const fs::path out = *folder_ / name;
        ThreadRanks::run(2, [&](Ranks& ranks, Device& device) {
            train(device, capture(), out, &ranks, stageNames());
        });
        EXPECT_TRUE(fs::exists(out / "preview.png"));
        std::string all;
        for (const char* file :
             {"body.npz", "texels.png", "mesh_net.safetensors", "texture_net.safetensors",
              "refine_net.safetensors", "texture_baked.png", "log/losses_refine.csv"})
            all += bytesOf(out / file);
        EXPECT_GT(all.size(), 10000u);
        bits.push_back(all);
    }
    EXPECT_EQ(bits[0], bits[1]);
}

}  // namespace
}  // namespace doppel::test
