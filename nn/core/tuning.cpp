#include "nn/core/tuning.h"

#include <cstdlib>
#include <fstream>
#include <map>
#include <mutex>
#include <sstream>
#include <type_traits>
#include <vector>

#include "engine/error.h"
#include "engine/files/atomic_file.h"

namespace doppel {

namespace {

std::string keyOf(const DeviceInfo& info) {
    // A CPU's numbers are not those of the kernels that it lacks.
    const bool other = info.cpu && !info.kernelPath.onCpu;
    return fmt::format("\"{}{}\" \"{}\"", info.name, other ? ", kernels of GPUs" : "", info.driver);
}

struct Known {
    std::mutex mutex;
    std::map<std::string, GemmTuning> byDevice;
};
Known& known() {
    static Known known;
    return known;
}

std::vector<std::string> linesOf(const std::filesystem::path& path) {
    std::vector<std::string> lines;
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
}

// Calls visit(name, number, least, most) for each.
template <typename T, typename Visit>
void visitNumbers(T& tuning, Visit visit) {
    visit("cost8", tuning.cost8, .1, 100);
    visit("cost16", tuning.cost16, .1, 100);
    visit("tiles", tuning.tiles, 1, 1e6);
    visit("shortestPart", tuning.shortestPart, 16, 1e6);
}

}  // namespace

DeviceClass deviceClass(const DeviceInfo& info) {
    if (info.kernelPath.onCpu) return DeviceClass::Cpu;
    return info.halfMatrices ? DeviceClass::CooperativeMatrix : DeviceClass::Gpu;
}

const char* deviceClassName(DeviceClass deviceClass) {
    switch (deviceClass) {
        case DeviceClass::Cpu:
            return "CPU";
        case DeviceClass::Gpu:
            return "GPU";
        case DeviceClass::CooperativeMatrix:
            return "GPU with cooperative matrices";
    }
    return "";
}

GemmTuning defaultGemmTuning(DeviceClass deviceClass) {
    switch (deviceClass) {
        case DeviceClass::Cpu:
            return {.tiles = 16, .shortestPart = 512};
        case DeviceClass::Gpu:
        case DeviceClass::CooperativeMatrix:
            return {.tiles = 256, .shortestPart = 128};
    }
    return {};
}

const GemmTuning& gemmTuning(const Device& device) {
    std::lock_guard lock(known().mutex);
    auto [entry, fresh] = known().byDevice.try_emplace(keyOf(device.info()));
    if (fresh) {
        entry->second = defaultGemmTuning(deviceClass(device.info()));
        std::filesystem::path path = tuningCachePath();
        std::error_code ignored;
        if (!path.empty() && std::filesystem::exists(path, ignored))
            entry->second = readGemmTuning(path, device.info());
    }
    return entry->second;
}

void setGemmTuning(const Device& device, const GemmTuning& tuning) {
    std::lock_guard lock(known().mutex);
    known().byDevice[keyOf(device.info())] = tuning;
}

std::filesystem::path tuningCachePath() {
    auto variable = [](const char* name) {
        const char* value = std::getenv(name);
        return std::string(value ? value : "");
    };
    if (std::string own = variable("DOPPEL_TUNING"); !own.empty())
        return own == "off" ? std::filesystem::path() : std::filesystem::path(own);
    if (std::string cache = variable("XDG_CACHE_HOME"); !cache.empty())
        return std::filesystem::path(cache) / "doppel" / "tuning";
    if (std::string home = variable("HOME"); !home.empty())
        return std::filesystem::path(home) / ".cache" / "doppel" / "tuning";
    return {};
}

GemmTuning readGemmTuning(const std::filesystem::path& path, const DeviceInfo& info) {
    GemmTuning tuning = defaultGemmTuning(deviceClass(info));
    std::string key = keyOf(info);
    size_t number = 0;
    for (const std::string& line : linesOf(path)) {
        ++number;
        if (!line.starts_with(key)) continue;
        std::istringstream words(line.substr(key.size()));
        for (std::string word; words >> word;) {
            size_t equals = word.find('=');
            std::string name = word.substr(0, equals);
            bool understood = false;
            visitNumbers(tuning, [&](const char* field, auto& target, double least, double most) {
                if (name != field || equals == std::string::npos) return;
                std::istringstream text(word.substr(equals + 1));
                double value = 0;
                if (!(text >> value) || !text.eof() || value < least || value > most) return;
                target = static_cast<std::remove_reference_t<decltype(target)>>(value);
                understood = true;
            });
            if (!understood)
                throwInput(
                    "{}: line {}: expected numbers as `doppel-bench --tune` writes them, found "
                    "\"{}\"; remove the line or the file",
                    path.string(), number, word);
        }
        break;
    }
    return tuning;
}

void writeGemmTuning(const std::filesystem::path& path, const DeviceInfo& info,
                     const GemmTuning& tuning) {
    std::string key = keyOf(info), line = key, text;
    visitNumbers(tuning, [&](const char* field, const auto& value, double, double) {
        line += fmt::format(" {}={}", field, value);
    });
    for (const std::string& other : linesOf(path))
        if (!other.starts_with(key)) text += other + "\n";
    if (path.has_parent_path()) {
        std::error_code failed;
        std::filesystem::create_directories(path.parent_path(), failed);
        if (failed)
            throwMachine("{}: the folder cannot be made: {}", path.parent_path().string(),
                         failed.message());
    }
    AtomicFile file(path);
    file.write(text + line + "\n");
    file.commit();
}

}  // namespace doppel
