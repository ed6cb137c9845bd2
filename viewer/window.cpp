#include "viewer/window.h"

// GLFW declares its Vulkan functions where Vulkan came first.
#include "engine/instance.h"
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_vulkan.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <future>
#include <optional>

namespace doppel {

namespace {

std::string glfwReason() {
    const char* text = nullptr;
    glfwGetError(&text);
    return text ? text : "no reason given";
}

void checkImGui(VkResult result) {
    if (result != VK_SUCCESS) vulkanFailed(result, "Dear ImGui", __FILE__, __LINE__);
}

struct Presenter {
    VkPhysicalDevice physical;
    uint32_t family;
    std::string name;
};

// A device with a queue that draws and presents to the surface; nothing where it has none.
std::optional<Presenter> presenterOf(VkPhysicalDevice physical, VkSurfaceKHR surface) {
    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
    for (uint32_t i = 0; i < count; ++i) {
        VkBool32 presents = VK_FALSE;
        if (vkGetPhysicalDeviceSurfaceSupportKHR(physical, i, surface, &presents) != VK_SUCCESS)
            continue;
        if (!presents || !(families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT)) continue;
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(physical, &properties);
        return Presenter{physical, i, properties.deviceName};
    }
    return std::nullopt;
}

constexpr uint32_t kNone = UINT32_MAX;

// Of the environment, until it goes.
class Setting {
public:
    Setting(const char* name, const char* value) : name_(name) {
        if (const char* was = std::getenv(name)) was_ = was;
        setenv(name, value, 1);
    }
    ~Setting() { was_ ? setenv(name_, was_->c_str(), 1) : unsetenv(name_); }
    Setting(const Setting&) = delete;
    Setting& operator=(const Setting&) = delete;

private:
    const char* name_;
    std::optional<std::string> was_;
};

constexpr const char *kVectorWidth = "LP_NATIVE_VECTOR_WIDTH", *kNarrow = "256";

bool hasWideVectors() {
    const char* width = std::getenv(kVectorWidth);
    return width && std::string_view(width) == "512";
}
// The manifest of the driver's copy for windows; empty: there is none.
std::string ownDriver() {
    const char* driver = std::getenv("VK_DRIVER_FILES");
    if (!driver) return {};
    std::filesystem::path manifest = driver;
    manifest = manifest.parent_path() / "window" / manifest.filename();
    std::error_code ignored;
    return std::filesystem::is_regular_file(manifest, ignored) ? manifest.string() : std::string();
}

}  // namespace

struct Window::Parts {
    GLFWwindow* window = nullptr;
    std::vector<KeyPress> keys, keysNow;
    std::vector<std::filesystem::path> dropped;
    std::string deviceName;

    VkInstance instance = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
    VkSurfaceKHR surface = VK_NULL_HANDLE;
    VkPhysicalDevice physical = VK_NULL_HANDLE;
    uint32_t family = 0;
    VkDevice device = VK_NULL_HANDLE;
    VkQueue queue = VK_NULL_HANDLE;
    VkCommandPool pool = VK_NULL_HANDLE;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VkFence done = VK_NULL_HANDLE;
    VkSemaphore acquired = VK_NULL_HANDLE;
    VkDescriptorPool descriptors = VK_NULL_HANDLE;
    VkRenderPass pass = VK_NULL_HANDLE;
    VkSurfaceFormatKHR format{};
    bool imguiReady = false;

    VkSwapchainKHR swapchain = VK_NULL_HANDLE;
    VkExtent2D extent{};
    std::vector<VkImage> images;
    std::vector<VkImageView> views;
    std::vector<VkFramebuffer> framebuffers;
    std::vector<VkSemaphore> drawn;  // per image: what presenting it waits for
    bool stale = true;               // the swapchain has to be made anew
    int swapchains = 0;
    bool pending = false;             // a submission is on its way
    std::future<VkResult> presented;  // of that submission; it has the queue for itself till then

    // Asked for once per frame: each is a message to the X server and back.
    int wide = 0, high = 0;  // 0 while minimised
    double scale = 1;

    VkBuffer staging = VK_NULL_HANDLE;
    VkDeviceMemory stagingMemory = VK_NULL_HANDLE;
    VkDeviceSize stagingBytes = 0;
    std::byte* mapped = nullptr;

    ~Parts();
    void openWindow(const WindowOptions& options);
    void openDevice(const std::string& wanted);
    void openImGui();
    void chooseFormat();
    void makeSwapchain();
    void dropSwapchain();
    void makeSurface();
    void reserveStaging(VkDeviceSize bytes);
    void measure();
    void waitForFrame();
    uint32_t acquire();
    VkResult present(uint32_t image);
    void record(uint32_t image, std::span<const PlacedPicture> pictures);
};

void Window::avoidWideVectors() {
    if (hasWideVectors() && ownDriver().empty()) setenv(kVectorWidth, kNarrow, 1);
}

void Window::Parts::openWindow(const WindowOptions& options) {
    if (!glfwInit())
        throwMachine("no window can be opened: {}; over ssh, DISPLAY has to be set, or use Xvfb",
                     glfwReason());
    if (!glfwVulkanSupported())
        throwMachine(
            "no window can be opened: the Vulkan loader or its surface extensions are "
            "missing ({})",
            glfwReason());
    glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
    window =
        glfwCreateWindow(options.width, options.height, options.title.c_str(), nullptr, nullptr);
    if (!window) throwMachine("no window can be opened: {}", glfwReason());
    measure();
    glfwSetWindowUserPointer(window, this);
    // Before ImGui's, which calls them in turn.
    glfwSetKeyCallback(window, [](GLFWwindow* w, int key, int, int action, int modifiers) {
        if (action != GLFW_RELEASE)
            static_cast<Parts*>(glfwGetWindowUserPointer(w))->keys.push_back({key, modifiers});
    });
    glfwSetDropCallback(window, [](GLFWwindow* w, int count, const char** paths) {
        auto& files = static_cast<Parts*>(glfwGetWindowUserPointer(w))->dropped;
        files.insert(files.end(), paths, paths + count);
    });
    glfwSetFramebufferSizeCallback(window, [](GLFWwindow* w, int, int) {
        static_cast<Parts*>(glfwGetWindowUserPointer(w))->stale = true;
    });
}

void Window::Parts::makeSurface() {
    VkResult result = glfwCreateWindowSurface(instance, window, nullptr, &surface);
    if (result != VK_SUCCESS)
        throwMachine("the window has no surface that Vulkan can draw on: {}", resultName(result));
}

void Window::Parts::openDevice(const std::string& wanted) {
    std::optional<Setting> driver, width;
    if (std::string own = ownDriver(); hasWideVectors() && !own.empty()) {
        driver.emplace("VK_DRIVER_FILES", own.c_str());
        // The copy does not ask for it, but what it compiles has a folder by it (createInstance).
        width.emplace(kVectorWidth, kNarrow);
    }
    uint32_t count = 0;
    const char** extensions = glfwGetRequiredInstanceExtensions(&count);
    bool validation = validationWanted();
    instance = createInstance(validation, {extensions, count});
    if (validation) messenger = createMessenger(instance);
    makeSurface();
    std::optional<Presenter> chosen;
    for (VkPhysicalDevice candidate : physicalDevices(instance)) {
        std::optional<Presenter> presenter = presenterOf(candidate, surface);
        if (!presenter) continue;
        bool asked = !wanted.empty() && presenter->name.find(wanted) != std::string::npos;
        if (!chosen || asked) chosen = presenter;
        if (asked) break;
    }
    if (!chosen) throwMachine("no Vulkan device can draw into this window");
    physical = chosen->physical;
    family = chosen->family;
    deviceName = chosen->name;

    float priority = 1;
    VkDeviceQueueCreateInfo queueInfo{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
    queueInfo.queueFamilyIndex = family;
    queueInfo.queueCount = 1;
    queueInfo.pQueuePriorities = &priority;
    const char* swapchainExtension = VK_KHR_SWAPCHAIN_EXTENSION_NAME;
    VkDeviceCreateInfo deviceInfo{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO};
    deviceInfo.queueCreateInfoCount = 1;
    deviceInfo.pQueueCreateInfos = &queueInfo;
    deviceInfo.enabledExtensionCount = 1;
    deviceInfo.ppEnabledExtensionNames = &swapchainExtension;
    VK_CHECK(vkCreateDevice(physical, &deviceInfo, nullptr, &device));
    vkGetDeviceQueue(device, family, 0, &queue);

    VkCommandPoolCreateInfo poolInfo{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    poolInfo.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
    poolInfo.queueFamilyIndex = family;
    VK_CHECK(vkCreateCommandPool(device, &poolInfo, nullptr, &pool));
    VkCommandBufferAllocateInfo commandInfo{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
    commandInfo.commandPool = pool;
    commandInfo.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    commandInfo.commandBufferCount = 1;
    VK_CHECK(vkAllocateCommandBuffers(device, &commandInfo, &commands));
    VkFenceCreateInfo fenceInfo{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    VK_CHECK(vkCreateFence(device, &fenceInfo, nullptr, &done));
    VkSemaphoreCreateInfo semaphoreInfo{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    VK_CHECK(vkCreateSemaphore(device, &semaphoreInfo, nullptr, &acquired));
    VkDescriptorPoolSize poolSize{VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 4};
    VkDescriptorPoolCreateInfo descriptorInfo{VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO};
    descriptorInfo.flags = VK_DESCRIPTOR_POOL_CREATE_FREE_DESCRIPTOR_SET_BIT;
    descriptorInfo.maxSets = 4;
    descriptorInfo.poolSizeCount = 1;
    descriptorInfo.pPoolSizes = &poolSize;
    VK_CHECK(vkCreateDescriptorPool(device, &descriptorInfo, nullptr, &descriptors));
}

// Colours are sRGB-encoded already, so the format must not encode them again.
void Window::Parts::chooseFormat() {
    uint32_t count = 0;
    VK_CHECK(vkGetPhysicalDeviceSurfaceFormatsKHR(physical, surface, &count, nullptr));
    std::vector<VkSurfaceFormatKHR> formats(count);
    VK_CHECK(vkGetPhysicalDeviceSurfaceFormatsKHR(physical, surface, &count, formats.data()));
    for (VkFormat wanted : {VK_FORMAT_R8G8B8A8_UNORM, VK_FORMAT_B8G8R8A8_UNORM})
        for (const VkSurfaceFormatKHR& candidate : formats)
            if (candidate.format == wanted) {
                format = candidate;
                return;
            }
    throwMachine("{} cannot show pictures of 8 bits per colour in this window", deviceName);
}

void Window::Parts::openImGui() {
    VkAttachmentDescription attachment{};
    attachment.format = format.format;
    attachment.samples = VK_SAMPLE_COUNT_1_BIT;
    attachment.loadOp = VK_ATTACHMENT_LOAD_OP_LOAD;  // over the pictures
    attachment.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    attachment.stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE;
    attachment.stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
    attachment.initialLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
    attachment.finalLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
    VkAttachmentReference reference{0, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL};
    VkSubpassDescription subpass{};
    subpass.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
    subpass.colorAttachmentCount = 1;
    subpass.pColorAttachments = &reference;
    VkSubpassDependency dependency{};
    dependency.srcSubpass = VK_SUBPASS_EXTERNAL;
    dependency.srcStageMask = VK_PIPELINE_STAGE_TRANSFER_BIT;
    dependency.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    dependency.dstStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    dependency.dstAccessMask =
        VK_ACCESS_COLOR_ATTACHMENT_READ_BIT | VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
    VkRenderPassCreateInfo passInfo{VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO};
    passInfo.attachmentCount = 1;
    passInfo.pAttachments = &attachment;
    passInfo.subpassCount = 1;
    passInfo.pSubpasses = &subpass;
    passInfo.dependencyCount = 1;
    passInfo.pDependencies = &dependency;
    VK_CHECK(vkCreateRenderPass(device, &passInfo, nullptr, &pass));

    IMGUI_CHECKVERSION();
    ImGui::CreateContext();
    imguiReady = true;
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr;  // nothing is written into the user's folders
    ImGui::StyleColorsDark();
    ImGui::GetStyle().WindowRounding = 4;
    ImGui::GetStyle().FrameRounding = 3;
    float x = 1, y = 1;
    glfwGetWindowContentScale(window, &x, &y);
    ImFontConfig font;
    font.SizePixels = std::round(13 * std::max(x, 1.0f));
    io.Fonts->AddFontDefault(&font);
    ImGui_ImplGlfw_InitForVulkan(window, true);
    ImGui_ImplVulkan_InitInfo info{};
    info.Instance = instance;
    info.PhysicalDevice = physical;
    info.Device = device;
    info.QueueFamily = family;
    info.Queue = queue;
    info.DescriptorPool = descriptors;
    info.MinImageCount = 2;
    info.ImageCount = 2;  // ImGui's own buffers go round; one frame is on its way at most
    info.CheckVkResultFn = checkImGui;
    ImGui_ImplVulkan_Init(&info, pass);

    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VK_CHECK(vkBeginCommandBuffer(commands, &begin));
    ImGui_ImplVulkan_CreateFontsTexture(commands);
    VK_CHECK(vkEndCommandBuffer(commands));
    VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
    submit.commandBufferCount = 1;
    submit.pCommandBuffers = &commands;
    VK_CHECK(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE));
    VK_CHECK(vkQueueWaitIdle(queue));
    ImGui_ImplVulkan_DestroyFontUploadObjects();
}

void Window::Parts::dropSwapchain() {
    for (VkFramebuffer framebuffer : framebuffers)
        vkDestroyFramebuffer(device, framebuffer, nullptr);
    for (VkImageView view : views) vkDestroyImageView(device, view, nullptr);
    for (VkSemaphore semaphore : drawn) vkDestroySemaphore(device, semaphore, nullptr);
    framebuffers.clear();
    views.clear();
    drawn.clear();
    vkDestroySwapchainKHR(device, swapchain, nullptr);
    swapchain = VK_NULL_HANDLE;
}

// Leaves no swapchain where the window has no size.
void Window::Parts::makeSwapchain() {
    VK_CHECK(vkDeviceWaitIdle(device));
    dropSwapchain();
    VkSurfaceCapabilitiesKHR caps;
    VkResult result = vkGetPhysicalDeviceSurfaceCapabilitiesKHR(physical, surface, &caps);
    if (result == VK_ERROR_SURFACE_LOST_KHR) {
        vkDestroySurfaceKHR(instance, surface, nullptr);
        surface = VK_NULL_HANDLE;
        makeSurface();
        result = vkGetPhysicalDeviceSurfaceCapabilitiesKHR(physical, surface, &caps);
    }
    VK_CHECK(result);
    int width = 0, height = 0;
    glfwGetFramebufferSize(window, &width, &height);
    extent = caps.currentExtent;
    if (extent.width == kNone)
        extent = {std::clamp(static_cast<uint32_t>(width), caps.minImageExtent.width,
                             caps.maxImageExtent.width),
                  std::clamp(static_cast<uint32_t>(height), caps.minImageExtent.height,
                             caps.maxImageExtent.height)};
    if (extent.width == 0 || extent.height == 0) return;

    uint32_t count = 0;
    VK_CHECK(vkGetPhysicalDeviceSurfacePresentModesKHR(physical, surface, &count, nullptr));
    std::vector<VkPresentModeKHR> modes(count);
    VK_CHECK(vkGetPhysicalDeviceSurfacePresentModesKHR(physical, surface, &count, modes.data()));
    VkSwapchainCreateInfoKHR info{VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR};
    info.surface = surface;
    info.minImageCount = std::max(3u, caps.minImageCount);
    if (caps.maxImageCount > 0)
        info.minImageCount = std::min(info.minImageCount, caps.maxImageCount);
    info.imageFormat = format.format;
    info.imageColorSpace = format.colorSpace;
    info.imageExtent = extent;
    info.imageArrayLayers = 1;
    info.imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
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
        throwMachine("{} cannot copy pictures into this window", deviceName);
    VK_CHECK(vkCreateSwapchainKHR(device, &info, nullptr, &swapchain));
    ++swapchains;

    VK_CHECK(vkGetSwapchainImagesKHR(device, swapchain, &count, nullptr));
    images.resize(count);
    VK_CHECK(vkGetSwapchainImagesKHR(device, swapchain, &count, images.data()));
    for (VkImage image : images) {
        VkImageViewCreateInfo viewInfo{VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO};
        viewInfo.image = image;
        viewInfo.viewType = VK_IMAGE_VIEW_TYPE_2D;
        viewInfo.format = format.format;
        viewInfo.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
        VK_CHECK(vkCreateImageView(device, &viewInfo, nullptr, &views.emplace_back()));
        VkFramebufferCreateInfo framebufferInfo{VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO};
        framebufferInfo.renderPass = pass;
        framebufferInfo.attachmentCount = 1;
        framebufferInfo.pAttachments = &views.back();
        framebufferInfo.width = extent.width;
        framebufferInfo.height = extent.height;
        framebufferInfo.layers = 1;
        VK_CHECK(
            vkCreateFramebuffer(device, &framebufferInfo, nullptr, &framebuffers.emplace_back()));
        VkSemaphoreCreateInfo semaphoreInfo{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
        VK_CHECK(vkCreateSemaphore(device, &semaphoreInfo, nullptr, &drawn.emplace_back()));
    }
    stale = false;
}

void Window::Parts::reserveStaging(VkDeviceSize bytes) {
    if (bytes <= stagingBytes) return;
    vkDestroyBuffer(device, staging, nullptr);
    vkFreeMemory(device, stagingMemory, nullptr);
    staging = VK_NULL_HANDLE;
    stagingMemory = VK_NULL_HANDLE;
    stagingBytes = 0;
    VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
    info.size = bytes;
    info.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
    VK_CHECK(vkCreateBuffer(device, &info, nullptr, &staging));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device, staging, &needs);
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    constexpr VkMemoryPropertyFlags kHost =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (type < memory.memoryTypeCount &&
           (!(needs.memoryTypeBits >> type & 1) ||
            (memory.memoryTypes[type].propertyFlags & kHost) != kHost))
        ++type;
    VkMemoryAllocateInfo allocate{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
    allocate.allocationSize = needs.size;
    allocate.memoryTypeIndex = type;
    VK_CHECK(vkAllocateMemory(device, &allocate, nullptr, &stagingMemory));
    VK_CHECK(vkBindBufferMemory(device, staging, stagingMemory, 0));
    void* address = nullptr;
    VK_CHECK(vkMapMemory(device, stagingMemory, 0, VK_WHOLE_SIZE, 0, &address));
    mapped = static_cast<std::byte*>(address);
    stagingBytes = bytes;
}

void Window::Parts::measure() {
    int across = 0;
    glfwGetFramebufferSize(window, &wide, &high);
    glfwGetWindowSize(window, &across, nullptr);
    scale = across > 0 ? static_cast<double>(wide) / across : 1;
    if (glfwGetWindowAttrib(window, GLFW_ICONIFIED)) wide = high = 0;
}

void Window::Parts::waitForFrame() {
    if (!pending) return;
    pending = false;
    VkResult result = presented.get();
    if (result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_SUBOPTIMAL_KHR ||
        result == VK_ERROR_SURFACE_LOST_KHR)
        stale = true;
    else
        VK_CHECK(result);
    VK_CHECK(vkWaitForFences(device, 1, &done, VK_TRUE, UINT64_MAX));
    VK_CHECK(vkResetFences(device, 1, &done));
}

// The number of the next image; kNone where there is none this time.
uint32_t Window::Parts::acquire() {
    for (int attempt = 0; attempt < 3; ++attempt) {
        if (stale) makeSwapchain();
        if (!swapchain) return kNone;
        uint32_t image = 0;
        VkResult result =
            vkAcquireNextImageKHR(device, swapchain, UINT64_MAX, acquired, VK_NULL_HANDLE, &image);
        if (result == VK_SUCCESS) return image;
        if (result == VK_SUBOPTIMAL_KHR) {
            stale = true;  // after this frame
            return image;
        }
        if (result != VK_ERROR_OUT_OF_DATE_KHR && result != VK_ERROR_SURFACE_LOST_KHR)
            VK_CHECK(result);
        stale = true;
    }
    return kNone;
}

void Window::Parts::record(uint32_t image, std::span<const PlacedPicture> pictures) {
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    VK_CHECK(vkBeginCommandBuffer(commands, &begin));
    const VkImageSubresourceRange whole{VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    VkImageMemoryBarrier barrier{VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER};
    barrier.dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.oldLayout = VK_IMAGE_LAYOUT_UNDEFINED;
    barrier.newLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
    barrier.srcQueueFamilyIndex = barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.image = images[image];
    barrier.subresourceRange = whole;
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT,
                         0, 0, nullptr, 0, nullptr, 1, &barrier);
    uint64_t covered = 0;
    uint32_t right = 0, bottom = 0;
    for (const PlacedPicture& p : pictures) {
        covered += static_cast<uint64_t>(p.width) * static_cast<uint64_t>(p.height);
        right = std::max(right, static_cast<uint32_t>(p.x + p.width));
        bottom = std::max(bottom, static_cast<uint32_t>(p.y + p.height));
    }
    right = std::min(right, extent.width), bottom = std::min(bottom, extent.height);
    VkClearColorValue grey{{0.11f, 0.115f, 0.125f, 1}};
    // Pictures without gaps leave what is right of them and below; others anything.
    bool tiled = covered >= uint64_t{right} * bottom;
    if (!tiled) {
        vkCmdClearColorImage(commands, images[image], VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, &grey,
                             1, &whole);
        barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
        barrier.oldLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
        vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                             VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0, nullptr, 0, nullptr, 1,
                             &barrier);
    }
    VkDeviceSize offset = 0;
    for (const PlacedPicture& p : pictures) {
        // What the window no longer has room for, after it has shrunk, is left out.
        int width = std::min(p.width, static_cast<int>(extent.width) - p.x);
        int height = std::min(p.height, static_cast<int>(extent.height) - p.y);
        if (width > 0 && height > 0) {
            std::memcpy(mapped + offset, p.pixels.data(), p.pixels.size_bytes());
            VkBufferImageCopy copy{};
            copy.bufferOffset = offset;
            copy.bufferRowLength = static_cast<uint32_t>(p.width);
            copy.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
            copy.imageOffset = {p.x, p.y, 0};
            copy.imageExtent = {static_cast<uint32_t>(width), static_cast<uint32_t>(height), 1};
            vkCmdCopyBufferToImage(commands, staging, images[image],
                                   VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &copy);
        }
        offset += p.pixels.size_bytes();
    }
    VkRenderPassBeginInfo passInfo{VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO};
    passInfo.renderPass = pass;
    passInfo.framebuffer = framebuffers[image];
    passInfo.renderArea.extent = extent;
    vkCmdBeginRenderPass(commands, &passInfo, VK_SUBPASS_CONTENTS_INLINE);
    std::vector<VkClearRect> rest;
    if (tiled && right < extent.width)
        rest.push_back({{{int32_t(right), 0}, {extent.width - right, extent.height}}, 0, 1});
    if (tiled && bottom < extent.height && right > 0)
        rest.push_back({{{0, int32_t(bottom)}, {right, extent.height - bottom}}, 0, 1});
    if (!rest.empty()) {
        VkClearAttachment clear{VK_IMAGE_ASPECT_COLOR_BIT, 0, {grey}};
        vkCmdClearAttachments(commands, 1, &clear, static_cast<uint32_t>(rest.size()), rest.data());
    }
    ImGui_ImplVulkan_RenderDrawData(ImGui::GetDrawData(), commands);
    vkCmdEndRenderPass(commands);
    VK_CHECK(vkEndCommandBuffer(commands));
}

// A CPU draws the frame before this returns.
VkResult Window::Parts::present(uint32_t image) {
    VkPipelineStageFlags stage = VK_PIPELINE_STAGE_TRANSFER_BIT;
    VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
    submit.waitSemaphoreCount = 1;
    submit.pWaitSemaphores = &acquired;
    submit.pWaitDstStageMask = &stage;
    submit.commandBufferCount = 1;
    submit.pCommandBuffers = &commands;
    submit.signalSemaphoreCount = 1;
    submit.pSignalSemaphores = &drawn[image];
    VK_CHECK(vkQueueSubmit(queue, 1, &submit, done));
    VkPresentInfoKHR info{VK_STRUCTURE_TYPE_PRESENT_INFO_KHR};
    info.waitSemaphoreCount = 1;
    info.pWaitSemaphores = &drawn[image];
    info.swapchainCount = 1;
    info.pSwapchains = &swapchain;
    info.pImageIndices = &image;
    return vkQueuePresentKHR(queue, &info);
}

Window::Parts::~Parts() {
    if (presented.valid()) presented.wait();
    if (device) vkDeviceWaitIdle(device);
    if (imguiReady) {
        if (ImGui::GetIO().BackendRendererUserData) ImGui_ImplVulkan_Shutdown();
        if (ImGui::GetIO().BackendPlatformUserData) ImGui_ImplGlfw_Shutdown();
        ImGui::DestroyContext();
    }
    if (device) {
        dropSwapchain();
        vkDestroyBuffer(device, staging, nullptr);
        vkFreeMemory(device, stagingMemory, nullptr);
        vkDestroyRenderPass(device, pass, nullptr);
        vkDestroyDescriptorPool(device, descriptors, nullptr);
        vkDestroySemaphore(device, acquired, nullptr);
        vkDestroyFence(device, done, nullptr);
        vkDestroyCommandPool(device, pool, nullptr);
        vkDestroyDevice(device, nullptr);
    }
    if (surface) vkDestroySurfaceKHR(instance, surface, nullptr);
    destroyInstance(instance, messenger);
    if (window) glfwDestroyWindow(window);
    glfwTerminate();
}

Window::Window(const WindowOptions& options) : parts_(std::make_unique<Parts>()) {
    avoidWideVectors();
    parts_->openWindow(options);
    parts_->openDevice(options.device);
    parts_->chooseFormat();
    parts_->openImGui();
}

Window::~Window() = default;

bool Window::begin(double seconds) {
    Parts& p = *parts_;
    p.keys.clear();
    if (seconds > 0)
        glfwWaitEventsTimeout(seconds);
    else
        glfwPollEvents();
    p.keysNow = std::move(p.keys);
    p.keys.clear();
    p.measure();
    if (p.wide == 0 || p.high == 0) return false;
    ImGui_ImplVulkan_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    return true;
}

void Window::end(std::span<const PlacedPicture> pictures) {
    Parts& p = *parts_;
    ImGui::Render();
    p.waitForFrame();
    VkDeviceSize bytes = 0;
    for (const PlacedPicture& picture : pictures) bytes += picture.pixels.size_bytes();
    p.reserveStaging(bytes);
    uint32_t image = p.acquire();
    if (image == kNone) return;
    p.record(image, pictures);
    p.presented = std::async(std::launch::async, [&p, image] { return p.present(image); });
    p.pending = true;
}

void Window::skip() { ImGui::EndFrame(); }

bool Window::closed() const { return glfwWindowShouldClose(parts_->window); }
void Window::close() { glfwSetWindowShouldClose(parts_->window, GLFW_TRUE); }

int Window::width() const { return parts_->wide; }
int Window::height() const { return parts_->high; }
double Window::scale() const { return parts_->scale; }

bool Window::blueFirst() const { return parts_->format.format == VK_FORMAT_B8G8R8A8_UNORM; }
const std::vector<KeyPress>& Window::keys() const { return parts_->keysNow; }
void Window::setTitle(const std::string& title) {
    glfwSetWindowTitle(parts_->window, title.c_str());
}
std::string Window::clipboard() const {
    const char* text = glfwGetClipboardString(parts_->window);
    return text ? text : "";
}
void Window::setClipboard(const std::string& text) {
    glfwSetClipboardString(parts_->window, text.c_str());
}
std::vector<std::filesystem::path> Window::dropped() { return std::exchange(parts_->dropped, {}); }
const std::string& Window::deviceName() const { return parts_->deviceName; }
int Window::swapchainCount() const { return parts_->swapchains; }
void Window::loseSwapchain() { parts_->stale = true; }

}  // namespace doppel
