// What VK_KHR_cooperative_matrix takes beyond Vulkan 1.2 and the shader compiler that is at hand.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "engine/shader_table.h"
#include "engine/vulkan.h"

namespace doppel {

// Sizes of the matrices that a subgroup multiplies at once: C [m, n] += A [m, k] B [k, n].
struct MatrixShape {
    uint32_t m = 0, n = 0, k = 0;
};

// The shape that the device has for A and B in half and C in single precision, of those whose sides
// divide kMatrixTile the one with the most products; none where it has no such, or lacks what else
// kernels with them need (halves, full subgroups, Vulkan's memory model).
std::optional<MatrixShape> halfMatrixShape(VkInstance instance, VkPhysicalDevice physical);
constexpr uint32_t kMatrixTile = 16;

// What vkCreateDevice's pNext chain and list of extensions need for these kernels.
struct MatrixFeatures {
    MatrixFeatures();
    MatrixFeatures(const MatrixFeatures&) = delete;
    MatrixFeatures& operator=(const MatrixFeatures&) = delete;
    static constexpr std::array<const char*, 2> kExtensions{"VK_KHR_cooperative_matrix",
                                                            "VK_EXT_subgroup_size_control"};
    // next: the chain so far, whose features of Vulkan 1.2 it adds to.
    void* chain(VkPhysicalDeviceVulkan12Features& next);

private:
    struct CooperativeMatrix {
        VkStructureType type;
        void* next;
        VkBool32 cooperativeMatrix, robustBufferAccess;
    } cooperative_;
    VkPhysicalDevice16BitStorageFeatures storage_;
    VkPhysicalDeviceSubgroupSizeControlFeaturesEXT subgroups_;
};

// Whether a module declares the capability.
bool usesCooperativeMatrices(SpirvRange module);

// glslang 12 knows no cooperative matrices, but lets a shader spell out instructions and types (see
// shaders/common/cooperative_matrix.glsl) with literal operands alone. This puts what it had to
// leave out into OpTypeCooperativeMatrixKHR: the component type (half for uses A and B, single for
// the accumulator) and rows and columns, which are the specialisation constants kMatrixM, kMatrixN
// and kMatrixK.
std::vector<uint32_t> completeMatrixTypes(SpirvRange module);

}  // namespace doppel
