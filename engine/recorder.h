// Records dispatches, copies and fills into a command buffer and places the barriers itself.
#pragma once

#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "engine/device.h"
#include "engine/hazards.h"

namespace doppel {

struct BoundBuffer {
    std::string_view name;  // as the shader calls it
    BufferView view;
};

// Workgroups of a dispatch.
struct Groups {
    uint32_t x = 1, y = 1, z = 1;
};
// Enough workgroups for this many invocations, folded as linearIndex() expects.
Groups linearGroups(uint64_t invocations, uint32_t localSize);

class Recorder {
public:
    explicit Recorder(Device& device);
    ~Recorder();
    Recorder(const Recorder&) = delete;
    Recorder& operator=(const Recorder&) = delete;

    // The kernel must be given exactly the buffers that it uses, and parameters of 128 bytes at
    // most, addresses included.
    void dispatch(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                  std::span<const std::byte> params, Groups groups);
    // With as many workgroups as `groups` [3] of 32 bits says when the recording is replayed.
    void dispatchIndirect(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                          std::span<const std::byte> params, const BufferView& groups);
    void copy(const BufferView& source, const BufferView& target);
    void fill(const BufferView& target, uint32_t word);
    // Notes the time when all earlier work is done.
    void timestamp();

    // Ends the recording; it can then be replayed any number of times, one at a time.
    void finish();
    void submit();  // does not wait
    void wait();    // for the last submission
    bool pending() const { return pending_; }

    size_t barrierCount() const { return barriers_; }
    // Nanoseconds of each timestamp of the finished submission.
    std::vector<double> timestamps();

    static constexpr uint32_t kMaxTimestamps = 8192;

private:
    // All of a dispatch but its start; accesses: those besides the buffers'.
    void bind(const Kernel& kernel, std::span<const BoundBuffer> buffers,
              std::span<const std::byte> params, std::vector<Access> accesses);
    void barrierFor(const std::vector<Access>& accesses);
    VkDescriptorSet descriptorSet(const Kernel& kernel, std::span<const BufferView> slots);
    VkBufferView texelView(const BufferView& view, const std::string& kernel,
                           const std::string& buffer);

    Device& device_;
    VkCommandBuffer commands_ = VK_NULL_HANDLE;
    VkFence fence_ = VK_NULL_HANDLE;
    VkQueryPool queries_ = VK_NULL_HANDLE;
    uint32_t timestampCount_ = 0;
    std::vector<VkDescriptorPool> descriptorPools_;
    uint32_t setsLeft_ = 0;
    // By buffer, offset and bytes.
    std::map<std::tuple<VkBuffer, uint64_t, uint64_t>, VkBufferView> texelViews_;
    HazardTracker hazards_;
    size_t barriers_ = 0;
    bool pending_ = false;
};

}  // namespace doppel
