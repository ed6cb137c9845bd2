// One Vulkan device with one compute queue: memory, kernels, submission.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/buffer.h"
#include "engine/device_info.h"
#include "engine/kernel.h"
#include "engine/vulkan.h"

namespace doppel {

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
    // A file of another device's limits, which then hold for this one (engine/device_info.h);
    // empty: DOPPEL_DEVICE_LIMITS names one, or there is none.
    std::filesystem::path limits;
    // That a submission may take on a slow GPU, see Recorder::expect(): half of what desktops
    // allow.
    double secondsPerSubmit = 1;
    // What a window's surface asks of the instance: where all of it is there, the device can have
    // swapchains, see Device::hasSwapchains(). Empty: it shows nothing itself.
    std::vector<const char*> surfaceExtensions;
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
    double secondsPerSubmit() const { return secondsPerSubmit_; }
    VkDevice handle() const { return device_; }
    double timestampPeriodNanoseconds() const { return timestampPeriod_; }

    // For a swapchain on this device, where VK_KHR_swapchain is switched on; whether its queue
    // presents to a surface, the surface says.
    bool hasSwapchains() const { return hasSwapchains_; }
    VkInstance instance() const { return instance_; }
    VkPhysicalDevice physical() const { return physical_; }
    VkQueue queue() const { return queue_; }
    uint32_t queueFamily() const { return queueFamily_; }
    // Whoever presents in another thread than the one that computes, holds this while it uses the
    // queue, as submit() does.
    std::mutex& queueMutex() { return queueMutex_; }

    // A buffer of its own; throws MachineError with the size when memory runs out, or a limit of
    // the device is reached.
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
    // One after the other; the fence is of the last.
    void submit(std::span<const VkCommandBuffer> commands, VkFence fence);
    void wait(VkFence fence);
    // How often submit() was called.
    uint64_t submissions() const { return submissions_; }
    // Records transfers with the given function, submits, waits.
    void runOnce(const std::function<void(VkCommandBuffer)>& record);

private:
    void destroy();
    std::vector<uint32_t> memoryTypes(uint32_t allowed, Memory memory) const;

    VkInstance instance_ = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
    VkPhysicalDevice physical_ = VK_NULL_HANDLE;
    VkDevice device_ = VK_NULL_HANDLE;
    VkQueue queue_ = VK_NULL_HANDLE;
    uint32_t queueFamily_ = 0;
    std::mutex queueMutex_;
    bool hasSwapchains_ = false;
    VkCommandPool pool_ = VK_NULL_HANDLE;
    VkPipelineCache pipelineCache_ = VK_NULL_HANDLE;
    VkPhysicalDeviceMemoryProperties memory_{};
    std::shared_ptr<MemoryInUse> memoryInUse_ = std::make_shared<MemoryInUse>();
    DeviceInfo info_;
    Binding binding_ = Binding::Addresses;
    Precision precision_ = Precision::Single;
    std::optional<MatrixShape> matrixUnits_;
    double timestampPeriod_ = 1, secondsPerSubmit_ = 1;
    uint64_t submissions_ = 0;
    std::map<std::pair<std::string, Specialisation>, std::unique_ptr<Kernel>, std::less<>> kernels_;
};

}  // namespace doppel
