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
    kBuiltIn = 11,
    kNonWritable = 24,
    kNonReadable = 25,
    kBindingDecoration = 33,
};
constexpr uint32_t kUniformConstantClass = 0, kWorkgroupClass = 4, kStorageBufferClass = 12;
constexpr uint32_t kNumWorkgroups = 24;  // a built-in

enum Capability : uint32_t {
    kInt64 = 11,
    kInt64Atomics = 12,
    kGroupNonUniform = 61,  // seven kinds of subgroup operations from here on
    kGroupNonUniformQuad = 68,
};
constexpr const char* kSubgroupOperations[] = {"basic",    "votes",    "arithmetic",
                                               "ballots",  "shuffles", "relative shuffles",
                                               "clusters", "quads"};

// Sizes of types and values of constants, for the lengths of arrays.
class Constants {
public:
    Constants(SpirvRange module, const Specialisation& specialisation) {
        const Reflection reflection = reflect(module);
        std::map<uint32_t, uint32_t> given;  // by SpecId
        for (const auto& [name, value] : specialisation)
            if (auto id = reflection.constants.find(name); id != reflection.constants.end())
                given[id->second] = value;
        eachInstruction(module, [&](const Instruction& i) {
            switch (i.op) {
                case kOpDecorate:
                    if (i[2] == kSpecId && given.contains(i[3])) values_[i[1]] = given[i[3]];
                    break;
                case kOpTypeInt:
                case kOpTypeFloat:
                    bytes_[i[1]] = i[2] / 8;
                    break;
                case kOpTypeVector:
                    bytes_[i[1]] = bytes_[i[2]] * i[3];
                    break;
                case kOpTypeArray:
                    bytes_[i[1]] = bytes_[i[2]] * values_[i[3]];
                    break;
                case kOpConstant:
                case kOpSpecConstant:
                    values_.try_emplace(i[2], i[3]);
                    break;
                case kOpSpecConstantComposite:
                    parts_[i[2]] = {i.words + 3, i.words + i.length};
                    break;
                case kOpSpecConstantOp:
                    values_[i[2]] = result(i);
                    break;
                case kOpTypePointer:
                    if (i[2] == kWorkgroupClass) pointee_[i[1]] = i[3];
                    break;
                case kOpVariable:
                    if (i[3] == kWorkgroupClass) sharedBytes += bytes_[pointee_[i[1]]];
                    break;
                default:
                    break;
            }
        });
    }

    uint64_t sharedBytes = 0;

private:
    // Of the few operations that lengths are made with.
    uint64_t result(const Instruction& i) {
        if (i[3] == kOpCompositeExtract) {
            const std::vector<uint32_t>& parts = parts_[i[4]];
            return i[5] < parts.size() ? values_[parts[i[5]]] : 0;
        }
        const uint64_t a = values_[i[4]], b = i.length > 5 ? values_[i[5]] : 0;
        switch (i[3]) {
            case kOpIAdd:
                return a + b;
            case kOpISub:
                return a - b;
            case kOpIMul:
                return a * b;
            case kOpUDiv:
                return b ? a / b : 0;
            default:
                return 0;  // of no array that kernels share
        }
    }

    std::map<uint32_t, uint64_t> bytes_, values_;
    std::map<uint32_t, std::vector<uint32_t>> parts_;
    std::map<uint32_t, uint32_t> pointee_;
};

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
    uint32_t groupCount = 0;                  // gl_NumWorkGroups
    std::map<uint32_t, uint32_t> components;  // constants that choose one of it

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
                if (i[2] == kBuiltIn && i[3] == kNumWorkgroups) groupCount = i[1];
                break;
            case kOpCapability:
                result.capabilities.push_back(i[1]);
                break;
            case kOpConstant:
                components[i[2]] = i[3];
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
                if (inFunction && i.op == kOpAccessChain && i[3] == groupCount)
                    result.countsWorkgroups.at(components.at(i[4])) = true;
                if (inFunction && i.op == kOpLoad && i[3] == groupCount)
                    result.countsWorkgroups = {true, true, true};
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
    std::ranges::sort(result.capabilities);
    for (auto [id, specId] : specIds)
        result.constants[specId == 0 ? "local_size" : names.at(id)] = specId;
    return result;
}

uint64_t sharedBytes(SpirvRange module, const Specialisation& specialisation) {
    return Constants(module, specialisation).sharedBytes;
}

void checkKernel(const DeviceInfo& info, const ShaderTableRow& row, bool descriptors,
                 const Specialisation& specialisation) {
    const SpirvRange module = descriptors ? row.descriptors : row.addresses;
    const Reflection reflection = reflect(module);
    auto need = [&](std::string_view what, uint64_t wanted, uint64_t most) {
        if (wanted > most)
            throwMachine("kernel {} needs {} {}; {} has {}", row.name, wanted, what, info.name,
                         most);
    };
    uint32_t size = 64;
    if (auto given = specialisation.find("local_size"); given != specialisation.end())
        size = given->second;
    need("invocations in a workgroup", size,
         std::min(info.maxWorkgroupInvocations, info.maxWorkgroupSize[0]));
    need("bytes of shared memory", sharedBytes(module, specialisation), info.maxSharedBytes);
    need("bytes of push constants", kPushConstantBytes, info.maxPushConstantBytes);
    if (descriptors) need("storage buffers", reflection.buffers.size(), info.maxStorageBuffers);
    auto lacks = [&](std::string_view what) {
        throwMachine("kernel {} needs {}, which {} lacks", row.name, what, info.name);
    };
    for (uint32_t capability : reflection.capabilities) {
        if (capability == kInt64 && !info.int64) lacks("64-bit integers");
        if (capability == kInt64Atomics && !info.int64Atomics) lacks("64-bit atomics");
        const uint32_t operation = capability - kGroupNonUniform;
        if (capability >= kGroupNonUniform && capability <= kGroupNonUniformQuad &&
            !(info.subgroupOperations >> operation & 1))
            lacks(fmt::format("{} of subgroups", kSubgroupOperations[operation]));
    }
}

Kernel::Kernel(VkDevice device, VkPipelineCache cache, const ShaderTableRow& row, bool descriptors,
               const Specialisation& specialisation, bool cut)
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
    if (cut) info.flags = VK_PIPELINE_CREATE_DISPATCH_BASE_BIT;
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
