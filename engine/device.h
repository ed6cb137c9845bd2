// One Vulkan device with one compute queue: memory, kernels, submission.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/buffer.h"
#include "engine/cooperative_matrix.h"
#include "engine/kernel.h"
#include "engine/vulkan.h"

namespace doppel {

// How shaders reach buffers; see shaders/common/op.glsl.
enum class Binding { Addresses, Descriptors };

// How products of matrices are made (convolutions, linear layers, graph convolutions). Mixed: their
// inputs are rounded to halves, and summed in single precision, on matrix units where a GPU has
// them (CPUs emulate them slowly: with DOPPEL_MATRIX_UNITS=emulated alone). All else, parameters
// and optimisers among it, is in single precision always.
enum class Precision { Single, Mixed };
// Of "fp32" and "mixed", as programs take it from their command lines; InputError on anything else.
Precision precisionNamed(std::string_view name);
const char* precisionName(Precision precision);

struct DeviceOptions {
    std::string name;  // part of a device's name, or its index in the list; empty: the best one
    // Unset: addresses where the device has them; DOPPEL_BINDING=descriptors asks for the other.
    std::optional<Binding> binding;
    Precision precision = Precision::Single;
    // Validation layer with synchronisation validation; a message is kept and fails tests.
    // DOPPEL_VALIDATION=1 switches it on.
    bool validation = false;
};

// Which builds, specialisations and workgroup sizes of kernels a device takes. This is the one
// place that says it, from what the device is, the binding, and the environment: DOPPEL_KERNELS=gpu
// gives a CPU exactly what a discrete GPU gets, so that those kernels are tested where there is no
// GPU.
struct KernelPath {
    // The builds for CPUs: lanes of a subgroup are a CPU's vector, so that loads in loops are
    // gathers, pairs of floats are loaded as integers of 64 bits, and a workgroup costs
    // microseconds. Without it the builds for GPUs run, which need no integers of 64 bits but for
    // int64Atomics.
    bool onCpu = false;
    // Kernels may read buffers as texels, from any 16 bytes on, beside addresses (TEXELS in
    // shaders/common/op.glsl): a CPU's fast loads.
    bool texels = false;
    // Lanes of the vector, where the kernels for one vector per workgroup run; 0: they do not.
    uint32_t vectorLanes = 0;
    bool int64 = false;         // integers of 64 bits in shaders
    bool int64Atomics = false;  // and atomics of them in buffers
};

// What `doppel devices` shows.
struct DeviceInfo {
    uint32_t index = 0;
    std::string name, type, driver, apiVersion;
    uint64_t memoryBytes = 0;  // of the largest device-local heap
    uint64_t maxAllocationBytes = 0;
    uint64_t maxStorageBufferBytes = 0;  // per descriptor
    uint32_t maxPushConstantBytes = 0;
    uint32_t subgroupSize = 0;
    bool addresses = false, timestamps = false;
    std::optional<MatrixShape> halfMatrices;  // what a subgroup multiplies at once
    bool cpu = false;             // kernels may take another path all the same, see below
    uint64_t maxTexels = 0;       // of 16 bytes, per descriptor
    uint64_t texelAlignment = 0;  // bytes, of the beginning of a buffer that is read as texels
    bool int64 = false;           // integers of 64 bits in shaders
    bool int64Atomics = false;    // and atomics of them in buffers
    KernelPath kernelPath;        // with the binding that the device is used with
    std::vector<std::string> refusals;  // why it cannot be used; empty: it can
    int score = 0;                      // the best usable device has the highest
};

class Device {
public:
    // Throws MachineError naming every device and every reason where none fits.
    explicit Device(DeviceOptions options = {});
    ~Device();
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;

    static std::vector<DeviceInfo> list();

    const DeviceInfo& info() const { return info_; }
    const KernelPath& kernelPath() const { return info_.kernelPath; }
    Binding binding() const { return binding_; }
    Precision precision() const { return precision_; }
    // The shape of products on matrix units, where precision and binding are those that use them.
    std::optional<MatrixShape> matrixUnits() const { return matrixUnits_; }
    VkDevice handle() const { return device_; }
    double timestampPeriodNanoseconds() const { return timestampPeriod_; }

    // A buffer of its own; throws MachineError with the size when memory runs out.
    Buffer allocate(uint64_t bytes, Memory memory);

    // The kernel "<family>/<op>.<entry>" with these specialisation constants (by name). Compiled
    // at first use and kept.
    const Kernel& kernel(std::string_view name, const Specialisation& specialisation = {});

    // Copies between host memory and any buffer, and waits.
    void upload(const BufferView& target, std::span<const std::byte> bytes);
    void download(const BufferView& source, std::span<std::byte> bytes);

    VkCommandBuffer newCommandBuffer();
    void freeCommandBuffer(VkCommandBuffer commands);
    VkFence newFence();
    void submit(VkCommandBuffer commands, VkFence fence);
    void wait(VkFence fence);
    // Records transfers with the given function, submits, waits.
    void runOnce(const std::function<void(VkCommandBuffer)>& record);

    // Validation messages since the start; tests fail when there is one.
    static std::vector<std::string> validationMessages();

private:
    void destroy();
    uint32_t memoryType(uint32_t allowed, Memory memory) const;

    VkInstance instance_ = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
    VkPhysicalDevice physical_ = VK_NULL_HANDLE;
    VkDevice device_ = VK_NULL_HANDLE;
    VkQueue queue_ = VK_NULL_HANDLE;
    VkCommandPool pool_ = VK_NULL_HANDLE;
    VkPipelineCache pipelineCache_ = VK_NULL_HANDLE;
    VkPhysicalDeviceMemoryProperties memory_{};
    DeviceInfo info_;
    Binding binding_ = Binding::Addresses;
    Precision precision_ = Precision::Single;
    std::optional<MatrixShape> matrixUnits_;
    double timestampPeriod_ = 1;
    std::map<std::pair<std::string, Specialisation>, std::unique_ptr<Kernel>, std::less<>> kernels_;
};

}  // namespace doppel
