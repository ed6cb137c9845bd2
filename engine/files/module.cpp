#include "engine/files/module.h"

#include <dlfcn.h>

#include "engine/error.h"
#include "engine/files/share.h"

namespace doppel {

void* moduleFunction(const char* module, const char* function, const std::string& advice,
                     bool global) {
    const std::filesystem::path ours = modulesFolder() / module;
    std::error_code error;
    const std::string file = std::filesystem::exists(ours, error) ? ours.string() : module;
    void* loaded = dlopen(file.c_str(), RTLD_NOW | (global ? RTLD_GLOBAL : RTLD_LOCAL));
    void* found = loaded ? dlsym(loaded, function) : nullptr;
    if (!found) {
        const char* reason = dlerror();
        throwMachine("{} cannot be loaded ({}); {}", ours.string(),
                     reason ? reason : "no reason given", advice);
    }
    return found;
}

}  // namespace doppel
