#include "engine/instance.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>

namespace doppel {

namespace {

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

std::mutex messageMutex;
std::vector<std::string> messages;

VKAPI_ATTR VkBool32 VKAPI_CALL onMessage(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                         VkDebugUtilsMessageTypeFlagsEXT,
                                         const VkDebugUtilsMessengerCallbackDataEXT* data, void*) {
    std::lock_guard lock(messageMutex);
    messages.emplace_back(data->pMessage);
    fmt::print(stderr, "validation: {}\n", data->pMessage);
    return VK_FALSE;
}

bool isAmong(std::string_view name, std::span<const VkExtensionProperties> extensions) {
    return std::ranges::any_of(extensions, [&](const VkExtensionProperties& extension) {
        return name == extension.extensionName;
    });
}

}  // namespace

void separateShaderCaches() {
    namespace fs = std::filesystem;
    const char* width = std::getenv("LP_NATIVE_VECTOR_WIDTH");
    if (!width || !*width || std::string_view(width).find('/') != std::string_view::npos) return;
    fs::path folder;
    if (const char* set = std::getenv("MESA_SHADER_CACHE_DIR"); set && *set)
        folder = set;
    else if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache && *cache)
        folder = fs::path(cache) / "doppel";
    else if (const char* home = std::getenv("HOME"); home && *home)
        folder = fs::path(home) / ".cache" / "doppel";
    else
        return;
    const std::string ending = "-bit-vectors";
    if (folder.filename().string().ends_with(ending)) folder = folder.parent_path();  // a parent's
    folder /= width + ending;
    if (const char* set = std::getenv("MESA_SHADER_CACHE_DIR"); set && folder == set) return;
    std::error_code ignored;  // without the folder Mesa does without a cache
    fs::create_directories(folder, ignored);
    setenv("MESA_SHADER_CACHE_DIR", folder.c_str(), 1);
}

bool validationWanted() {
    const char* set = std::getenv("DOPPEL_VALIDATION");
    return set && std::string_view(set) == "1";
}

bool validationKnowsMatrices() {
    uint32_t count = 0;
    VK_CHECK(vkEnumerateInstanceLayerProperties(&count, nullptr));
    std::vector<VkLayerProperties> layers(count);
    if (count > 0) VK_CHECK(vkEnumerateInstanceLayerProperties(&count, layers.data()));
    return std::ranges::any_of(layers, [](const VkLayerProperties& layer) {
        return std::string_view(layer.layerName) == kValidationLayer &&
               layer.specVersion >= VK_MAKE_API_VERSION(0, 1, 3, 255);
    });
}

std::vector<std::string> validationMessages() {
    std::lock_guard lock(messageMutex);
    return messages;
}

VkInstance createInstance(bool validation, std::span<const char* const> extensions) {
    VkApplicationInfo application{VK_STRUCTURE_TYPE_APPLICATION_INFO};
    application.pApplicationName = "doppel";
    application.apiVersion = VK_API_VERSION_1_2;
    VkInstanceCreateInfo info{VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO};
    info.pApplicationInfo = &application;

    std::vector<const char*> wanted(extensions.begin(), extensions.end());
    VkValidationFeatureEnableEXT enabled[] = {
        VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT};
    VkValidationFeaturesEXT features{VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT};
    features.enabledValidationFeatureCount = 1;
    features.pEnabledValidationFeatures = enabled;
    if (validation) {
        info.enabledLayerCount = 1;
        info.ppEnabledLayerNames = &kValidationLayer;
        info.pNext = &features;
        wanted.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    }
    info.enabledExtensionCount = static_cast<uint32_t>(wanted.size());
    info.ppEnabledExtensionNames = wanted.data();
    VkInstance instance = VK_NULL_HANDLE;
    VkResult result = vkCreateInstance(&info, nullptr, &instance);
    if (result == VK_ERROR_LAYER_NOT_PRESENT)
        throwMachine("validation was asked for, but {} is not installed", kValidationLayer);
    if (result == VK_ERROR_INCOMPATIBLE_DRIVER)
        throwMachine(
            "no Vulkan driver found; install one (for a CPU: Mesa's lavapipe) or point "
            "VK_DRIVER_FILES at it");
    if (result == VK_ERROR_EXTENSION_NOT_PRESENT)
        throwMachine("the Vulkan driver cannot draw into windows of this system");
    VK_CHECK(result);
    return instance;
}

bool instancesHave(std::span<const char* const> extensions) {
    uint32_t count = 0;
    VK_CHECK(vkEnumerateInstanceExtensionProperties(nullptr, &count, nullptr));
    std::vector<VkExtensionProperties> there(count);
    VK_CHECK(vkEnumerateInstanceExtensionProperties(nullptr, &count, there.data()));
    return std::ranges::all_of(extensions,
                               [&](const char* wanted) { return isAmong(wanted, there); });
}

VkDebugUtilsMessengerEXT createMessenger(VkInstance instance) {
    VkDebugUtilsMessengerCreateInfoEXT info{
        VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT};
    info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                           VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT |
                       VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT;
    info.pfnUserCallback = onMessage;
    auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
        vkGetInstanceProcAddr(instance, "vkCreateDebugUtilsMessengerEXT"));
    VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
    VK_CHECK(create(instance, &info, nullptr, &messenger));
    return messenger;
}

void destroyInstance(VkInstance instance, VkDebugUtilsMessengerEXT messenger) {
    if (messenger) {
        auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
            vkGetInstanceProcAddr(instance, "vkDestroyDebugUtilsMessengerEXT"));
        destroy(instance, messenger, nullptr);
    }
    if (instance) vkDestroyInstance(instance, nullptr);
}

std::vector<VkPhysicalDevice> physicalDevices(VkInstance instance) {
    uint32_t count = 0;
    VK_CHECK(vkEnumeratePhysicalDevices(instance, &count, nullptr));
    std::vector<VkPhysicalDevice> devices(count);
    if (count > 0) VK_CHECK(vkEnumeratePhysicalDevices(instance, &count, devices.data()));
    devices.resize(count);
    return devices;
}

bool hasExtension(VkPhysicalDevice physical, std::string_view name) {
    uint32_t count = 0;
    vkEnumerateDeviceExtensionProperties(physical, nullptr, &count, nullptr);
    std::vector<VkExtensionProperties> extensions(count);
    vkEnumerateDeviceExtensionProperties(physical, nullptr, &count, extensions.data());
    return isAmong(name, extensions);
}

}  // namespace doppel
