#include "engine/device.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cstdlib>
#include <cstring>

#include "engine/device_match.h"
#include "engine/instance.h"

namespace doppel {

namespace {

bool environmentSays(const char* name, std::string_view value) {
    const char* set = std::getenv(name);
    return set && set == value;
}

// "GPU-" and the UUID in its usual groups.
std::string uuidText(const std::array<uint8_t, VK_UUID_SIZE>& uuid) {
    std::string text = "GPU-";
    for (size_t i = 0; i < uuid.size(); ++i)
        text += fmt::format("{}{:02x}", i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
    return text;
}

std::vector<DeviceInfo> describeAll(VkInstance instance, const std::filesystem::path& limits) {
    std::vector<DeviceInfo> infos;
    for (VkPhysicalDevice physical : physicalDevices(instance))
        infos.push_back(
            describeDevice(instance, physical, static_cast<uint32_t>(infos.size()), limits));
    leaveToOthers(infos, [](const char* name) { return std::getenv(name); });
    return infos;
}

std::filesystem::path limitsWanted(const DeviceOptions& options) {
    if (!options.limits.empty()) return options.limits;
    const char* set = std::getenv("DOPPEL_DEVICE_LIMITS");
    return set ? set : "";
}

}  // namespace

bool matches(const DeviceInfo& info, const std::string& wanted) {
    if (wanted.empty()) return true;
    uint32_t index = 0;
    auto [end, error] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), index);
    if (error == std::errc() && end == wanted.data() + wanted.size()) return index == info.index;
    auto lower = [](std::string text) {
        std::ranges::transform(text, text.begin(),
                               [](char c) { return c >= 'A' && c <= 'Z' ? char(c + 32) : c; });
        return text;
    };
    return lower(info.name).find(lower(wanted)) != std::string::npos;
}

void leaveToOthers(std::span<DeviceInfo> devices,
                   const std::function<const char*(const char*)>& variable) {
    constexpr std::pair<uint32_t, const char*> kVariables[] = {{0x10de, "CUDA_VISIBLE_DEVICES"},
                                                               {0x1002, "ROCR_VISIBLE_DEVICES"}};
    for (const auto& [vendor, name] : kVariables) {
        const char* set = variable(name);
        if (!set) continue;
        std::vector<DeviceInfo*> own;
        for (DeviceInfo& info : devices)
            if (info.vendor == vendor) own.push_back(&info);
        std::ranges::stable_sort(own, {}, &DeviceInfo::busAddress);

        const std::string_view text(set);
        const bool none = text == "NoDevFiles";  // as Slurm says that a job has no GPU
        std::vector<const DeviceInfo*> named;
        for (size_t begin = 0; !none && begin < text.size();) {
            const size_t end = std::min(text.find(',', begin), text.size());
            std::string_view word = text.substr(begin, end - begin);
            begin = end + 1;
            word.remove_prefix(std::min(word.find_first_not_of(' '), word.size()));
            if (word == "-1") break;  // CUDA's end of a list
            size_t place = 0;
            const auto [rest, error] =
                std::from_chars(word.data(), word.data() + word.size(), place);
            const bool number = error == std::errc() && rest == word.data() + word.size();
            for (size_t i = 0; i < own.size(); ++i) {
                const std::string uuid = uuidText(own[i]->uuid);
                // A part of it will do, as CUDA has it.
                if (number ? i == place : word.size() > 4 && uuid.starts_with(word))
                    named.push_back(own[i]);
            }
        }
        if (named.empty() && !none) continue;
        for (DeviceInfo* info : own)
            if (std::ranges::count(named, info) == 0)
                info->refusals.push_back(fmt::format("left to others by {}={}", name, text));
    }
}

Precision precisionNamed(std::string_view name) {
    if (name == "fp32") return Precision::Single;
    if (name == "mixed") return Precision::Mixed;
    throwInput("--precision: expected fp32 or mixed, found \"{}\"", name);
}

const char* precisionName(Precision precision) {
    return precision == Precision::Mixed ? "mixed" : "fp32";
}

std::vector<DeviceInfo> Device::list() {
    VkInstance instance = createInstance(false);
    std::vector<DeviceInfo> infos = describeAll(instance, limitsWanted({}));
    destroyInstance(instance, VK_NULL_HANDLE);
    return infos;
}

Device::Device(DeviceOptions options) {
    bool validation = options.validation || validationWanted();
    const bool surfaces =
        !options.surfaceExtensions.empty() && instancesHave(options.surfaceExtensions);
    if (!surfaces) options.surfaceExtensions.clear();
    instance_ = createInstance(validation, options.surfaceExtensions);
    try {
        if (validation) messenger_ = createMessenger(instance_);

        std::vector<VkPhysicalDevice> physicals = physicalDevices(instance_);
        const std::vector<DeviceInfo> infos = describeAll(instance_, limitsWanted(options));
        std::string reasons;
        for (uint32_t i = 0; i < physicals.size(); ++i) {
            const DeviceInfo& info = infos[i];
            std::string refusal;
            for (const std::string& reason : info.refusals)
                refusal += (refusal.empty() ? "" : ", ") + reason;
            if (!matches(info, options.name))
                refusal = fmt::format("its name does not contain \"{}\"", options.name);
            reasons += fmt::format("\n  {} {}: {}", i, info.name, refusal);
            if (refusal.empty() && (!physical_ || info.score > info_.score)) {
                physical_ = physicals[i];
                info_ = info;
            }
        }
        if (!physical_)
            throwMachine("no usable Vulkan device{}",
                         reasons.empty() ? " (the loader found none)" : ":" + reasons);

        binding_ = options.binding.value_or(environmentSays("DOPPEL_BINDING", "descriptors")
                                                ? Binding::Descriptors
                                                : Binding::Addresses);
        if (!info_.addresses) binding_ = Binding::Descriptors;
        info_.kernelPath = kernelPathOf(info_, binding_);
        bool addresses = binding_ == Binding::Addresses;
        precision_ = options.precision;
        secondsPerSubmit_ = options.secondsPerSubmit;
        // A CPU emulates them, several times slower than plain kernels: for tests.
        const bool units = kernelPath().onCpu ? environmentSays("DOPPEL_MATRIX_UNITS", "emulated")
                                              : !environmentSays("DOPPEL_MATRIX_UNITS", "off");
        const bool judged = !validation || validationKnowsMatrices();
        if (precision_ == Precision::Mixed && addresses && units && judged)
            matrixUnits_ = info_.halfMatrices;

        float priority = 1;
        VkDeviceQueueCreateInfo queueInfo{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
        queueInfo.queueFamilyIndex = queueFamily_ = *computeQueueFamily(physical_);
        queueInfo.queueCount = 1;
        queueInfo.pQueuePriorities = &priority;
        VkPhysicalDeviceVulkan12Features features12{
            VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
        features12.scalarBlockLayout = VK_TRUE;
        features12.bufferDeviceAddress = addresses ? VK_TRUE : VK_FALSE;
        features12.shaderBufferInt64Atomics = kernelPath().int64Atomics ? VK_TRUE : VK_FALSE;
        VkDeviceCreateInfo deviceInfo{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO};
        deviceInfo.pNext = &features12;
        std::vector<const char*> extensions;
        MatrixFeatures matrixFeatures;
        if (matrixUnits_) {
            deviceInfo.pNext = matrixFeatures.chain(features12);
            extensions.assign(MatrixFeatures::kExtensions.begin(),
                              MatrixFeatures::kExtensions.end());
        }
        hasSwapchains_ = surfaces && hasExtension(physical_, VK_KHR_SWAPCHAIN_EXTENSION_NAME);
        if (hasSwapchains_) extensions.push_back(VK_KHR_SWAPCHAIN_EXTENSION_NAME);
        deviceInfo.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
        deviceInfo.ppEnabledExtensionNames = extensions.data();
        VkPhysicalDeviceFeatures features{};
        features.shaderInt64 = info_.int64 ? VK_TRUE : VK_FALSE;
        deviceInfo.pEnabledFeatures = &features;
        deviceInfo.queueCreateInfoCount = 1;
        deviceInfo.pQueueCreateInfos = &queueInfo;
        VK_CHECK(vkCreateDevice(physical_, &deviceInfo, nullptr, &device_));
        vkGetDeviceQueue(device_, queueInfo.queueFamilyIndex, 0, &queue_);

        VkCommandPoolCreateInfo poolInfo{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
        poolInfo.queueFamilyIndex = queueInfo.queueFamilyIndex;
        VK_CHECK(vkCreateCommandPool(device_, &poolInfo, nullptr, &pool_));
        VkPipelineCacheCreateInfo cacheInfo{VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO};
        VK_CHECK(vkCreatePipelineCache(device_, &cacheInfo, nullptr, &pipelineCache_));

        vkGetPhysicalDeviceMemoryProperties(physical_, &memory_);
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(physical_, &properties);
        timestampPeriod_ = static_cast<double>(properties.limits.timestampPeriod);
    } catch (...) {
        destroy();  // a constructor that throws runs no destructor
        throw;
    }
}

Device::~Device() { destroy(); }

void Device::destroy() {
    if (device_) {
        vkDeviceWaitIdle(device_);
        kernels_.clear();
        vkDestroyPipelineCache(device_, pipelineCache_, nullptr);
        vkDestroyCommandPool(device_, pool_, nullptr);
        vkDestroyDevice(device_, nullptr);
    }
    destroyInstance(instance_, messenger_);
}

// Types of memory for this use, best first.
std::vector<uint32_t> Device::memoryTypes(uint32_t allowed, Memory memory) const {
    constexpr VkMemoryPropertyFlags kLocal = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
    constexpr VkMemoryPropertyFlags kHost =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    constexpr VkMemoryPropertyFlags kCached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
    std::vector<VkMemoryPropertyFlags> wishes;
    if (memory == Memory::Device && !info_.hostSeesMemory)
        wishes = {kLocal};
    else if (memory == Memory::Device)
        wishes = {kLocal | kHost | kCached, kLocal | kHost, kLocal, kHost};
    else if (memory == Memory::Upload)
        wishes = {kHost};
    else
        wishes = {kHost | kCached, kHost};
    std::vector<uint32_t> types;
    for (VkMemoryPropertyFlags wish : wishes)
        for (uint32_t i = 0; i < memory_.memoryTypeCount; ++i)
            if ((allowed >> i & 1) && (memory_.memoryTypes[i].propertyFlags & wish) == wish &&
                std::ranges::find(types, i) == types.end())
                types.push_back(i);
    if (types.empty()) throwMachine("{} has no memory of the kind that is needed", info_.name);
    return types;
}

Buffer Device::allocate(uint64_t bytes, Memory memory) {
    bytes = alignUp(std::max<uint64_t>(bytes, 16), 16);
    bool addresses = binding_ == Binding::Addresses;
    VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
    info.size = bytes;
    info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                 VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT;
    if (addresses) info.usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    if (kernelPath().texels) info.usage |= VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT;
    VkBuffer buffer = VK_NULL_HANDLE;
    VK_CHECK(vkCreateBuffer(device_, &info, nullptr, &buffer));
    VkMemoryRequirements requirements;
    vkGetBufferMemoryRequirements(device_, buffer, &requirements);
    auto refuse = [&](const std::string& reason) {
        vkDestroyBuffer(device_, buffer, nullptr);
        throwMachine("{} cannot allocate {} bytes ({}); use a smaller preset or --memory",
                     info_.name, bytes, reason);
    };
    if (requirements.size > info_.maxAllocationBytes)
        refuse(fmt::format("{} at once at most", info_.maxAllocationBytes));
    if (memoryInUse_->allocations >= info_.maxAllocations)
        refuse(fmt::format("it has {} allocations, which are all it takes", info_.maxAllocations));
    const uint64_t before = memoryInUse_->deviceBytes;
    if (memory == Memory::Device && before + requirements.size > info_.memoryBytes)
        refuse(fmt::format("{} of its {} are in use", before, info_.memoryBytes));

    VkMemoryAllocateFlagsInfo flags{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO};
    flags.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
    VkMemoryAllocateInfo allocation{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
    allocation.pNext = addresses ? &flags : nullptr;
    allocation.allocationSize = requirements.size;
    VkDeviceMemory deviceMemory = VK_NULL_HANDLE;
    VkResult result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    for (uint32_t type : memoryTypes(requirements.memoryTypeBits, memory)) {
        allocation.memoryTypeIndex = type;
        result = vkAllocateMemory(device_, &allocation, nullptr, &deviceMemory);
        if (result == VK_SUCCESS) break;
    }
    if (result != VK_SUCCESS) refuse(resultName(result));
    VK_CHECK(vkBindBufferMemory(device_, buffer, deviceMemory, 0));

    uint64_t address = 0;
    if (addresses) {
        VkBufferDeviceAddressInfo addressInfo{VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO};
        addressInfo.buffer = buffer;
        address = vkGetBufferDeviceAddress(device_, &addressInfo);
    } else {
        static std::atomic<uint64_t> count = 0;
        address = ++count << 40;
    }
    // Memory that is not coherent would have to be flushed: it is copied to and from instead.
    constexpr VkMemoryPropertyFlags kMapped =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    void* mapped = nullptr;
    VkMemoryPropertyFlags kind = memory_.memoryTypes[allocation.memoryTypeIndex].propertyFlags;
    if ((kind & kMapped) == kMapped && (memory != Memory::Device || info_.hostSeesMemory))
        VK_CHECK(vkMapMemory(device_, deviceMemory, 0, VK_WHOLE_SIZE, 0, &mapped));
    return {device_,
            buffer,
            deviceMemory,
            bytes,
            address,
            static_cast<std::byte*>(mapped),
            {memoryInUse_, memory == Memory::Device ? requirements.size : 0}};
}

// The kernel that an op means by name: with cpu its variant for CPUs (shaders/shaders.cmake), where
// it has one, in place of the plain one, which an op may ask for by "@plain".
static const ShaderTableRow& kernelRow(std::string_view name, bool cpu) {
    constexpr std::string_view kPlain = "@plain", kCpu = "@cpu";
    const auto table = shaderTable();
    auto row = table.end();
    if (name.ends_with(kPlain))
        name.remove_suffix(kPlain.size());
    else if (cpu)
        row = std::ranges::find(table, std::string(name).append(kCpu), &ShaderTableRow::name);
    if (row == table.end()) row = std::ranges::find(table, name, &ShaderTableRow::name);
    CHECK(row != table.end(), "there is a shader entry {}", name);
    return *row;
}

const Kernel& Device::kernel(std::string_view name, const Specialisation& specialisation) {
    auto key = std::pair(std::string(name), specialisation);
    auto found = kernels_.find(key);
    if (found == kernels_.end()) {
        const ShaderTableRow& row = kernelRow(name, kernelPath().texels);
        Specialisation complete = specialisation;
        if (kernelPath().onCpu && reflect(row.descriptors).constants.contains("kOnCpu"))
            complete["kOnCpu"] = 1;  // of shaders/common/op.glsl
        const bool descriptors = binding_ == Binding::Descriptors;
        checkKernel(info_, row, descriptors, complete);
        found = kernels_
                    .emplace(std::move(key),
                             std::make_unique<Kernel>(device_, pipelineCache_, row, descriptors,
                                                      complete, !kernelPath().onCpu))
                    .first;
    }
    return *found->second;
}

void Device::upload(const BufferView& target, std::span<const std::byte> bytes) {
    CHECK(bytes.size() <= target.bytes, "{} bytes fit into a view of {}", bytes.size(),
          target.bytes);
    if (bytes.empty()) return;
    if (std::byte* mapped = target.mapped()) {
        std::memcpy(mapped, bytes.data(), bytes.size());
        return;
    }
    Buffer staging = allocate(bytes.size(), Memory::Upload);
    std::memcpy(staging.mapped(), bytes.data(), bytes.size());
    runOnce([&](VkCommandBuffer commands) {
        VkBufferCopy region{0, target.offset, bytes.size()};
        vkCmdCopyBuffer(commands, staging.handle(), target.buffer->handle(), 1, &region);
    });
}

void Device::download(const BufferView& source, std::span<std::byte> bytes) {
    CHECK(bytes.size() <= source.bytes, "{} bytes are in a view of {}", bytes.size(), source.bytes);
    if (bytes.empty()) return;
    if (const std::byte* mapped = source.mapped()) {
        std::memcpy(bytes.data(), mapped, bytes.size());
        return;
    }
    Buffer staging = allocate(bytes.size(), Memory::Readback);
    runOnce([&](VkCommandBuffer commands) {
        VkBufferCopy region{source.offset, 0, bytes.size()};
        vkCmdCopyBuffer(commands, source.buffer->handle(), staging.handle(), 1, &region);
    });
    std::memcpy(bytes.data(), staging.mapped(), bytes.size());
}

VkCommandBuffer Device::newCommandBuffer() {
    VkCommandBufferAllocateInfo info{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
    info.commandPool = pool_;
    info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    info.commandBufferCount = 1;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VK_CHECK(vkAllocateCommandBuffers(device_, &info, &commands));
    return commands;
}

void Device::freeCommandBuffer(VkCommandBuffer commands) {
    vkFreeCommandBuffers(device_, pool_, 1, &commands);
}

VkFence Device::newFence() {
    VkFenceCreateInfo info{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    VkFence fence = VK_NULL_HANDLE;
    VK_CHECK(vkCreateFence(device_, &info, nullptr, &fence));
    return fence;
}

void Device::submit(std::span<const VkCommandBuffer> commands, VkFence fence) {
    ++submissions_;
    VK_CHECK(vkResetFences(device_, 1, &fence));
    std::lock_guard lock(queueMutex_);
    for (const VkCommandBuffer& one : commands) {
        VkSubmitInfo info{VK_STRUCTURE_TYPE_SUBMIT_INFO};
        info.commandBufferCount = 1;
        info.pCommandBuffers = &one;
        const bool last = &one == &commands.back();
        VK_CHECK(vkQueueSubmit(queue_, 1, &info, last ? fence : VK_NULL_HANDLE));
    }
}

void Device::wait(VkFence fence) {
    VK_CHECK(vkWaitForFences(device_, 1, &fence, VK_TRUE, UINT64_MAX));
}

void Device::runOnce(const std::function<void(VkCommandBuffer)>& record) {
    VkCommandBuffer commands = newCommandBuffer();
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    VK_CHECK(vkBeginCommandBuffer(commands, &begin));
    record(commands);
    VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT | VK_ACCESS_SHADER_READ_BIT |
                            VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_READ_BIT |
                            VK_ACCESS_TRANSFER_WRITE_BIT;
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                         VK_PIPELINE_STAGE_HOST_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT |
                             VK_PIPELINE_STAGE_TRANSFER_BIT,
                         0, 1, &barrier, 0, nullptr, 0, nullptr);
    VK_CHECK(vkEndCommandBuffer(commands));
    VkFence fence = newFence();
    submit({&commands, 1}, fence);
    wait(fence);
    vkDestroyFence(device_, fence, nullptr);
    freeCommandBuffer(commands);
}

}  // namespace doppel
