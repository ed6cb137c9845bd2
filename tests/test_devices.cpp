// Which kernels a device takes, and the engine under the limits of other devices (tests/devices).
#include <algorithm>
#include <cstdlib>
#include <map>
#include <numeric>

#include "common/pairs.h"
#include "elementwise/params.h"
#include "engine/device_match.h"
#include "engine/kernel.h"
#include "engine/shader_table.h"
#include "nn/core/graph.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/linalg.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/session.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

fs::path limitsFolder() { return test::sourceFolder() / "tests" / "devices"; }

struct Expected {
    const char* file;
    const char* refusal;  // words of the reason; empty: it computes
};
constexpr Expected kDevices[] = {
    {"nvidia_desktop", ""},
    {"amd_rdna", ""},
    {"intel_arc", ""},
    {"intel_uhd", ""},
    {"apple_m1", ""},
    {"adreno", ""},
    {"mali", ""},
    {"swiftshader", ""},
    {"weakest", ""},
    {"mali_small", "Vulkan 1.1.0 is older than 1.2"},
    {"raspberry_pi", "no scalarBlockLayout"},
};

void expectMachineError(const std::function<void()>& run, const std::string& words) {
    try {
        run();
        ADD_FAILURE() << "no error; expected one with: " << words;
    } catch (const MachineError& error) {
        EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
}

// A device under one line of limits.
std::unique_ptr<Device> limitedBy(const test::Folder& folder, const std::string& text) {
    folder.write("limits.txt", text);
    return std::make_unique<Device>(DeviceOptions{.limits = folder / "limits.txt"});
}

class EnvironmentVariable {
public:
    EnvironmentVariable(const char* name, const char* value) : name_(name) {
        if (const char* set = std::getenv(name)) before_ = set;
        setenv(name, value, 1);
    }
    ~EnvironmentVariable() {
        if (before_)
            setenv(name_, before_->c_str(), 1);
        else
            unsetenv(name_);
    }

private:
    const char* name_;
    std::optional<std::string> before_;
};

// ---- what a device takes ------------------------------------------------------------------------

TEST(KernelPath, AGpusKernelsOnRequest) {
    EnvironmentVariable asked("DOPPEL_KERNELS", "gpu");
    Device device;
    const KernelPath& path = device.kernelPath();
    EXPECT_FALSE(path.onCpu || path.texels);
    EXPECT_EQ(path.vectorLanes, 0u);
    EnvironmentVariable wrong("DOPPEL_KERNELS", "fast");
    expectInputError([] { Device other; }, "DOPPEL_KERNELS: expected gpu");
}

// Slurm, and people, leave GPUs to others by these variables.
TEST(DeviceMatch, GpusThatAreLeftToOthersAreRefused) {
    constexpr uint32_t kNvidia = 0x10de, kAmd = 0x1002;
    // As Vulkan lists them, which is not in the bus' order.
    std::vector<DeviceInfo> all(5);
    for (size_t i = 0; i < all.size(); ++i) all[i].index = static_cast<uint32_t>(i);
    all[0].vendor = all[1].vendor = all[2].vendor = kNvidia;
    all[0].busAddress = 30, all[1].busAddress = 10, all[2].busAddress = 20;
    all[1].uuid = {0x12, 0x34, 0xab, 0xcd, 0x55, 0x66, 0x77, 0x88, 1, 2, 3, 4, 5, 6, 7, 8};
    all[3].vendor = kAmd;
    all[4].cpu = true;
    const auto usable = [&](const std::map<std::string, std::string>& variables) {
        std::vector<DeviceInfo> devices = all;
        leaveToOthers(devices, [&](const char* name) -> const char* {
            const auto found = variables.find(name);
            return found == variables.end() ? nullptr : found->second.c_str();
        });
        std::vector<uint32_t> left;
        for (const DeviceInfo& info : devices) {
            if (info.refusals.empty()) left.push_back(info.index);
            for (const std::string& reason : info.refusals)
                EXPECT_EQ(reason.substr(0, 19), "left to others by C") << reason;
        }
        return left;
    };
    using Devices = std::vector<uint32_t>;
    const Devices every{0, 1, 2, 3, 4};
    EXPECT_EQ(usable({}), every);
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "0"}}), (Devices{1, 3, 4}))
        << "the first on the bus";
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "2,1"}}), (Devices{0, 2, 3, 4}));
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "2, 1"}}), (Devices{0, 2, 3, 4}));
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "0,-1,1"}}), (Devices{1, 3, 4}));
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "GPU-1234abcd-5566-7788-0102-030405060708"}}),
              (Devices{1, 3, 4}));
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "GPU-1234ab"}}), (Devices{1, 3, 4}));
    EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", "NoDevFiles"}}), (Devices{3, 4}));
    for (const char* says : {"", "-1", "7", "GPU-", "MIG-1234", "all", ",,"})
        EXPECT_EQ(usable({{"CUDA_VISIBLE_DEVICES", says}}), every) << says;
    EXPECT_EQ(usable({{"ROCR_VISIBLE_DEVICES", "0"}}), every);
}

TEST(KernelPath, FollowsFromWhatTheDeviceIs) {
    EnvironmentVariable none("DOPPEL_KERNELS", "");
    DeviceInfo info;
    info.int64 = info.int64Atomics = info.addresses = true;
    info.subgroupSize = 8;
    info.texelAlignment = 16;
    KernelPath path = kernelPathOf(info, Binding::Addresses);
    EXPECT_FALSE(path.onCpu || path.texels || path.vectorLanes);
    EXPECT_TRUE(path.int64Atomics);
    info.cpu = true;
    path = kernelPathOf(info, Binding::Addresses);
    EXPECT_TRUE(path.onCpu && path.texels);
    EXPECT_EQ(path.vectorLanes, 8u);
    path = kernelPathOf(info, Binding::Descriptors);
    EXPECT_TRUE(path.onCpu);
    EXPECT_FALSE(path.texels || path.vectorLanes || path.int64Atomics);
    info.texelAlignment = 256;
    EXPECT_FALSE(kernelPathOf(info, Binding::Addresses).texels);
    info.int64 = false;
    path = kernelPathOf(info, Binding::Addresses);
    EXPECT_FALSE(path.onCpu || path.int64Atomics) << "the builds for CPUs load pairs as integers";
}

// ---- limits -------------------------------------------------------------------------------------

TEST(Limits, FilesAreReadToTheLetter) {
    test::Folder folder;
    expectInputError([&] { limitedBy(folder, "# one\nmaxPushConstants = 1\n"); },
                     "line 2: maxPushConstants: there is no such limit");
    expectInputError([&] { limitedBy(folder, "subgroupSize 3\n"); },
                     "line 1: expected KEY = VALUE");
    expectInputError([&] { limitedBy(folder, "subgroupSize = three\n"); },
                     "subgroupSize: expected a whole number, found three");
    expectInputError([&] { limitedBy(folder, "maxComputeWorkGroupCount = 1 2\n"); },
                     "expected three whole numbers");
    expectInputError([&] { limitedBy(folder, "shaderInt64 = 1\n"); }, "expected yes or no");
    expectInputError([&] { Device device({.limits = folder / "none.txt"}); }, "cannot read it");
    // Limits are never more than the device's own.
    const auto device = limitedBy(folder, "maxComputeWorkGroupInvocations = 4000000000\n");
    EXPECT_EQ(device->info().maxWorkgroupInvocations, Device().info().maxWorkgroupInvocations);
}

TEST(Limits, OfMemory) {
    test::Folder folder;
    auto device = limitedBy(folder, "maxMemoryAllocationSize = 1048576\n");
    device->allocate(1 << 20, Memory::Device);
    expectMachineError([&] { device->allocate((1 << 20) + 1, Memory::Device); },
                       "(1048576 at once at most)");
    device = limitedBy(folder, "maxMemoryAllocationCount = 2\n");
    {
        Buffer one = device->allocate(16, Memory::Device),
               two = device->allocate(16, Memory::Upload);
        expectMachineError([&] { device->allocate(16, Memory::Device); }, "2 allocations");
    }
    device->allocate(16, Memory::Device);  // they are free again
    device = limitedBy(folder, "deviceHeapSize = 1048576\n");
    Buffer most = device->allocate(1 << 19, Memory::Device);
    device->allocate(1 << 20, Memory::Upload);
    expectMachineError([&] { device->allocate((1 << 19) + 1, Memory::Device); }, "are in use");
}

TEST(Limits, OfWorkgroups) {
    test::Folder folder;
    auto device = limitedBy(folder, "maxComputeWorkGroupCount = 65535 65535 2\n");
    Graph graph(*device);
    graph.beginOp("scales");
    Tensor x = graph.input({64}), y = graph.temporary({64});
    graph.output(y);
    struct {
        uint32_t n = 64;
        float slope = 1;
    } params;
    graph.dispatchGroups("elementwise/leaky_relu.forward", {{"x", x}, {"y", y}}, params, {1, 1, 3});
    expectMachineError([&] { graph.compile(); }, "needs 1 x 1 x 3 workgroups");
    const auto small = limitedBy(folder, "maxComputeWorkGroupInvocations = 256\n");
    expectMachineError(
        [&] {
            small->kernel("elementwise/leaky_relu.forward", {{"local_size", 512}});
        },
        "needs 512 invocations in a workgroup");
}

// Sums of a workgroup are made in its memory, two numbers per invocation.
TEST(Limits, OfSharedMemory) {
    auto row = std::ranges::find(shaderTable(), std::string_view("loss/silhouette_iou_loss.finish"),
                                 &ShaderTableRow::name);
    ASSERT_NE(row, shaderTable().end());
    EXPECT_EQ(sharedBytes(row->addresses, {}), 64u * 8);
    EXPECT_EQ(sharedBytes(row->descriptors, {{"local_size", 256}}), 256u * 8);
    auto none = std::ranges::find(shaderTable(), std::string_view("elementwise/add.forward"),
                                  &ShaderTableRow::name);
    EXPECT_EQ(sharedBytes(none->addresses, {}), 0u);
    test::Folder folder;
    const auto device = limitedBy(folder, "maxComputeSharedMemorySize = 1024\n");
    expectMachineError(
        [&] {
            device->kernel(std::string(row->name) + "@plain", {{"local_size", 256}});
        },
        "needs 2048 bytes of shared memory");
}

// Memory that the host does not see is reached by copies.
TEST(Limits, OfMappedMemory) {
    test::Folder folder;
    const auto device = limitedBy(folder, "hostVisibleDeviceMemory = no\n");
    Buffer buffer = device->allocate(1000, Memory::Device);
    EXPECT_EQ(buffer.mapped(), nullptr);
    std::vector<float> values(250), back(100);
    std::iota(values.begin(), values.end(), 0.0f);
    device->upload({&buffer, 0, 1000}, std::as_bytes(std::span(values)));
    device->download({&buffer, 200, 400}, std::as_writable_bytes(std::span(back)));
    for (size_t i = 0; i < back.size(); ++i) EXPECT_EQ(back[i], values[50 + i]);
}

// Slices begin at any 16 bytes, which not every device's descriptors can.
TEST(Limits, OfDescriptorsOffsets) {
    test::Folder folder;
    const auto device =
        limitedBy(folder, "bufferDeviceAddress = no\nminStorageBufferOffsetAlignment = 256\n");
    ASSERT_EQ(device->binding(), Binding::Descriptors);
    Graph graph(*device);
    Tensor x = graph.input({40}), target = graph.temporary({40});
    Tensor y = leakyRelu(graph, x.slice(4, 8), 0.5f);
    graph.fill(target);
    graph.copy(y, target.slice(12, 8));
    auto addInto = [&](const Tensor& total, const Tensor& more) {
        graph.dispatch("elementwise/add.into", {{"total", total}, {"more", more}}, ElementParams{8},
                       pairInvocations(8));
    };
    addInto(target.slice(12, 8), y);
    addInto(target.slice(20, 8), x.slice(32, 8));
    graph.output(target);
    graph.compile();
    std::vector<float> values(40), expected(40);
    for (size_t i = 0; i < 40; ++i) values[i] = static_cast<float>(i);
    for (size_t i = 0; i < 8; ++i) {
        expected[12 + i] = 2 * values[4 + i];
        expected[20 + i] = values[32 + i];
    }
    graph.write(x, values);
    for (int i = 0; i < 2; ++i) graph.run();
    EXPECT_EQ(graph.read<float>(target), expected);
}

// However finely a recording is cut, it computes the same bits.
TEST(Submissions, AreCutByTheWorkInThem) {
    EnvironmentVariable gpu("DOPPEL_KERNELS", "gpu");
    auto run = [&](double seconds, size_t* submissions) {
        Device device({.secondsPerSubmit = seconds});
        Graph graph(device);
        Tensor a = graph.variable({3, 70, 40}), b = graph.variable({3, 40, 90});
        Tensor y = leakyRelu(graph, matmul(graph, a, b), 0.2f);
        Tensor dy = graph.input(y.shape);
        graph.backward({{y, dy}});
        const std::vector<Tensor> outputs{y, graph.gradient(a), graph.gradient(b)};
        for (const Tensor& tensor : outputs) graph.output(tensor);
        graph.compile();
        auto write = [&](const Tensor& tensor, uint32_t seed) {
            const std::vector<double> values = random(tensor.shape, seed).data;
            graph.write(tensor, std::vector<float>(values.begin(), values.end()));
        };
        write(a, 1);
        write(b, 2);
        write(dy, 3);
        for (int i = 0; i < 2; ++i) graph.run();
        *submissions = graph.submissionCount();
        std::vector<std::vector<float>> results;
        for (const Tensor& tensor : outputs) results.push_back(graph.read<float>(tensor));
        return results;
    };
    size_t whole = 0, cut = 0, fine = 0;
    const auto expected = run(1, &whole);
    EXPECT_EQ(whole, 1u);
    EXPECT_EQ(run(4e-6, &cut), expected);
    EXPECT_GT(cut, 3u);
    EXPECT_EQ(run(1e-7, &fine), expected) << "dispatches are cut as well";
    EXPECT_GT(fine, cut + 10);
}

// GPUs without 64-bit integers run every kernel but one, in whose place others run; and operations
// of subgroups are a CPU's.
TEST(Kernels, OfGpusNeedNothingSpecial) {
    constexpr uint32_t kInt64 = 11, kInt64Atomics = 12, kVote = 62, kQuad = 68;
    for (const ShaderTableRow& row : shaderTable()) {
        const std::string_view name = row.name;
        // Batch normalisation by one subgroup per channel is a CPU's in both of its forms.
        if (name.ends_with("@cpu") || name.starts_with("conv/batch_norm_channel.")) continue;
        for (SpirvRange module : {row.addresses, row.descriptors})
            for (uint32_t capability : reflect(module).capabilities) {
                const bool wide = capability == kInt64 || capability == kInt64Atomics;
                EXPECT_TRUE(!wide || name.ends_with("@keys")) << name;
                EXPECT_FALSE(capability >= kVote && capability <= kQuad)
                    << name << " has capability " << capability;
            }
    }
}

// ---- training under the limits of other devices
// --------------------------------------------------

Preset fewSteps() {
    Preset preset = presetByName("ci");
    preset.fit.size = 64;
    preset.fit.passes = 2;
    preset.shape.size = preset.texels.size = 64;
    preset.shape.steps = preset.texels.steps = 3;
    preset.mesh.size = 64;
    preset.mesh.blocks = 1;
    preset.mesh.layers = 2;
    preset.mesh.hidden = 16;
    preset.mesh.steps = 3;
    preset.texture.size = 64;
    preset.texture.textureSize = 64;
    preset.texture.block = 1;
    preset.texture.depth = 6;
    preset.texture.width = 4;
    preset.texture.steps = 4;
    preset.refine.size = 64;
    preset.refine.depth = 6;
    preset.refine.width = 4;
    preset.refine.discriminatorWidth = 2;
    preset.refine.faceSize = 16;
    preset.refine.steps = 3;
    return preset;
}

struct Trained {
    double iou = 0, psnr = 0;
};
Trained train(Device& device, const Capture& capture, const fs::path& out) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = fewSteps();
    TrainSettings settings;
    settings.out = out;
    settings.stages = stageNames();
    settings.pictureSeconds = 0;
    const TrainResult result = trainAvatar(device, std::move(avatar), capture, settings);
    const FrameMetrics mean = meanMetrics(evaluateAvatar(device, result.avatar, result.capture));
    return {mean.iou, mean.psnrBody};
}

class Training : public testing::TestWithParam<Expected> {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<test::Folder>();
        Actor actor = readActor(assetFolder() / "actor", "woman");
        SyntheticOptions options;
        options.size = 64;
        options.samples = 2;
        capture_ = renderActor(testDevice(), actor, actorSession(3, 0, kActorDistance),
                               *folder_ / "capture", options);
        plain_ = train(testDevice(), capture_, *folder_ / "plain");
    }
    static void TearDownTestSuite() { folder_.reset(); }

    static std::unique_ptr<test::Folder> folder_;
    static Capture capture_;
    static Trained plain_;
};
std::unique_ptr<test::Folder> Training::folder_;
Capture Training::capture_;
Trained Training::plain_;

TEST_P(Training, RunsOrIsRefused) {
    const fs::path limits = limitsFolder() / (std::string(GetParam().file) + ".txt");
    const std::string refusal = GetParam().refusal;
    if (!refusal.empty()) {
        expectMachineError([&] { Device device({.limits = limits}); }, refusal);
        return;
    }
    Device device({.limits = limits});
    EXPECT_FALSE(device.kernelPath().onCpu);
    const Trained trained = train(device, capture_, *folder_ / GetParam().file);
    // The same steps with sums in other orders.
    EXPECT_NEAR(trained.iou, plain_.iou, 0.01);
    EXPECT_NEAR(trained.psnr, plain_.psnr, 0.3);
}

INSTANTIATE_TEST_SUITE_P(Devices, Training, testing::ValuesIn(kDevices),
                         [](const auto& device) { return std::string(device.param.file); });

TEST(Limits, EveryFileIsTrainedUnder) {
    for (const auto& entry : fs::directory_iterator(limitsFolder()))
        EXPECT_TRUE(std::ranges::any_of(kDevices, [&](const Expected& device) {
            return entry.path().stem() == device.file;
        })) << entry.path();
}

}  // namespace
}  // namespace doppel
