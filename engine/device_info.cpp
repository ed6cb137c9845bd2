#include "engine/device_info.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <sstream>
#include <string_view>

#include "engine/instance.h"

namespace doppel {

namespace {

struct TypeName {
    const char* name;
    int score;
};
TypeName typeName(VkPhysicalDeviceType type) {
    switch (type) {
        case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
            return {"discrete GPU", 400};
        case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
            return {"integrated GPU", 300};
        case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
            return {"virtual GPU", 200};
        case VK_PHYSICAL_DEVICE_TYPE_CPU:
            return {"CPU", 100};
        default:
            return {"other", 50};
    }
}

std::string versionText(uint32_t version) {
    return fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version),
                       VK_API_VERSION_PATCH(version));
}

bool gpuKernelsWanted() {
    const char* set = std::getenv("DOPPEL_KERNELS");
    if (!set || !*set) return false;
    if (set != std::string_view("gpu"))
        throwInput(
            "DOPPEL_KERNELS: expected gpu, or nothing for the device's own kernels, found {}", set);
    return true;
}

// ---- files of facts -----------------------------------------------------------------------------

std::string_view trimmed(std::string_view text) {
    const size_t begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
    return begin == std::string_view::npos ? "" : text.substr(begin, end - begin + 1);
}

constexpr std::pair<const char*, VkSubgroupFeatureFlagBits> kSubgroupOperations[] = {
    {"basic", VK_SUBGROUP_FEATURE_BASIC_BIT},
    {"vote", VK_SUBGROUP_FEATURE_VOTE_BIT},
    {"arithmetic", VK_SUBGROUP_FEATURE_ARITHMETIC_BIT},
    {"ballot", VK_SUBGROUP_FEATURE_BALLOT_BIT},
    {"shuffle", VK_SUBGROUP_FEATURE_SHUFFLE_BIT},
    {"shuffleRelative", VK_SUBGROUP_FEATURE_SHUFFLE_RELATIVE_BIT},
    {"clustered", VK_SUBGROUP_FEATURE_CLUSTERED_BIT},
    {"quad", VK_SUBGROUP_FEATURE_QUAD_BIT},
};

// One line of a file.
struct Fact {
    std::string where, key, value;

    [[noreturn]] void expected(std::string_view what) const {
        throwInput("{}: {}: expected {}, found {}", where, key, what, value);
    }
    uint64_t number(std::string_view text) const {
        uint64_t result = 0;
        auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), result);
        if (error != std::errc() || end != text.data() + text.size()) expected("a whole number");
        return result;
    }
    template <typename T>
    void atMost(T& limit) const {
        const uint64_t most = std::numeric_limits<T>::max();
        limit = std::min(limit, static_cast<T>(std::min(most, number(value))));
    }
    void atLeast(uint64_t& limit) const { limit = std::max(limit, number(value)); }
    void only(bool& feature) const {
        if (value != "yes" && value != "no") expected("yes or no");
        feature = feature && value == "yes";
    }
    void atMost(std::array<uint32_t, 3>& limits) const {
        std::istringstream words(value);
        for (uint32_t& limit : limits) {
            std::string word;
            if (!(words >> word)) expected("three whole numbers");
            limit = std::min<uint32_t>(
                limit, static_cast<uint32_t>(std::min<uint64_t>(UINT32_MAX, number(word))));
        }
        if (std::string more; words >> more) expected("three whole numbers");
    }
};

void limitBy(DeviceInfo& info, const Fact& fact) {
    const std::string& key = fact.key;
    if (key == "deviceName") {
        info.name += " as " + fact.value;
    } else if (key == "deviceType") {
        if (fact.value != "discrete" && fact.value != "integrated" && fact.value != "cpu")
            fact.expected("discrete, integrated or cpu");
        const bool discrete = fact.value == "discrete";
        info.cpu = info.cpu && fact.value == "cpu";
        info.type = typeName(discrete                     ? VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU
                             : fact.value == "integrated" ? VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU
                                                          : VK_PHYSICAL_DEVICE_TYPE_CPU)
                        .name;
    } else if (key == "apiVersion") {
        const size_t dot = fact.value.find('.');
        if (dot == std::string::npos) fact.expected("major and minor version, as 1.2");
        const uint64_t major = fact.number(std::string_view(fact.value).substr(0, dot));
        const uint64_t minor = fact.number(std::string_view(fact.value).substr(dot + 1));
        info.api = std::min(info.api, VK_MAKE_API_VERSION(0, static_cast<uint32_t>(major),
                                                          static_cast<uint32_t>(minor), 0));
        info.apiVersion = versionText(info.api);
    } else if (key == "maxPushConstantsSize") {
        fact.atMost(info.maxPushConstantBytes);
    } else if (key == "maxComputeSharedMemorySize") {
        fact.atMost(info.maxSharedBytes);
    } else if (key == "maxComputeWorkGroupInvocations") {
        fact.atMost(info.maxWorkgroupInvocations);
    } else if (key == "maxComputeWorkGroupSize") {
        fact.atMost(info.maxWorkgroupSize);
    } else if (key == "maxComputeWorkGroupCount") {
        fact.atMost(info.maxWorkgroups);
    } else if (key == "maxStorageBufferRange") {
        fact.atMost(info.maxStorageBufferBytes);
    } else if (key == "minStorageBufferOffsetAlignment") {
        fact.atLeast(info.storageAlignment);
    } else if (key == "maxPerStageDescriptorStorageBuffers") {
        fact.atMost(info.maxStorageBuffers);
    } else if (key == "maxTexelBufferElements") {
        fact.atMost(info.maxTexels);
    } else if (key == "minTexelBufferOffsetAlignment") {
        fact.atLeast(info.texelAlignment);
    } else if (key == "maxMemoryAllocationSize") {
        fact.atMost(info.maxAllocationBytes);
    } else if (key == "maxMemoryAllocationCount") {
        fact.atMost(info.maxAllocations);
    } else if (key == "deviceHeapSize") {
        fact.atMost(info.memoryBytes);
    } else if (key == "hostVisibleDeviceMemory") {
        fact.only(info.hostSeesMemory);
    } else if (key == "subgroupSize") {
        // Kernels that are specialised for it run on matrix units and CPUs alone.
        info.subgroupSize = static_cast<uint32_t>(std::min<uint64_t>(128, fact.number(fact.value)));
        info.halfMatrices.reset();
    } else if (key == "subgroupSupportedOperations") {
        VkSubgroupFeatureFlags has = 0;
        std::istringstream words(fact.value);
        for (std::string word; words >> word;) {
            auto found = std::ranges::find(kSubgroupOperations, word,
                                           [](const auto& row) { return row.first; });
            if (found == std::end(kSubgroupOperations)) fact.expected("operations of subgroups");
            has |= static_cast<VkSubgroupFeatureFlags>(found->second);
        }
        info.subgroupOperations &= has;
    } else if (key == "shaderInt64") {
        fact.only(info.int64);
    } else if (key == "shaderBufferInt64Atomics") {
        fact.only(info.int64Atomics);
    } else if (key == "bufferDeviceAddress") {
        fact.only(info.addresses);
    } else if (key == "scalarBlockLayout") {
        fact.only(info.scalarLayout);
    } else if (key == "timestampComputeAndGraphics") {
        fact.only(info.timestamps);
    } else {
        throwInput("{}: {}: there is no such limit; expected one of tests/devices, for instance",
                   fact.where, key);
    }
}

void limitBy(DeviceInfo& info, const std::filesystem::path& path) {
    std::ifstream file(path);
    if (!file)
        throwInput("{}: cannot read it; expected a file of a device's limits", path.string());
    size_t number = 0;
    for (std::string line; std::getline(file, line);) {
        ++number;
        const std::string_view text = trimmed(std::string_view(line).substr(0, line.find('#')));
        if (text.empty()) continue;
        const size_t equals = text.find('=');
        const std::string where = fmt::format("{}: line {}", path.string(), number);
        if (equals == std::string_view::npos)
            throwInput("{}: expected KEY = VALUE, found {}", where, text);
        limitBy(info, {where, std::string(trimmed(text.substr(0, equals))),
                       std::string(trimmed(text.substr(equals + 1)))});
    }
}

// ---- what cannot be done without
// ------------------------------------------------------------------

std::vector<std::string> refusalsOf(const DeviceInfo& info) {
    std::vector<std::string> refusals;
    if (info.api < VK_API_VERSION_1_2)
        refusals.push_back(fmt::format("Vulkan {} is older than 1.2", info.apiVersion));
    if (!info.scalarLayout) refusals.emplace_back("no scalarBlockLayout");
    if (info.maxWorkgroupInvocations < 256)
        refusals.push_back(fmt::format("workgroups of {} invocations at most; 256 are needed",
                                       info.maxWorkgroupInvocations));
    return refusals;
}

}  // namespace

std::optional<uint32_t> computeQueueFamily(VkPhysicalDevice physical) {
    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
    for (uint32_t i = 0; i < count; ++i)
        if (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) return i;
    return std::nullopt;
}

KernelPath kernelPathOf(const DeviceInfo& info, Binding binding) {
    const bool addresses = binding == Binding::Addresses;
    KernelPath path;
    path.onCpu = info.cpu && info.int64 && !gpuKernelsWanted();
    path.int64 = info.int64;
    // In "descriptors" the plain kernels are tested.
    path.int64Atomics = info.int64 && info.int64Atomics && addresses;
    path.texels = path.onCpu && addresses && info.texelAlignment <= 16;
    // One subgroup per workgroup divides the texels of A in a body of a product's loop.
    if (path.texels && 16 % std::max(1u, info.subgroupSize) == 0)
        path.vectorLanes = info.subgroupSize;
    return path;
}

DeviceInfo describeDevice(VkInstance instance, VkPhysicalDevice physical, uint32_t index,
                          const std::filesystem::path& limits) {
    DeviceInfo info;
    info.index = index;

    VkPhysicalDeviceProperties basic;
    vkGetPhysicalDeviceProperties(physical, &basic);
    info.name = basic.deviceName;
    const TypeName type = typeName(basic.deviceType);
    info.type = type.name;
    info.score = type.score;
    info.cpu = basic.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
    info.vendor = basic.vendorID;
    info.api = basic.apiVersion;
    info.apiVersion = versionText(info.api);
    if (info.api < VK_API_VERSION_1_2) {  // which the queries below are of
        info.refusals.push_back(fmt::format("Vulkan {} is older than 1.2", info.apiVersion));
        return info;
    }

    VkPhysicalDeviceVulkan11Properties properties11{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES};
    VkPhysicalDeviceVulkan12Properties properties12{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES};
    properties11.pNext = &properties12;
    VkPhysicalDevicePCIBusInfoPropertiesEXT bus{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PCI_BUS_INFO_PROPERTIES_EXT};
    if (hasExtension(physical, VK_EXT_PCI_BUS_INFO_EXTENSION_NAME)) properties12.pNext = &bus;
    VkPhysicalDeviceProperties2 properties{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
    properties.pNext = &properties11;
    vkGetPhysicalDeviceProperties2(physical, &properties);
    const VkPhysicalDeviceLimits& has = properties.properties.limits;
    std::ranges::copy(properties11.deviceUUID, info.uuid.begin());
    info.busAddress = uint64_t{bus.pciDomain} << 32 | uint64_t{bus.pciBus} << 16 |
                      uint64_t{bus.pciDevice} << 8 | bus.pciFunction;
    info.driver = fmt::format("{} {}", properties12.driverName, properties12.driverInfo);
    info.subgroupSize = properties11.subgroupSize;
    if (properties11.subgroupSupportedStages & VK_SHADER_STAGE_COMPUTE_BIT)
        info.subgroupOperations = properties11.subgroupSupportedOperations;
    info.maxAllocationBytes = properties11.maxMemoryAllocationSize;
    info.maxAllocations = has.maxMemoryAllocationCount;
    info.maxStorageBufferBytes = has.maxStorageBufferRange;
    info.storageAlignment = has.minStorageBufferOffsetAlignment;
    info.maxStorageBuffers = has.maxPerStageDescriptorStorageBuffers;
    info.maxTexels = has.maxTexelBufferElements;
    info.texelAlignment = has.minTexelBufferOffsetAlignment;
    info.maxPushConstantBytes = has.maxPushConstantsSize;
    info.maxSharedBytes = has.maxComputeSharedMemorySize;
    info.maxWorkgroupInvocations = has.maxComputeWorkGroupInvocations;
    std::ranges::copy(has.maxComputeWorkGroupSize, info.maxWorkgroupSize.begin());
    std::ranges::copy(has.maxComputeWorkGroupCount, info.maxWorkgroups.begin());
    info.timestamps = has.timestampComputeAndGraphics;

    VkPhysicalDeviceVulkan12Features features12{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    VkPhysicalDeviceFeatures2 features{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2};
    features.pNext = &features12;
    vkGetPhysicalDeviceFeatures2(physical, &features);
    info.addresses = features12.bufferDeviceAddress;
    info.scalarLayout = features12.scalarBlockLayout;
    info.int64 = features.features.shaderInt64;
    info.int64Atomics = features12.shaderBufferInt64Atomics;
    if (std::ranges::all_of(MatrixFeatures::kExtensions,
                            [&](const char* name) { return hasExtension(physical, name); }))
        info.halfMatrices = halfMatrixShape(instance, physical);

    // Kernels of an integrated GPU work in any heap, of a discrete one in its own.
    const bool own = basic.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU;
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    for (uint32_t i = 0; i < memory.memoryHeapCount; ++i)
        if (!own || (memory.memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT))
            info.memoryBytes = std::max(info.memoryBytes, memory.memoryHeaps[i].size);
    // Of a discrete GPU the host sees a window, through which it reads slowly.
    info.hostSeesMemory = !own;

    if (!limits.empty()) limitBy(info, limits);
    info.kernelPath =
        kernelPathOf(info, info.addresses ? Binding::Addresses : Binding::Descriptors);
    info.refusals = refusalsOf(info);
    if (!computeQueueFamily(physical)) info.refusals.emplace_back("no compute queue");
    return info;
}

}  // namespace doppel
