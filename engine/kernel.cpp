#include "engine/kernel.h"

#include <algorithm>
#include <set>
#include <string_view>

#include "engine/cooperative_matrix.h"
#include "engine/spirv.h"

namespace doppel {

using namespace spirv;

namespace {

// Of the SPIR-V specification, section 3.
enum SpirvDecoration : uint32_t {
    kSpecId = 1,
    kNonWritable = 24,
    kNonReadable = 25,
    kBindingDecoration = 33,
};
constexpr uint32_t kUniformConstantClass = 0, kStorageBufferClass = 12;

}  // namespace

Reflection reflect(SpirvRange module) {
    Reflection result;
    std::map<uint32_t, std::string> names;
    std::map<uint32_t, uint32_t> bindings, specIds, pointee;
    std::set<uint32_t> nonWritable, nonReadable;
    std::map<uint32_t, uint32_t> variables;  // id -> struct type
    std::set<uint32_t> texels;               // of the variables; nothing else is of their class
    std::set<uint32_t> used;
    bool inFunction = false;

    eachInstruction(module, [&](const Instruction& i) {
        switch (i.op) {
            case kOpName:
                names[i[1]] = i.text(2);
                break;
            case kOpTypePointer:
                pointee[i[1]] = i[3];
                break;
            case kOpDecorate:
                if (i[2] == kBindingDecoration) bindings[i[1]] = i[3];
                if (i[2] == kSpecId) specIds[i[1]] = i[3];
                break;
            case kOpMemberDecorate:
                if (i[3] == kNonWritable) nonWritable.insert(i[1]);
                if (i[3] == kNonReadable) nonReadable.insert(i[1]);
                break;
            case kOpVariable:
                if (i[3] == kUniformConstantClass) texels.insert(i[2]);
                if (i[3] == kStorageBufferClass || i[3] == kUniformConstantClass)
                    variables[i[2]] = pointee[i[1]];
                break;
            case kOpFunction:
                inFunction = true;
                break;
            default:
                // Functions that the entry does not call are not in the module, so a mention in
                // any of them is a use.
                if (inFunction)
                    for (uint32_t w = 1; w < i.length; ++w)
                        if (variables.contains(i[w])) used.insert(i[w]);
        }
    });
    for (auto [variable, type] : variables) {
        bool texel = texels.contains(variable);
        result.slotCount = std::max(result.slotCount, bindings.at(variable) + 1);
        if (!used.contains(variable)) continue;
        result.buffers.push_back({names.at(variable), bindings.at(variable),
                                  !nonReadable.contains(type),
                                  !texel && !nonWritable.contains(type), texel});
        result.texels |= texel;
    }
    std::ranges::sort(result.buffers, {}, &KernelBuffer::slot);
    for (auto [id, specId] : specIds)
        result.constants[specId == 0 ? "local_size" : names.at(id)] = specId;
    return result;
}

Kernel::Kernel(VkDevice device, VkPipelineCache cache, const ShaderTableRow& row, bool descriptors,
               const Specialisation& specialisation)
    : device_(device), name_(row.name), reflection_(reflect(row.descriptors)) {
    if (auto size = specialisation.find("local_size"); size != specialisation.end())
        localSize_ = size->second;

    if (descriptors || reflection_.texels) {
        std::vector<VkDescriptorSetLayoutBinding> slots;
        for (const KernelBuffer& buffer : reflection_.buffers) {
            if (!descriptors && !buffer.texels) continue;
            VkDescriptorType type = buffer.texels ? VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER
                                                  : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
            slots.push_back({buffer.slot, type, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
        }
        VkDescriptorSetLayoutCreateInfo info{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO};
        info.bindingCount = static_cast<uint32_t>(slots.size());
        info.pBindings = slots.data();
        VK_CHECK(vkCreateDescriptorSetLayout(device_, &info, nullptr, &setLayout_));
    }
    VkPushConstantRange range{VK_SHADER_STAGE_COMPUTE_BIT, 0, kPushConstantBytes};
    VkPipelineLayoutCreateInfo layoutInfo{VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO};
    layoutInfo.setLayoutCount = setLayout_ ? 1 : 0;
    layoutInfo.pSetLayouts = &setLayout_;
    layoutInfo.pushConstantRangeCount = 1;
    layoutInfo.pPushConstantRanges = &range;
    VK_CHECK(vkCreatePipelineLayout(device_, &layoutInfo, nullptr, &layout_));

    std::vector<VkSpecializationMapEntry> entries;
    std::vector<uint32_t> values;
    for (const auto& [name, value] : specialisation) {
        auto id = reflection_.constants.find(name);
        CHECK(id != reflection_.constants.end(), "{} has no specialisation constant {}", name_,
              name);
        entries.push_back({id->second, static_cast<uint32_t>(values.size() * 4), 4});
        values.push_back(value);
    }
    VkSpecializationInfo constants{static_cast<uint32_t>(entries.size()), entries.data(),
                                   values.size() * 4, values.data()};

    SpirvRange code = descriptors ? row.descriptors : row.addresses;
    std::vector<uint32_t> completed;
    bool matrices = usesCooperativeMatrices(code);
    if (matrices) {
        completed = completeMatrixTypes(code);
        code = {completed.data(), completed.data() + completed.size()};
    }
    VkShaderModuleCreateInfo moduleInfo{VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO};
    moduleInfo.codeSize = static_cast<size_t>(code.end - code.begin) * 4;
    moduleInfo.pCode = code.begin;
    VkShaderModule module = VK_NULL_HANDLE;
    VK_CHECK(vkCreateShaderModule(device_, &moduleInfo, nullptr, &module));

    VkComputePipelineCreateInfo info{VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO};
    info.stage = {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                  nullptr,
                  0,
                  VK_SHADER_STAGE_COMPUTE_BIT,
                  module,
                  "main",
                  &constants};
    // The whole subgroup makes a cooperative matrix.
    if (matrices) info.stage.flags = VK_PIPELINE_SHADER_STAGE_CREATE_REQUIRE_FULL_SUBGROUPS_BIT_EXT;
    info.layout = layout_;
    VkResult result = vkCreateComputePipelines(device_, cache, 1, &info, nullptr, &pipeline_);
    vkDestroyShaderModule(device_, module, nullptr);
    if (result != VK_SUCCESS)
        throwMachine("the driver cannot compile kernel {}: {}", name_, resultName(result));
}

Kernel::~Kernel() {
    vkDestroyPipeline(device_, pipeline_, nullptr);
    vkDestroyPipelineLayout(device_, layout_, nullptr);
    vkDestroyDescriptorSetLayout(device_, setLayout_, nullptr);
}

}  // namespace doppel
