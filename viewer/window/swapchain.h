// Brings frames onto a window's surface. The device that composed them presents them, where it can;
// else a device of its own, which only copies and presents what the host has composed.
//
// It draws nothing, so no shader is compiled: Mesa 25's lavapipe crashes when it compiles fragment
// shaders for vectors of 512 bits, which the networks like best.
#pragma once

#include <functional>
#include <future>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "engine/device.h"
#include "viewer/window/frame.h"

namespace doppel {

// What it asks of the window.
struct SurfaceSource {
    std::span<const char* const> extensions;  // of the instance
    std::function<VkResult(VkInstance, VkSurfaceKHR*)> makeSurface;
    std::function<VkExtent2D()> size;  // framebuffer pixels; 0 where it has none
};

class Swapchain {
public:
    // composing: the device that composes frames, which outlives this, if its queue presents to the
    // window; null: the host does. wanted: part of the name of the device that else should present;
    // empty: any. MachineError where none can.
    Swapchain(SurfaceSource source, Device* composing, const std::string& wanted);
    ~Swapchain();
    Swapchain(const Swapchain&) = delete;
    Swapchain& operator=(const Swapchain&) = delete;

    // The device that composes; null: the host.
    Device* composing() const { return composing_; }

    // Waits for the frame before, and throws what went wrong with it. False where the window has no
    // pixels.
    bool next();
    int width() const { return static_cast<int>(extent_.width); }
    int height() const { return static_cast<int>(extent_.height); }
    // Where the host composes the next frame; what is there already is of another one.
    Canvas canvas();
    // Brings that frame to the screen, or one [height,width] that the device composes. A thread
    // does it: a CPU takes milliseconds, in which the frame after begins.
    void present(const Buffer* composed = nullptr);

    bool blueFirst() const { return format_.format == VK_FORMAT_B8G8R8A8_UNORM; }
    // How often it was made anew.
    int count() const { return count_; }
    // The next frame makes it anew, for the window's size has changed.
    void lose() { stale_ = true; }

private:
    bool share(Device& device);
    void makeSurface();
    void chooseDevice(const std::string& wanted);
    bool chooseFormat();
    void makeDevice();
    void makeCommands();
    void make();
    void drop();
    bool acquire();
    void reserve(VkDeviceSize bytes);
    void release();
    void waitForFrame();
    VkResult submit();

    SurfaceSource source_;
    Device* composing_ = nullptr;  // whose instance, device and queue these are; null: own ones
    VkInstance instance_ = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
    VkSurfaceKHR surface_ = VK_NULL_HANDLE;
    VkPhysicalDevice physical_ = VK_NULL_HANDLE;
    uint32_t family_ = 0;
    std::string deviceName_;
    VkDevice device_ = VK_NULL_HANDLE;
    VkQueue queue_ = VK_NULL_HANDLE;
    std::mutex ownQueue_;
    std::mutex* queueMutex_ = &ownQueue_;
    VkCommandPool pool_ = VK_NULL_HANDLE;
    VkCommandBuffer commands_ = VK_NULL_HANDLE;
    VkFence done_ = VK_NULL_HANDLE;
    VkSemaphore acquired_ = VK_NULL_HANDLE;

    VkSurfaceFormatKHR format_{};
    VkSwapchainKHR swapchain_ = VK_NULL_HANDLE;
    VkExtent2D extent_{};
    std::vector<VkImage> images_;
    std::vector<VkSemaphore> copied_;  // per image: what presenting it waits for
    bool stale_ = true;                // it has to be made anew
    int count_ = 0;

    VkBuffer staging_ = VK_NULL_HANDLE;
    VkDeviceMemory stagingMemory_ = VK_NULL_HANDLE;
    VkDeviceSize stagingBytes_ = 0;
    uint32_t* mapped_ = nullptr;

    uint32_t image_ = 0;             // that is being presented
    std::future<VkResult> sending_;  // of that image
};

}  // namespace doppel
