#include "engine/recorder.h"

#include <algorithm>
#include <array>
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

constexpr uint32_t kSetsPerPool = 256, kBuffersPerSet = 16;

}  // namespace

Groups linearGroups(uint64_t invocations, uint32_t localSize) {
    constexpr uint64_t kMax = 65535;
    uint64_t groups = std::max<uint64_t>(1, (invocations + localSize - 1) / localSize);
    uint64_t rows = (groups + kMax - 1) / kMax;
    uint64_t columns = (groups + rows - 1) / rows;
    CHECK(rows <= kMax, "{} invocations fit into one dispatch", invocations);
    return {static_cast<uint32_t>(columns), static_cast<uint32_t>(rows), 1};
}

Recorder::Recorder(Device& device) : device_(device) {
    commands_ = device.newCommandBuffer();
    fence_ = device.newFence();
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VK_CHECK(vkBeginCommandBuffer(commands_, &begin));
}

Recorder::~Recorder() {
    if (pending_) vkWaitForFences(device_.handle(), 1, &fence_, VK_TRUE, UINT64_MAX);
    for (const auto& [where, view] : texelViews_)
        vkDestroyBufferView(device_.handle(), view, nullptr);
    for (VkDescriptorPool pool : descriptorPools_)
        vkDestroyDescriptorPool(device_.handle(), pool, nullptr);
    vkDestroyQueryPool(device_.handle(), queries_, nullptr);
    vkDestroyFence(device_.handle(), fence_, nullptr);
    device_.freeCommandBuffer(commands_);
}

void Recorder::barrierFor(const std::vector<Access>& accesses) {
    if (hazards_.needsBarrier(accesses)) {
        VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
        barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_SHADER_READ_BIT |
                                VK_ACCESS_TRANSFER_WRITE_BIT | VK_ACCESS_TRANSFER_READ_BIT;
        barrier.dstAccessMask = barrier.srcAccessMask | VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
        vkCmdPipelineBarrier(commands_, kStages, kStages, 0, 1, &barrier, 0, nullptr, 0, nullptr);
        hazards_.clear();
        ++barriers_;
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
                        std::span<const std::byte> params, Groups groups) {
    bind(kernel, buffers, params, {});
    vkCmdDispatch(commands_, groups.x, groups.y, groups.z);
}

void Recorder::dispatchIndirect(const Kernel& kernel, std::span<const BoundBuffer> buffers,
                                std::span<const std::byte> params, const BufferView& groups) {
    CHECK(groups.buffer && groups.bytes >= 12 && groups.offset % 4 == 0,
          "{}: three numbers say how many workgroups", kernel.name());
    bind(kernel, buffers, params, {accessOf(groups, true, false)});
    vkCmdDispatchIndirect(commands_, groups.buffer->handle(), groups.offset);
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
    CHECK(buffers.size() == reflection.buffers.size(),
          "{} is given only the {} buffers that it uses, not {}", kernel.name(),
          reflection.buffers.size(), buffers.size());
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
    device_.submit(commands_, fence_);
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
