#include "trainer/import/importer.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// In the order of what they look for, whatever the order in which they were linked.
std::vector<Importer::Declaration>& importers() {
    static std::vector<Importer::Declaration> all;
    return all;
}

std::string found(const fs::path& folder) {
    std::vector<std::string> names;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
        names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    if (names.size() > 8) names.resize(8), names.push_back("…");
    return names.empty() ? "an empty folder" : fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

Importer::Importer(const Declaration& declaration) {
    const auto before = [](const Declaration& a, const Declaration& b) {
        return std::string_view(a.looks) < b.looks;
    };
    importers().insert(
        std::upper_bound(importers().begin(), importers().end(), declaration, before), declaration);
}

ImportSource readImportSource(const ImportRequest& request) {
    const fs::path& source = request.source;
    std::vector<const char*> looks;
    for (const auto& importer : importers()) {
        if (importer.recognises(source)) {
            if (!request.masks.empty() && !importer.isClip)
                throwInput("--masks: expected a clip or its pictures, found the layout {}",
                           importer.name);
            return {importer.read(request), importer.name};
        }
        looks.push_back(importer.looks);
    }
    std::error_code error;
    if (!fs::is_directory(source, error)) {
        throwInput("{}: expected a video or a folder to import, found {}", source.string(),
                   fs::exists(source, error) ? "neither" : "nothing");
    }
    throwInput("{}: expected a known layout: {}; found {}; docs/formats.md has a capture's files",
               source.string(), fmt::join(looks, ", or "), found(source));
}

}  // namespace doppel
