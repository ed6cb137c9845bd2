#include "engine/buffer.h"

namespace doppel {

Buffer& Buffer::operator=(Buffer&& other) noexcept {
    std::swap(device_, other.device_);
    std::swap(buffer_, other.buffer_);
    std::swap(memory_, other.memory_);
    std::swap(bytes_, other.bytes_);
    std::swap(address_, other.address_);
    std::swap(mapped_, other.mapped_);
    std::swap(share_, other.share_);
    return *this;
}

Buffer::~Buffer() {
    if (device_ == VK_NULL_HANDLE) return;
    vkDestroyBuffer(device_, buffer_, nullptr);
    vkFreeMemory(device_, memory_, nullptr);
}

}  // namespace doppel
