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
// In as many rows as that at least, or one per workgroup, so that it can be cut.
Groups linearGroups(uint64_t invocations, uint32_t localSize, uint32_t leastRows = 1);

class Recorder {
public:
    explicit Recorder(Device& device);
    ~Recorder();
    Recorder(const Recorder&) = delete;
    Recorder& operator=(const Recorder&) = delete;

    // A desktop resets a GPU that works on one submission for longer than about two seconds, so
    // that a recording goes to the device in several, none of which takes longer than
    // Device::secondsPerSubmit() even on a slow integrated GPU. On a CPU it stays whole.
    struct Work {
        double flops = 0, bytes = 0;
    };
    // Of what is recorded next: what was recorded so far becomes a submission if the two are too
    // long together.
    void expect(const Work& work);
    // How many submissions it takes.
    uint32_t pieces(const Work& work) const;

    // The kernel must be given exactly the buffers that it uses, and parameters of 128 bytes at
    // most, addresses included. pieces: the dispatch is cut into that many submissions, or fewer
    // where its workgroups cannot be counted that way.
    void dispatch(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                  std::span<const std::byte> params, Groups groups, uint32_t pieces = 1);
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

    size_t submissionCount() const { return submissions_.size(); }
    // Nanoseconds of each timestamp of the finished submission.
    std::vector<double> timestamps();

    static constexpr uint32_t kMaxTimestamps = 8192;

private:
    // All of a dispatch but its start; accesses: those besides the buffers'.
    void bind(const Kernel& kernel, std::span<const BoundBuffer> buffers,
              std::span<const std::byte> params, std::vector<Access> accesses);
    void beginSubmission();
    // For descriptors: views that begin where no descriptor can are copied into buffers of their
    // own, and back after the dispatch (storageAlignment of the device).
    struct Moved {
        BufferView view, copy;
        bool written = false;
    };
    std::vector<Moved> moveUnaligned(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                                     std::vector<BoundBuffer>& bound);
    void moveBack(const std::vector<Moved>& moved);
    void barrierFor(const std::vector<Access>& accesses);
    VkDescriptorSet descriptorSet(const Kernel& kernel, std::span<const BufferView> slots);
    VkBufferView texelView(const BufferView& view, const std::string& kernel,
                           const std::string& buffer);

    Device& device_;
    std::vector<VkCommandBuffer> submissions_;
    VkCommandBuffer commands_ = VK_NULL_HANDLE;  // the last of them
    double seconds_ = 0;                         // that it may take
    VkFence fence_ = VK_NULL_HANDLE;
    VkQueryPool queries_ = VK_NULL_HANDLE;
    uint32_t timestampCount_ = 0;
    std::vector<VkDescriptorPool> descriptorPools_;
    uint32_t setsLeft_ = 0;
    // By buffer, offset and bytes.
    std::map<std::tuple<VkBuffer, uint64_t, uint64_t>, VkBufferView> texelViews_;
    std::vector<Buffer> aligned_;  // that views are copied into; the newest of each place is used
    std::vector<size_t> alignedAt_;
    HazardTracker hazards_;
    bool pending_ = false;
};

}  // namespace doppel
