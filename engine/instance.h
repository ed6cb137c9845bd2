// Vulkan instances: the compute device has one, a window another.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/vulkan.h"

namespace doppel {

// Mesa keeps what lavapipe compiles in a cache on disk, and Mesa 25 finds the functions there that
// fetch texels whatever width of vectors they were compiled for: a program that runs with another
// width crashes in them. So each width has a folder of its own. Every main() begins with this: it
// changes the environment, which no other thread may see.
void separateShaderCaches();

// DOPPEL_VALIDATION=1 asks for the validation layer.
bool validationWanted();
// Layers older than the extension of cooperative matrices take every shader with one for an error.
bool validationKnowsMatrices();
// What the layer said since the start.
std::vector<std::string> validationMessages();

// With or without the validation layer, synchronisation validation included, whose messages end up
// in validationMessages(). MachineError where the layer, an extension or any driver is missing.
VkInstance createInstance(bool validation, std::span<const char* const> extensions = {});
// Whether instances can have all of these extensions.
bool instancesHave(std::span<const char* const> extensions);
// Of an instance with validation.
VkDebugUtilsMessengerEXT createMessenger(VkInstance instance);
// Either may be null.
void destroyInstance(VkInstance instance, VkDebugUtilsMessengerEXT messenger);

std::vector<VkPhysicalDevice> physicalDevices(VkInstance instance);
bool hasExtension(VkPhysicalDevice physical, std::string_view name);

}  // namespace doppel
