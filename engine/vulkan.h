// Every call that begins with vk goes through VK_CHECK where it can fail.
#pragma once

#include <vulkan/vulkan.h>

#include "engine/error.h"

namespace doppel {

const char* resultName(VkResult result);
[[noreturn]] void vulkanFailed(VkResult result, const char* call, const char* file, int line);

#define VK_CHECK(call)                                                  \
    do {                                                                \
        VkResult result_ = (call);                                      \
        if (result_ != VK_SUCCESS) [[unlikely]]                         \
            ::doppel::vulkanFailed(result_, #call, __FILE__, __LINE__); \
    } while (0)

}  // namespace doppel
