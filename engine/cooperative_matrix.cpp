#include "engine/cooperative_matrix.h"

#include <algorithm>
#include <map>
#include <string_view>

#include "engine/spirv.h"

namespace doppel {

using namespace spirv;

namespace {

// Of the extension's revision 2; the headers of Vulkan 1.3.239 are older.
constexpr auto kFeaturesType = static_cast<VkStructureType>(1000506000);
constexpr auto kPropertiesType = static_cast<VkStructureType>(1000506001);
constexpr uint32_t kFloat16 = 0, kFloat32 = 1, kSubgroupScope = 3;
struct Properties {
    VkStructureType type;
    void* next;
    uint32_t m, n, k;
    uint32_t a, b, c, result;
    VkBool32 saturating;
    uint32_t scope;
};
using GetProperties = VkResult(VKAPI_PTR*)(VkPhysicalDevice, uint32_t*, Properties*);

constexpr uint32_t kCooperativeMatrixCapability = 6022;
constexpr uint32_t kUseA = 0, kUseB = 1, kUseAccumulator = 2;

// Scalar types and constants come before everything that could refer to them.
bool isScalar(uint32_t op) {
    return op == kOpTypeInt || op == kOpTypeFloat || op == kOpConstant || op == kOpSpecConstant;
}

}  // namespace

std::optional<MatrixShape> halfMatrixShape(VkInstance instance, VkPhysicalDevice physical) {
    auto getProperties = reinterpret_cast<GetProperties>(
        vkGetInstanceProcAddr(instance, "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR"));
    if (!getProperties) return std::nullopt;
    VkPhysicalDevice16BitStorageFeatures storage{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES};
    VkPhysicalDeviceSubgroupSizeControlFeaturesEXT subgroups{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES_EXT};
    subgroups.pNext = &storage;
    VkPhysicalDeviceVulkan12Features features12{
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    features12.pNext = &subgroups;
    VkPhysicalDeviceFeatures2 features{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2};
    features.pNext = &features12;
    vkGetPhysicalDeviceFeatures2(physical, &features);
    if (!storage.storageBuffer16BitAccess || !features12.shaderFloat16 ||
        !features12.vulkanMemoryModel || !features12.vulkanMemoryModelDeviceScope ||
        !subgroups.computeFullSubgroups)
        return std::nullopt;

    uint32_t count = 0;
    if (getProperties(physical, &count, nullptr) != VK_SUCCESS) return std::nullopt;
    std::vector<Properties> all(count, Properties{.type = kPropertiesType, .next = nullptr});
    if (getProperties(physical, &count, all.data()) < VK_SUCCESS) return std::nullopt;
    all.resize(count);
    std::optional<MatrixShape> best;
    for (const Properties& p : all) {
        bool fits = p.a == kFloat16 && p.b == kFloat16 && p.c == kFloat32 && p.result == kFloat32 &&
                    !p.saturating && p.scope == kSubgroupScope && p.m > 0 && p.n > 0 && p.k > 0 &&
                    kMatrixTile % p.m == 0 && kMatrixTile % p.n == 0 && kMatrixTile % p.k == 0;
        if (fits && (!best || p.m * p.n * p.k > best->m * best->n * best->k))
            best = MatrixShape{p.m, p.n, p.k};
    }
    return best;
}

MatrixFeatures::MatrixFeatures()
    : cooperative_{kFeaturesType, nullptr, VK_TRUE, VK_FALSE},
      storage_{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_16BIT_STORAGE_FEATURES},
      subgroups_{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES_EXT} {
    storage_.storageBuffer16BitAccess = VK_TRUE;
    subgroups_.computeFullSubgroups = VK_TRUE;
}

void* MatrixFeatures::chain(VkPhysicalDeviceVulkan12Features& next) {
    next.shaderFloat16 = VK_TRUE;
    next.vulkanMemoryModel = VK_TRUE;
    next.vulkanMemoryModelDeviceScope = VK_TRUE;  // atomics of kernels in the older model
    storage_.pNext = &next;
    subgroups_.pNext = &storage_;
    cooperative_.next = &subgroups_;
    return &cooperative_;
}

bool usesCooperativeMatrices(SpirvRange module) {
    bool uses = false;
    eachInstruction(module, [&](const Instruction& i) {
        uses |= i.op == kOpCapability && i[1] == kCooperativeMatrixCapability;
    });
    return uses;
}

std::vector<uint32_t> completeMatrixTypes(SpirvRange module) {
    std::map<uint32_t, uint32_t> ints, floats;  // bits -> type
    std::map<std::string_view, uint32_t> names;
    eachInstruction(module, [&](const Instruction& i) {
        if (i.op == kOpTypeInt) ints[i[2]] = i[1];
        if (i.op == kOpTypeFloat) floats[i[2]] = i[1];
        if (i.op == kOpName) names[i.text(2)] = i[1];
    });
    auto idOf = [&](const auto& map, auto key) {
        auto found = map.find(key);
        CHECK(found != map.end(), "a shader with cooperative matrices has {}", key);
        return found->second;
    };

    std::vector<uint32_t> result(module.begin, module.begin + kHeaderWords);
    auto append = [&](const Instruction& i) {
        result.insert(result.end(), i.words, i.words + i.length);
    };
    // The types refer to constants by their ids, where the compiler put the values themselves.
    std::map<uint32_t, uint32_t> constants;  // value -> id
    auto appendConstants = [&] {
        for (uint32_t value : {kUseA, kUseB, kUseAccumulator, kSubgroupScope}) {
            constants[value] = result[3]++;  // the bound of all ids
            result.insert(result.end(),
                          {4u << 16 | kOpConstant, idOf(ints, 32u), constants[value], value});
        }
    };
    // Before the first type: whatever has none of its own. Then scalars, then all the rest.
    bool scalarsAppended = false;
    eachInstruction(module, [&](const Instruction& i) {
        if (isScalar(i.op) && !scalarsAppended) {
            eachInstruction(module, [&](const Instruction& scalar) {
                if (scalar.op == kOpTypeInt || scalar.op == kOpTypeFloat) append(scalar);
            });
            eachInstruction(module, [&](const Instruction& scalar) {
                if (scalar.op == kOpConstant || scalar.op == kOpSpecConstant) append(scalar);
            });
            appendConstants();
            scalarsAppended = true;
        }
        if (isScalar(i.op)) return;
        if (i.op != kOpTypeCooperativeMatrix) {
            append(i);
            return;
        }
        // Given: result, scope, rows, columns, use. Wanted: the component type before the scope.
        CHECK(i.length == 6 && i[2] == kSubgroupScope, "a matrix type comes without its component");
        uint32_t use = i[5];
        uint32_t component = idOf(floats, use == kUseA || use == kUseB ? 16u : 32u);
        uint32_t rows = idOf(names, std::string_view(use == kUseB ? "kMatrixK" : "kMatrixM"));
        uint32_t columns = idOf(names, std::string_view(use == kUseA ? "kMatrixK" : "kMatrixN"));
        result.insert(result.end(),
                      {7u << 16 | kOpTypeCooperativeMatrix, i[1], component,
                       idOf(constants, kSubgroupScope), rows, columns, idOf(constants, use)});
    });
    return result;
}

}  // namespace doppel
