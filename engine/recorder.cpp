#include "engine/recorder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "engine/kernel_log.h"

namespace doppel {

namespace {

Access accessOf(const BufferView& view, bool reads, bool writes) {
    return {view.address(), view.address() + view.bytes, reads, writes};
}

// No descriptor can describe an empty view: the beginning of its buffer stands in, in which a
// kernel without elements touches nothing. Buffers have 16 bytes at least.
BufferView described(const BufferView& view) {
    return view.bytes > 0 ? view : BufferView{view.buffer, 0, 16};
}

// Kernels, copies and fills, and the numbers of workgroups that indirect dispatches read.
constexpr VkPipelineStageFlags kStages = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT |
                                         VK_PIPELINE_STAGE_TRANSFER_BIT |
                                         VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT;

// On an integrated GPU of 0.3 TFLOP/s and 20 GB/s whose kernels reach half of both.
double secondsOf(const Recorder::Work& work) { return work.flops / 0.15e12 + work.bytes / 10e9; }

constexpr uint32_t kSetsPerPool = 256, kBuffersPerSet = 16;

}  // namespace

Groups linearGroups(uint64_t invocations, uint32_t localSize, uint32_t leastRows) {
    constexpr uint64_t kMax = 65535;
    uint64_t groups = std::max<uint64_t>(1, (invocations + localSize - 1) / localSize);
    uint64_t rows = std::max((groups + kMax - 1) / kMax, std::min<uint64_t>(leastRows, groups));
    uint64_t columns = (groups + rows - 1) / rows;
    CHECK(rows <= kMax, "{} invocations fit into one dispatch", invocations);
    return {static_cast<uint32_t>(columns), static_cast<uint32_t>(rows), 1};
}

Recorder::Recorder(Device& device) : device_(device) {
    fence_ = device.newFence();
    beginSubmission();
}

// Barriers reach over submissions to one queue, so that hazards go on.
void Recorder::beginSubmission() {
    if (commands_) VK_CHECK(vkEndCommandBuffer(commands_));
    commands_ = submissions_.emplace_back(device_.newCommandBuffer());
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VK_CHECK(vkBeginCommandBuffer(commands_, &begin));
    seconds_ = 0;
}

uint32_t Recorder::pieces(const Work& work) const {
    if (device_.kernelPath().onCpu) return 1;
    return static_cast<uint32_t>(
        std::clamp(std::ceil(secondsOf(work) / device_.secondsPerSubmit()), 1.0, 1e6));
}

void Recorder::expect(const Work& work) {
    if (device_.kernelPath().onCpu) return;
    const double seconds = secondsOf(work);
    if (seconds_ > 0 && seconds_ + seconds > device_.secondsPerSubmit()) beginSubmission();
    seconds_ += seconds;
}

Recorder::~Recorder() {
    if (pending_) vkWaitForFences(device_.handle(), 1, &fence_, VK_TRUE, UINT64_MAX);
    for (const auto& [where, view] : texelViews_)
        vkDestroyBufferView(device_.handle(), view, nullptr);
    for (VkDescriptorPool pool : descriptorPools_)
        vkDestroyDescriptorPool(device_.handle(), pool, nullptr);
    vkDestroyQueryPool(device_.handle(), queries_, nullptr);
    vkDestroyFence(device_.handle(), fence_, nullptr);
    for (VkCommandBuffer commands : submissions_) device_.freeCommandBuffer(commands);
}

void Recorder::barrierFor(const std::vector<Access>& accesses) {
    if (hazards_.needsBarrier(accesses)) {
        VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
        barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_SHADER_READ_BIT |
                                VK_ACCESS_TRANSFER_WRITE_BIT | VK_ACCESS_TRANSFER_READ_BIT;
        barrier.dstAccessMask = barrier.srcAccessMask | VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
        vkCmdPipelineBarrier(commands_, kStages, kStages, 0, 1, &barrier, 0, nullptr, 0, nullptr);
        hazards_.clear();
    }
    hazards_.add(accesses);
}

VkDescriptorSet Recorder::descriptorSet(const Kernel& kernel, std::span<const BufferView> slots) {
    if (setsLeft_ == 0) {
        const VkDescriptorPoolSize sizes[] = {
            {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, kSetsPerPool * kBuffersPerSet},
            {VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, kSetsPerPool * kBuffersPerSet}};
        VkDescriptorPoolCreateInfo info{VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO};
        info.maxSets = kSetsPerPool;
        info.poolSizeCount = static_cast<uint32_t>(std::size(sizes));
        info.pPoolSizes = sizes;
        VK_CHECK(vkCreateDescriptorPool(device_.handle(), &info, nullptr,
                                        &descriptorPools_.emplace_back()));
        setsLeft_ = kSetsPerPool;
    }
    --setsLeft_;
    VkDescriptorSetLayout layout = kernel.setLayout();
    VkDescriptorSetAllocateInfo info{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO};
    info.descriptorPool = descriptorPools_.back();
    info.descriptorSetCount = 1;
    info.pSetLayouts = &layout;
    VkDescriptorSet set = VK_NULL_HANDLE;
    VK_CHECK(vkAllocateDescriptorSets(device_.handle(), &info, &set));

    const auto& used = kernel.reflection().buffers;
    CHECK(used.size() <= kBuffersPerSet, "{} uses at most {} buffers", kernel.name(),
          kBuffersPerSet);
    std::array<VkDescriptorBufferInfo, kBuffersPerSet> buffers;
    std::array<VkBufferView, kBuffersPerSet> texels;
    std::vector<VkWriteDescriptorSet> writes;
    for (size_t i = 0; i < used.size(); ++i) {
        const BufferView& view = slots[used[i].slot];
        VkWriteDescriptorSet write{VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET};
        write.dstSet = set;
        write.dstBinding = used[i].slot;
        write.descriptorCount = 1;
        if (used[i].texels) {
            texels[i] = texelView(view, kernel.name(), used[i].name);
            write.descriptorType = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
            write.pTexelBufferView = &texels[i];
            writes.push_back(write);
            continue;
        }
        if (device_.binding() == Binding::Addresses) continue;
        if (view.bytes > device_.info().maxStorageBufferBytes)
            throwMachine(
                "buffer {} of kernel {} has {} bytes; this device's descriptors reach {} "
                "(a device with buffer addresses has no such limit)",
                used[i].name, kernel.name(), view.bytes, device_.info().maxStorageBufferBytes);
        // Up to where padding ends: pairs of elements may reach into it.
        buffers[i] = {view.buffer->handle(), view.offset, alignUp(view.bytes, 16)};
        write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        write.pBufferInfo = &buffers[i];
        writes.push_back(write);
    }
    vkUpdateDescriptorSets(device_.handle(), static_cast<uint32_t>(writes.size()), writes.data(), 0,
                           nullptr);
    return set;
}

VkBufferView Recorder::texelView(const BufferView& view, const std::string& kernel,
                                 const std::string& buffer) {
    CHECK(device_.kernelPath().texels, "{} runs on devices that read texels", kernel);
    if (view.bytes / 16 >= device_.info().maxTexels)
        throwMachine(
            "buffer {} of kernel {} has {} bytes; this device's texel buffers reach {}: use a "
            "smaller preset or batch",
            buffer, kernel, view.bytes, 16 * device_.info().maxTexels);
    VkBufferView& texels = texelViews_[{view.buffer->handle(), view.offset, view.bytes}];
    if (texels == VK_NULL_HANDLE) {
        VkBufferViewCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO};
        info.buffer = view.buffer->handle();
        info.format = VK_FORMAT_R32G32B32A32_SFLOAT;
        info.offset = view.offset;
        info.range = alignUp(view.bytes, 16);
        VK_CHECK(vkCreateBufferView(device_.handle(), &info, nullptr, &texels));
    }
    return texels;
}

void Recorder::dispatch(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                        std::span<const std::byte> params, Groups groups, uint32_t pieces) {
    const auto& most = device_.info().maxWorkgroups;
    if (groups.x > most[0] || groups.y > most[1] || groups.z > most[2])
        throwMachine(
            "kernel {} needs {} x {} x {} workgroups; {} takes {} x {} x {}: use a smaller preset "
            "or batch",
            kernel.name(), groups.x, groups.y, groups.z, device_.info().name, most[0], most[1],
            most[2]);
    std::vector<BoundBuffer> bound(buffers.begin(), buffers.end());
    const std::vector<Moved> moved = moveUnaligned(kernel, buffers, bound);
    bind(kernel, bound, params, {});
    // Along the longest axis whose workgroups the kernel does not count.
    std::array<uint32_t, 3> count{groups.x, groups.y, groups.z};
    size_t axis = 3;
    for (size_t a = 0; a < 3; ++a)
        if (!kernel.reflection().countsWorkgroups[a] && count[a] > 1 &&
            (axis == 3 || count[a] > count[axis]))
            axis = a;
    if (pieces <= 1 || axis == 3) {
        vkCmdDispatch(commands_, groups.x, groups.y, groups.z);
        moveBack(moved);
        return;
    }
    const uint32_t all = count[axis], each = (all + pieces - 1) / pieces;
    for (uint32_t first = 0; first < all; first += each) {
        if (first > 0) {
            beginSubmission();
            seconds_ = device_.secondsPerSubmit();
            bind(kernel, bound, params, {});
        }
        std::array<uint32_t, 3> base{};
        base[axis] = first;
        count[axis] = std::min(each, all - first);
        vkCmdDispatchBase(commands_, base[0], base[1], base[2], count[0], count[1], count[2]);
    }
    moveBack(moved);
}

void Recorder::dispatchIndirect(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                                std::span<const std::byte> params, const BufferView& groups) {
    CHECK(groups.buffer && groups.bytes >= 12 && groups.offset % 4 == 0,
          "{}: three numbers say how many workgroups", kernel.name());
    std::vector<BoundBuffer> bound(buffers.begin(), buffers.end());
    const std::vector<Moved> moved = moveUnaligned(kernel, buffers, bound);
    bind(kernel, bound, params, {accessOf(groups, true, false)});
    vkCmdDispatchIndirect(commands_, groups.buffer->handle(), groups.offset);
    moveBack(moved);
}

std::vector<Recorder::Moved> Recorder::moveUnaligned(const Kernel& kernel,
                                                     std::span<const BoundBuffer> buffers,
                                                     std::vector<BoundBuffer>& bound) {
    std::vector<Moved> moved;
    const uint64_t alignment = device_.info().storageAlignment;
    if (device_.binding() == Binding::Addresses) return moved;
    auto writes = [&](const BoundBuffer& buffer) {
        auto used =
            std::ranges::find(kernel.reflection().buffers, buffer.name, &KernelBuffer::name);
        return used != kernel.reflection().buffers.end() && used->writes;
    };
    for (size_t i = 0; i < buffers.size(); ++i) {
        const BufferView& view = buffers[i].view;
        if (view.bytes == 0 || view.offset % alignment == 0) continue;
        // One copy of what a kernel is given under several names.
        auto same = std::ranges::find_if(moved, [&](const Moved& m) {
            return m.view.buffer == view.buffer && m.view.offset == view.offset &&
                   m.view.bytes == view.bytes;
        });
        for (const BoundBuffer& other : buffers) {
            const bool apart = other.view.buffer != view.buffer ||
                               other.view.offset + other.view.bytes <= view.offset ||
                               view.offset + view.bytes <= other.view.offset;
            const bool equal = other.view.offset == view.offset && other.view.bytes == view.bytes;
            if (!apart && !equal && (writes(other) || writes(buffers[i])))
                throwMachine(
                    "kernel {} writes a part of its buffer {} from byte {}; descriptors of {} "
                    "begin at multiples of {}",
                    kernel.name(), buffers[i].name, view.offset, device_.info().name, alignment);
        }
        if (same == moved.end()) {
            const size_t place = moved.size();
            if (place == alignedAt_.size()) alignedAt_.push_back(aligned_.size());
            size_t& at = alignedAt_[place];
            if (at == aligned_.size() || aligned_[at].bytes() < view.bytes) {
                at = aligned_.size();  // the old one stays for what is recorded already
                aligned_.push_back(device_.allocate(view.bytes, Memory::Device));
            }
            moved.push_back({view, {nullptr, at, view.bytes}, false});
            same = std::prev(moved.end());
        }
        same->written |= writes(buffers[i]);
        bound[i].view = same->copy;
    }
    // aligned_ moves no more.
    for (Moved& m : moved) {
        const BufferView copied{&aligned_[m.copy.offset], 0, m.copy.bytes};
        for (BoundBuffer& buffer : bound)
            if (!buffer.view.buffer && buffer.view.offset == m.copy.offset) buffer.view = copied;
        m.copy = copied;
        copy(m.view, m.copy);
    }
    return moved;
}

void Recorder::moveBack(const std::vector<Moved>& moved) {
    for (const Moved& m : moved)
        if (m.written) copy(m.copy, m.view);
}

void Recorder::bind(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                    std::span<const std::byte> params, std::vector<Access> accesses) {
    const Reflection& reflection = kernel.reflection();
    std::vector<BufferView> slots(reflection.slotCount);
    for (const KernelBuffer& wanted : reflection.buffers) {
        auto given = std::ranges::find(buffers, std::string_view(wanted.name), &BoundBuffer::name);
        CHECK(given != buffers.end(), "{} is given its buffer {}", kernel.name(), wanted.name);
        CHECK(given->view.offset % 16 == 0, "{} of {} starts at a multiple of 16 bytes",
              wanted.name, kernel.name());
        slots[wanted.slot] = described(given->view);
        accesses.push_back(accessOf(slots[wanted.slot], wanted.reads, wanted.writes));
    }
    // A variant of a kernel may read or write memory by another name: in pairs, or as texels.
    auto uses = [&](const BoundBuffer& given) {
        return std::ranges::any_of(reflection.buffers, [&](const KernelBuffer& buffer) {
            return buffer.name == given.name;
        });
    };
    for (const BoundBuffer& given : buffers)
        CHECK(std::ranges::any_of(buffers,
                                  [&](const BoundBuffer& other) {
                                      return uses(other) &&
                                             other.view.buffer == given.view.buffer &&
                                             other.view.offset == given.view.offset;
                                  }),
              "{} uses the memory of {} that it is given", kernel.name(), given.name);
    barrierFor(accesses);
    noteKernel(kernel.name(), device_.binding() == Binding::Descriptors);

    vkCmdBindPipeline(commands_, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.pipeline());
    std::array<std::byte, kPushConstantBytes> push{};
    size_t pushBytes = params.size();
    CHECK(pushBytes <= push.size(), "{}: parameters fit into push constants", kernel.name());
    if (!params.empty()) std::memcpy(push.data(), params.data(), params.size());
    if (device_.binding() == Binding::Addresses) {
        CHECK(pushBytes + slots.size() * 8 <= push.size(),
              "{}: {} bytes of parameters and {} addresses fit into {} bytes", kernel.name(),
              pushBytes, slots.size(), push.size());
        for (const BufferView& slot : slots) {
            uint64_t address = slot.buffer ? slot.address() : 0;
            std::memcpy(push.data() + pushBytes, &address, 8);
            pushBytes += 8;
        }
    }
    if (kernel.setLayout()) {
        VkDescriptorSet set = descriptorSet(kernel, slots);
        vkCmdBindDescriptorSets(commands_, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.layout(), 0, 1,
                                &set, 0, nullptr);
    }
    if (pushBytes > 0)
        vkCmdPushConstants(commands_, kernel.layout(), VK_SHADER_STAGE_COMPUTE_BIT, 0,
                           static_cast<uint32_t>(pushBytes), push.data());
}

void Recorder::copy(const BufferView& source, const BufferView& target) {
    CHECK(source.bytes == target.bytes, "a copy's source and target have the same size");
    if (source.bytes == 0) return;
    barrierFor({accessOf(source, true, false), accessOf(target, false, true)});
    VkBufferCopy region{source.offset, target.offset, source.bytes};
    vkCmdCopyBuffer(commands_, source.buffer->handle(), target.buffer->handle(), 1, &region);
}

void Recorder::fill(const BufferView& target, uint32_t word) {
    if (target.bytes == 0) return;
    barrierFor({accessOf(target, false, true)});
    vkCmdFillBuffer(commands_, target.buffer->handle(), target.offset, alignUp(target.bytes, 4),
                    word);
}

void Recorder::timestamp() {
    if (queries_ == VK_NULL_HANDLE) {
        VkQueryPoolCreateInfo info{VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO};
        info.queryType = VK_QUERY_TYPE_TIMESTAMP;
        info.queryCount = kMaxTimestamps;
        VK_CHECK(vkCreateQueryPool(device_.handle(), &info, nullptr, &queries_));
        vkCmdResetQueryPool(commands_, queries_, 0, kMaxTimestamps);
    }
    CHECK(timestampCount_ < kMaxTimestamps, "a recording has at most {} timestamps",
          kMaxTimestamps);
    vkCmdWriteTimestamp(commands_, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries_,
                        timestampCount_++);
}

void Recorder::finish() {
    // What the kernels wrote becomes visible to the host that waits for the fence, and to the
    // next replay of this or another recording.
    VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
    barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT | VK_ACCESS_SHADER_READ_BIT |
                            VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_READ_BIT |
                            VK_ACCESS_TRANSFER_WRITE_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
    vkCmdPipelineBarrier(commands_, kStages, kStages | VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier,
                         0, nullptr, 0, nullptr);
    VK_CHECK(vkEndCommandBuffer(commands_));
}

void Recorder::submit() {
    wait();
    device_.submit(submissions_, fence_);
    pending_ = true;
}

void Recorder::wait() {
    if (!pending_) return;
    device_.wait(fence_);
    pending_ = false;
}

std::vector<double> Recorder::timestamps() {
    wait();
    std::vector<uint64_t> ticks(timestampCount_);
    if (!ticks.empty())
        VK_CHECK(vkGetQueryPoolResults(device_.handle(), queries_, 0, timestampCount_,
                                       ticks.size() * 8, ticks.data(), 8,
                                       VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT));
    std::vector<double> times;
    for (uint64_t tick : ticks)
        times.push_back(static_cast<double>(tick) * device_.timestampPeriodNanoseconds());
    return times;
}

}  // namespace doppel
