// Device memory: a buffer owns it, a view is a range of one.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "engine/vulkan.h"

namespace doppel {

enum class Memory {
    Device,    // where kernels work; mapped as well when the device shares the host's memory
    Upload,    // written by the host, copied from
    Readback,  // copied to, read by the host
};

// Of one device, counted by its buffers.
struct MemoryInUse {
    std::atomic<uint64_t> deviceBytes = 0;  // of Memory::Device
    std::atomic<uint32_t> allocations = 0;
};
// One allocation's part of it.
class MemoryShare {
public:
    MemoryShare() = default;
    MemoryShare(std::shared_ptr<MemoryInUse> whole, uint64_t deviceBytes)
        : whole_(std::move(whole)), deviceBytes_(deviceBytes) {
        whole_->deviceBytes += deviceBytes_;
        ++whole_->allocations;
    }
    MemoryShare(MemoryShare&& other) noexcept { *this = std::move(other); }
    MemoryShare& operator=(MemoryShare&& other) noexcept {
        std::swap(whole_, other.whole_);
        std::swap(deviceBytes_, other.deviceBytes_);
        return *this;
    }
    ~MemoryShare() {
        if (!whole_) return;
        whole_->deviceBytes -= deviceBytes_;
        --whole_->allocations;
    }

private:
    std::shared_ptr<MemoryInUse> whole_;
    uint64_t deviceBytes_ = 0;
};

class Buffer {
public:
    Buffer() = default;
    Buffer(VkDevice device, VkBuffer buffer, VkDeviceMemory memory, uint64_t bytes,
           uint64_t address, std::byte* mapped, MemoryShare share)
        : device_(device),
          buffer_(buffer),
          memory_(memory),
          bytes_(bytes),
          address_(address),
          mapped_(mapped),
          share_(std::move(share)) {}
    Buffer(Buffer&& other) noexcept { *this = std::move(other); }
    Buffer& operator=(Buffer&& other) noexcept;
    ~Buffer();

    VkBuffer handle() const { return buffer_; }
    uint64_t bytes() const { return bytes_; }
    // Unique among buffers; where the device has no buffer addresses it only tells ranges apart.
    uint64_t address() const { return address_; }
    std::byte* mapped() const { return mapped_; }  // null when the host cannot see it
    explicit operator bool() const { return buffer_ != VK_NULL_HANDLE; }

private:
    VkDevice device_ = VK_NULL_HANDLE;
    VkBuffer buffer_ = VK_NULL_HANDLE;
    VkDeviceMemory memory_ = VK_NULL_HANDLE;
    uint64_t bytes_ = 0, address_ = 0;
    std::byte* mapped_ = nullptr;
    MemoryShare share_;
};

// A range of a buffer that outlives it.
struct BufferView {
    const Buffer* buffer = nullptr;
    uint64_t offset = 0;  // bytes, a multiple of 16 where a kernel is given it
    uint64_t bytes = 0;

    uint64_t address() const { return buffer->address() + offset; }
    std::byte* mapped() const { return buffer->mapped() ? buffer->mapped() + offset : nullptr; }
};

constexpr uint64_t kBufferAlignment = 256;  // of every tensor; covers all devices' offset limits
constexpr uint64_t alignUp(uint64_t bytes, uint64_t alignment) {
    return (bytes + alignment - 1) / alignment * alignment;
}

}  // namespace doppel
