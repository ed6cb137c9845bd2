#include "viewer/window/swapchain.h"

#include <algorithm>
#include <optional>

#include "engine/instance.h"

namespace doppel {

namespace {

bool presents(VkPhysicalDevice physical, uint32_t family, VkSurfaceKHR surface) {
    VkBool32 can = VK_FALSE;
    return vkGetPhysicalDeviceSurfaceSupportKHR(physical, family, surface, &can) == VK_SUCCESS &&
           can == VK_TRUE;
}

// A queue that copies and presents to the surface; nothing where the device has none.
std::optional<uint32_t> presentingFamily(VkPhysicalDevice physical, VkSurfaceKHR surface) {
    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
    for (uint32_t i = 0; i < count; ++i)
        // Either kind can copy.
        if (families[i].queueFlags & (VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT) &&
            presents(physical, i, surface))
            return i;
    return std::nullopt;
}

// The number of a memory type that the host maps; one that it caches where there is one.
uint32_t hostMemory(VkPhysicalDevice physical, uint32_t allowed) {
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    constexpr VkMemoryPropertyFlags kMapped =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    for (VkMemoryPropertyFlags wanted : {kMapped | VK_MEMORY_PROPERTY_HOST_CACHED_BIT, kMapped})
        for (uint32_t type = 0; type < memory.memoryTypeCount; ++type)
            if (allowed >> type & 1 && (memory.memoryTypes[type].propertyFlags & wanted) == wanted)
                return type;
    throwMachine("the device that presents has no memory for pictures");
}

bool needsAnother(VkResult result) {
    return result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_ERROR_SURFACE_LOST_KHR;
}

}  // namespace

Swapchain::Swapchain(SurfaceSource source, Device* composing, const std::string& wanted)
    : source_(std::move(source)) {
    try {
        if (!composing || !share(*composing)) {
            bool validation = validationWanted();
            instance_ = createInstance(validation, source_.extensions);
            if (validation) messenger_ = createMessenger(instance_);
            makeSurface();
            chooseDevice(wanted);
            if (!chooseFormat())
                throwMachine("{} cannot show pictures of 8 bits per colour in this window",
                             deviceName_);
            makeDevice();
        }
        makeCommands();
    } catch (...) {
        release();
        throw;
    }
}

Swapchain::~Swapchain() { release(); }

void Swapchain::release() {
    if (sending_.valid()) sending_.wait();
    if (device_) {
        vkDeviceWaitIdle(device_);
        drop();
        vkDestroyBuffer(device_, staging_, nullptr);
        vkFreeMemory(device_, stagingMemory_, nullptr);
        vkDestroySemaphore(device_, acquired_, nullptr);
        vkDestroyFence(device_, done_, nullptr);
        vkDestroyCommandPool(device_, pool_, nullptr);
        if (!composing_) vkDestroyDevice(device_, nullptr);
    }
    if (surface_) vkDestroySurfaceKHR(instance_, surface_, nullptr);
    if (!composing_) destroyInstance(instance_, messenger_);
}

// Whether the device presents to the window; else nothing of it is kept.
bool Swapchain::share(Device& device) {
    if (!device.hasSwapchains()) return false;
    composing_ = &device;
    instance_ = device.instance();
    physical_ = device.physical();
    family_ = device.queueFamily();
    makeSurface();
    if (!presents(physical_, family_, surface_) || !chooseFormat()) {
        vkDestroySurfaceKHR(instance_, surface_, nullptr);
        surface_ = VK_NULL_HANDLE;
        instance_ = VK_NULL_HANDLE;
        physical_ = VK_NULL_HANDLE;
        composing_ = nullptr;
        return false;
    }
    deviceName_ = device.info().name;
    device_ = device.handle();
    queue_ = device.queue();
    queueMutex_ = &device.queueMutex();
    return true;
}

void Swapchain::makeSurface() {
    VkResult result = source_.makeSurface(instance_, &surface_);
    if (result != VK_SUCCESS)
        throwMachine("the window has no surface that Vulkan can draw on: {}", resultName(result));
}

void Swapchain::chooseDevice(const std::string& wanted) {
    for (VkPhysicalDevice candidate : physicalDevices(instance_)) {
        std::optional<uint32_t> family = presentingFamily(candidate, surface_);
        if (!family) continue;
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(candidate, &properties);
        std::string name = properties.deviceName;
        bool asked = !wanted.empty() && name.find(wanted) != std::string::npos;
        if (physical_ && !asked) continue;
        physical_ = candidate;
        family_ = *family;
        deviceName_ = std::move(name);
        if (asked) break;
    }
    if (!physical_) throwMachine("no Vulkan device can draw into this window");
}

// Whether the surface shows 8 bits per colour. They are sRGB-encoded already, so the format must
// not encode them again.
bool Swapchain::chooseFormat() {
    uint32_t count = 0;
    VK_CHECK(vkGetPhysicalDeviceSurfaceFormatsKHR(physical_, surface_, &count, nullptr));
    std::vector<VkSurfaceFormatKHR> formats(count);
    VK_CHECK(vkGetPhysicalDeviceSurfaceFormatsKHR(physical_, surface_, &count, formats.data()));
    for (VkFormat wanted : {VK_FORMAT_R8G8B8A8_UNORM, VK_FORMAT_B8G8R8A8_UNORM})
        for (const VkSurfaceFormatKHR& candidate : formats)
            if (candidate.format == wanted) {
                format_ = candidate;
                return true;
            }
    return false;
}

void Swapchain::makeDevice() {
    float priority = 1;
    VkDeviceQueueCreateInfo queueInfo{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
    queueInfo.queueFamilyIndex = family_;
    queueInfo.queueCount = 1;
    queueInfo.pQueuePriorities = &priority;
    const char* extension = VK_KHR_SWAPCHAIN_EXTENSION_NAME;
    VkDeviceCreateInfo deviceInfo{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO};
    deviceInfo.queueCreateInfoCount = 1;
    deviceInfo.pQueueCreateInfos = &queueInfo;
    deviceInfo.enabledExtensionCount = 1;
    deviceInfo.ppEnabledExtensionNames = &extension;
    VK_CHECK(vkCreateDevice(physical_, &deviceInfo, nullptr, &device_));
    vkGetDeviceQueue(device_, family_, 0, &queue_);
}

void Swapchain::makeCommands() {
    VkCommandPoolCreateInfo poolInfo{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    poolInfo.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
    poolInfo.queueFamilyIndex = family_;
    VK_CHECK(vkCreateCommandPool(device_, &poolInfo, nullptr, &pool_));
    VkCommandBufferAllocateInfo commandInfo{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
    commandInfo.commandPool = pool_;
    commandInfo.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    commandInfo.commandBufferCount = 1;
    VK_CHECK(vkAllocateCommandBuffers(device_, &commandInfo, &commands_));
    VkFenceCreateInfo fenceInfo{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    VK_CHECK(vkCreateFence(device_, &fenceInfo, nullptr, &done_));
    VkSemaphoreCreateInfo semaphoreInfo{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    VK_CHECK(vkCreateSemaphore(device_, &semaphoreInfo, nullptr, &acquired_));
}

void Swapchain::drop() {
    for (VkSemaphore semaphore : copied_) vkDestroySemaphore(device_, semaphore, nullptr);
    copied_.clear();
    vkDestroySwapchainKHR(device_, swapchain_, nullptr);
    swapchain_ = VK_NULL_HANDLE;
}

// Leaves none where the window has no size.
void Swapchain::make() {
    VK_CHECK(vkDeviceWaitIdle(device_));
    drop();
    VkSurfaceCapabilitiesKHR caps;
    VkResult result = vkGetPhysicalDeviceSurfaceCapabilitiesKHR(physical_, surface_, &caps);
    if (result == VK_ERROR_SURFACE_LOST_KHR) {
        vkDestroySurfaceKHR(instance_, surface_, nullptr);
        surface_ = VK_NULL_HANDLE;
        makeSurface();
        result = vkGetPhysicalDeviceSurfaceCapabilitiesKHR(physical_, surface_, &caps);
    }
    VK_CHECK(result);
    extent_ = caps.currentExtent;
    if (extent_.width == UINT32_MAX) {  // the window's own size decides
        VkExtent2D size = source_.size();
        extent_ = {std::clamp(size.width, caps.minImageExtent.width, caps.maxImageExtent.width),
                   std::clamp(size.height, caps.minImageExtent.height, caps.maxImageExtent.height)};
    }
    if (extent_.width == 0 || extent_.height == 0) return;

    uint32_t count = 0;
    VK_CHECK(vkGetPhysicalDeviceSurfacePresentModesKHR(physical_, surface_, &count, nullptr));
    std::vector<VkPresentModeKHR> modes(count);
    VK_CHECK(vkGetPhysicalDeviceSurfacePresentModesKHR(physical_, surface_, &count, modes.data()));
    VkSwapchainCreateInfoKHR info{VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR};
    info.surface = surface_;
    info.minImageCount = std::max(3u, caps.minImageCount);
    if (caps.maxImageCount > 0)
        info.minImageCount = std::min(info.minImageCount, caps.maxImageCount);
    info.imageFormat = format_.format;
    info.imageColorSpace = format_.colorSpace;
    info.imageExtent = extent_;
    info.imageArrayLayers = 1;
    info.imageUsage = VK_IMAGE_USAGE_TRANSFER_DST_BIT;
    info.imageSharingMode = VK_SHARING_MODE_EXCLUSIVE;
    info.preTransform = caps.currentTransform;
    info.compositeAlpha = caps.supportedCompositeAlpha & VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR
                              ? VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR
                              : VK_COMPOSITE_ALPHA_INHERIT_BIT_KHR;
    // The newest picture wins where that can be had: latency counts more than an even beat.
    info.presentMode = std::ranges::count(modes, VK_PRESENT_MODE_MAILBOX_KHR)
                           ? VK_PRESENT_MODE_MAILBOX_KHR
                           : VK_PRESENT_MODE_FIFO_KHR;
    info.clipped = VK_TRUE;
    if (!(caps.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_DST_BIT))
        throwMachine("{} cannot copy pictures into this window", deviceName_);
    VK_CHECK(vkCreateSwapchainKHR(device_, &info, nullptr, &swapchain_));
    ++count_;

    VK_CHECK(vkGetSwapchainImagesKHR(device_, swapchain_, &count, nullptr));
    images_.resize(count);
    VK_CHECK(vkGetSwapchainImagesKHR(device_, swapchain_, &count, images_.data()));
    for (uint32_t i = 0; i < count; ++i) {
        VkSemaphoreCreateInfo semaphoreInfo{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
        VK_CHECK(vkCreateSemaphore(device_, &semaphoreInfo, nullptr, &copied_.emplace_back()));
    }
    stale_ = false;
}

void Swapchain::reserve(VkDeviceSize bytes) {
    if (bytes <= stagingBytes_) return;
    vkDestroyBuffer(device_, staging_, nullptr);
    vkFreeMemory(device_, stagingMemory_, nullptr);
    staging_ = VK_NULL_HANDLE;
    stagingMemory_ = VK_NULL_HANDLE;
    stagingBytes_ = 0;
    VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
    info.size = bytes;
    info.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
    VK_CHECK(vkCreateBuffer(device_, &info, nullptr, &staging_));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device_, staging_, &needs);
    VkMemoryAllocateInfo allocate{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
    allocate.allocationSize = needs.size;
    allocate.memoryTypeIndex = hostMemory(physical_, needs.memoryTypeBits);
    VK_CHECK(vkAllocateMemory(device_, &allocate, nullptr, &stagingMemory_));
    VK_CHECK(vkBindBufferMemory(device_, staging_, stagingMemory_, 0));
    void* address = nullptr;
    VK_CHECK(vkMapMemory(device_, stagingMemory_, 0, VK_WHOLE_SIZE, 0, &address));
    mapped_ = static_cast<uint32_t*>(address);
    stagingBytes_ = bytes;
}

void Swapchain::waitForFrame() {
    if (!sending_.valid()) return;
    VkResult result = sending_.get();
    if (needsAnother(result) || result == VK_SUBOPTIMAL_KHR)
        stale_ = true;
    else
        VK_CHECK(result);
    VK_CHECK(vkWaitForFences(device_, 1, &done_, VK_TRUE, UINT64_MAX));
    VK_CHECK(vkResetFences(device_, 1, &done_));
}

// False where there is no image this time.
bool Swapchain::acquire() {
    for (int attempt = 0; attempt < 3; ++attempt) {
        if (stale_) make();
        if (!swapchain_) return false;
        VkResult result = vkAcquireNextImageKHR(device_, swapchain_, UINT64_MAX, acquired_,
                                                VK_NULL_HANDLE, &image_);
        stale_ = result != VK_SUCCESS;
        if (result == VK_SUCCESS || result == VK_SUBOPTIMAL_KHR) return true;
        if (!needsAnother(result)) VK_CHECK(result);
    }
    return false;
}

bool Swapchain::next() {
    waitForFrame();
    return acquire();
}

Canvas Swapchain::canvas() {
    const size_t pixels = size_t{extent_.width} * extent_.height;
    reserve(pixels * sizeof(uint32_t));
    return {width(), height(), blueFirst(), {mapped_, pixels}};
}

void Swapchain::present(const Buffer* composed) {
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    VK_CHECK(vkBeginCommandBuffer(commands_, &begin));
    VkImageMemoryBarrier barrier{VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER};
    barrier.dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.oldLayout = VK_IMAGE_LAYOUT_UNDEFINED;
    barrier.newLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
    barrier.srcQueueFamilyIndex = barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.image = images_[image_];
    barrier.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    vkCmdPipelineBarrier(commands_, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT,
                         0, 0, nullptr, 0, nullptr, 1, &barrier);
    VkBufferImageCopy copy{};
    copy.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
    copy.imageExtent = {extent_.width, extent_.height, 1};
    vkCmdCopyBufferToImage(commands_, composed ? composed->handle() : staging_, images_[image_],
                           VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &copy);
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = 0;
    barrier.oldLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
    barrier.newLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
    vkCmdPipelineBarrier(commands_, VK_PIPELINE_STAGE_TRANSFER_BIT,
                         VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, 0, 0, nullptr, 0, nullptr, 1,
                         &barrier);
    VK_CHECK(vkEndCommandBuffer(commands_));
    sending_ = std::async(std::launch::async, [this] { return submit(); });
}

// A CPU copies before this returns. What the device composes is ahead of it in the same queue.
VkResult Swapchain::submit() {
    std::lock_guard lock(*queueMutex_);
    VkPipelineStageFlags stage = VK_PIPELINE_STAGE_TRANSFER_BIT;
    VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
    submit.waitSemaphoreCount = 1;
    submit.pWaitSemaphores = &acquired_;
    submit.pWaitDstStageMask = &stage;
    submit.commandBufferCount = 1;
    submit.pCommandBuffers = &commands_;
    submit.signalSemaphoreCount = 1;
    submit.pSignalSemaphores = &copied_[image_];
    VK_CHECK(vkQueueSubmit(queue_, 1, &submit, done_));
    VkPresentInfoKHR info{VK_STRUCTURE_TYPE_PRESENT_INFO_KHR};
    info.waitSemaphoreCount = 1;
    info.pWaitSemaphores = &copied_[image_];
    info.swapchainCount = 1;
    info.pSwapchains = &swapchain_;
    info.pImageIndices = &image_;
    return vkQueuePresentKHR(queue_, &info);
}

}  // namespace doppel
