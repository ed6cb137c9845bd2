// What a Vulkan device says of itself, and which kernels it takes.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/cooperative_matrix.h"
#include "engine/vulkan.h"

namespace doppel {

// How shaders reach buffers; see shaders/common/op.glsl.
enum class Binding { Addresses, Descriptors };

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
    // Kernels may read buffers as texels, from any 16 bytes on, beside addresses: a CPU's fast
    // loads.
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
    uint32_t vendor = 0;  // PCI's number: 0x10de NVIDIA, 0x1002 AMD
    std::array<uint8_t, VK_UUID_SIZE> uuid{};
    uint64_t busAddress = 0;   // PCI's domain, bus, device and function, in that order; 0: unknown
    uint32_t api = 0;          // the version as Vulkan packs it
    uint64_t memoryBytes = 0;  // of the largest heap that kernels work in
    uint64_t maxAllocationBytes = 0;
    uint32_t maxAllocations = 0;
    bool hostSeesMemory = false;         // there is memory that is fast for kernels and mapped
    uint64_t maxStorageBufferBytes = 0;  // per descriptor
    uint64_t storageAlignment = 0;       // bytes, of the offset in a descriptor
    uint32_t maxStorageBuffers = 0;      // descriptors of a kernel
    uint64_t maxTexels = 0;              // of 16 bytes, per descriptor
    uint64_t texelAlignment = 0;  // bytes, of the beginning of a buffer that is read as texels
    uint32_t maxPushConstantBytes = 0;
    uint32_t maxSharedBytes = 0;  // of a workgroup
    uint32_t maxWorkgroupInvocations = 0;
    std::array<uint32_t, 3> maxWorkgroupSize{}, maxWorkgroups{};
    uint32_t subgroupSize = 0;
    VkSubgroupFeatureFlags subgroupOperations = 0;
    bool addresses = false, timestamps = false;
    bool scalarLayout = false;                // members of blocks lie as GLSL's `scalar` says
    std::optional<MatrixShape> halfMatrices;  // what a subgroup multiplies at once
    bool cpu = false;                         // its kernels are what kernelPath says
    bool int64 = false;                       // integers of 64 bits in shaders
    bool int64Atomics = false;                // and atomics of them in buffers
    KernelPath kernelPath;                    // with the binding that the device is used with
    std::vector<std::string> refusals;        // why it cannot be used; empty: it can
    int score = 0;                            // the best usable device has the highest
};

// limits: a file of another device's facts, or empty. Each of them makes the description less,
// never more, so that what runs under the file obeys the other device's limits: one KEY = VALUE a
// line, with Vulkan's names (tests/devices has some). InputError, naming file and line, on anything
// else.
DeviceInfo describeDevice(VkInstance instance, VkPhysicalDevice physical, uint32_t index,
                          const std::filesystem::path& limits);

KernelPath kernelPathOf(const DeviceInfo& info, Binding binding);

std::optional<uint32_t> computeQueueFamily(VkPhysicalDevice physical);

}  // namespace doppel
