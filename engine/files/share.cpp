#include "engine/files/share.h"

#include <fmt/format.h>

#include <cstdlib>
#include <fstream>

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Empty where the system does not tell.
fs::path programFolder() {
    std::error_code error;
    return fs::read_symlink("/proc/self/exe", error).parent_path();
}

}  // namespace

fs::path sourceFolder() {
    std::ifstream file(programFolder() / "doppel-source");
    std::string relative;
    if (!std::getline(file, relative) || relative.empty()) return {};
    fs::path folder = (programFolder() / relative).lexically_normal();
    return folder.has_filename() ? folder : folder.parent_path();
}

fs::path shareFolder() { return (programFolder() / DOPPEL_SHARE).lexically_normal(); }

fs::path modulesFolder() {
    return sourceFolder().empty() ? (programFolder() / DOPPEL_MODULES).lexically_normal()
                                  : programFolder();
}

fs::path fetchedFolder(const char* name) {
    if (const fs::path source = sourceFolder(); !source.empty()) return source / "build" / name;
    const fs::path users = userDataFolder() / name, everyones = shareFolder() / name;
    std::error_code error;
    return fs::exists(users, error) || !fs::exists(everyones, error) ? users : everyones;
}

std::string fetchAdvice(const char* name, const char* variable) {
    if (!sourceFolder().empty())
        return fmt::format("run scripts/setup --{}, which fetches it, or set {} to its folder",
                           name, variable);
    return fmt::format(
        "run doppel-fetch {0}, which fetches it into {1} (for everyone: --into {2}), or set {3} to "
        "its folder",
        name, (userDataFolder() / name).string(), (shareFolder() / name).string(), variable);
}

fs::path userDataFolder() {
    const char* data = std::getenv("XDG_DATA_HOME");
    if (data && *data == '/') return fs::path(data) / "doppel";
    const char* home = std::getenv("HOME");
    if (home && *home) return fs::path(home) / ".local" / "share" / "doppel";
    return {};
}

}  // namespace doppel
