// A kernel: one entry of one shader as a compute pipeline, and what its SPIR-V says of itself.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "engine/device_info.h"
#include "engine/shader_table.h"
#include "engine/vulkan.h"

namespace doppel {

// Specialisation constants by the name they have in the shader. "local_size" is the workgroup's.
using Specialisation = std::map<std::string, uint32_t, std::less<>>;

struct KernelBuffer {
    std::string name;
    uint32_t slot = 0;
    bool reads = false, writes = false;
    bool texels = false;  // read as vec4 through a descriptor, whatever the flavour
};

// Read from the SPIR-V of the flavour "descriptors".
struct Reflection {
    std::vector<KernelBuffer> buffers;          // only those that the entry uses
    uint32_t slotCount = 0;                     // buffers declared in the file
    std::map<std::string, uint32_t> constants;  // specialisation constant name -> id
    bool texels = false;                        // of any buffer
    std::vector<uint32_t> capabilities;         // as SPIR-V numbers them, sorted
    // Whether the kernel asks how many workgroups a dispatch has along x, y and z.
    std::array<bool, 3> countsWorkgroups{};
};
Reflection reflect(SpirvRange module);

// Bytes of the variables that a workgroup shares, with these specialisation constants.
uint64_t sharedBytes(SpirvRange module, const Specialisation& specialisation);

// Throws MachineError where a kernel asks for more than the device has: workgroups, shared memory,
// push constants, descriptors, operations.
void checkKernel(const DeviceInfo& info, const ShaderTableRow& row, bool descriptors,
                 const Specialisation& specialisation);

class Kernel {
public:
    // cut: it can be dispatched in pieces.
    Kernel(VkDevice device, VkPipelineCache cache, const ShaderTableRow& row, bool descriptors,
           const Specialisation& specialisation, bool cut);
    ~Kernel();
    Kernel(const Kernel&) = delete;
    Kernel& operator=(const Kernel&) = delete;

    const std::string& name() const { return name_; }
    const Reflection& reflection() const { return reflection_; }
    uint32_t localSize() const { return localSize_; }
    VkPipeline pipeline() const { return pipeline_; }
    VkPipelineLayout layout() const { return layout_; }
    // Null in "addresses", unless buffers are read as texels.
    VkDescriptorSetLayout setLayout() const { return setLayout_; }

private:
    VkDevice device_;
    std::string name_;
    Reflection reflection_;
    uint32_t localSize_ = 64;
    VkDescriptorSetLayout setLayout_ = VK_NULL_HANDLE;
    VkPipelineLayout layout_ = VK_NULL_HANDLE;
    VkPipeline pipeline_ = VK_NULL_HANDLE;
};

// What Vulkan promises everywhere; parameters and addresses of a kernel must fit.
constexpr uint32_t kPushConstantBytes = 128;

}  // namespace doppel
