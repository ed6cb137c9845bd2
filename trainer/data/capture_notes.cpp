#include "trainer/data/capture_notes.h"

#include <toml++/toml.h>
#include <cstdint>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/output_folder.h"

namespace doppel {
namespace fs = std::filesystem;

double checkedFps(double fps, const std::string& what) {
    if (!(fps > 0) || !(fps <= 10000)) {
        throwInput("{}: expected frames per second, from 0 to 10000, found {}", what, fps);
    }
    return fps;
}

CaptureNotes readNotes(const fs::path& folder) {
    CaptureNotes notes;
    const fs::path absolute = fs::absolute(folder).lexically_normal();
    notes.name = (absolute.has_filename() ? absolute : absolute.parent_path()).filename().string();
    const fs::path path = folder / "capture.toml";
    std::error_code error;
    if (!fs::exists(path, error)) return notes;
    const std::string file = path.string();
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{64} << 20);
    toml::table table;
    try {
        table = toml::parse(
            std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()), file);
    } catch (const toml::parse_error& problem) {
        throwInput("{}: line {}: not TOML: {}", file, problem.source().begin.line,
                   problem.description());
    }
    for (const auto& [key, text] :
         {std::pair{"name", &notes.name}, {"actor", &notes.actor}, {"motion", &notes.motion}}) {
        const auto* node = table.get(key);
        if (node == nullptr) continue;
        if (!node->is_string()) throwInput("{}: {}: expected a text", file, key);
        *text = **node->as_string();
        // Folders of results are named after these two; an empty one says nothing.
        if (text != &notes.name && !text->empty()) requireFileName(*text, file + ": " + key);
    }
    if (const auto* node = table.get("fps")) {
        const auto fps = node->value<double>();
        if (!fps) throwInput("{}: fps: expected a number", file);
        notes.fps = checkedFps(*fps, file + ": fps");
    }
    if (const auto* node = table.get("frames")) {
        const auto* list = node->as_array();
        if (list == nullptr) throwInput("{}: frames: expected a list of names", file);
        std::set<std::string> seen;
        for (const toml::node& element : *list) {
            const auto name = element.value<std::string>();
            if (!element.is_string()) {
                throwInput("{}: frames: expected names of pictures, found something else", file);
            }
            requireFileName(*name, file + ": frames");
            if (!seen.insert(*name).second) {
                throwInput("{}: frames: expected each name once, found \"{}\" twice", file, *name);
            }
            notes.frames.push_back(*name);
        }
        if (notes.frames.empty()) {
            throwInput("{}: frames: expected one name or more, found none", file);
        }
    }
    if (const auto scheme = table["keypoints"]["scheme"].value<std::string>()) {
        notes.scheme = *scheme;
    }
    if (const auto* source = table["source"].as_table()) {
        for (const auto& [key, node] : *source) {
            if (key == "betas" && node.is_array() && node.as_array()->size() == 10) {
                notes.sourceBetas.emplace();
                for (size_t i = 0; i < 10; ++i) {
                    (*notes.sourceBetas)[i] = node.as_array()->get(i)->value_or(0.f);
                }
            } else if (const auto text = node.value<std::string>()) {
                notes.source.emplace(std::string(key.str()), *text);
            }
        }
    }
    return notes;
}

fs::path clipOf(const fs::path& folder) {
    const CaptureNotes notes = readNotes(folder);
    const auto named = notes.source.find("folder");
    std::error_code ignored;
    if (named == notes.source.end() || !fs::exists(named->second, ignored)) return {};
    return named->second;
}

std::vector<fs::path> originsOf(const fs::path& motion) {
    std::vector<fs::path> origins{motion};
    std::error_code ignored;
    const bool isFolder = fs::is_directory(motion, ignored);
    const fs::path folder = isFolder ? motion : fs::absolute(motion).parent_path();
    if (!fs::exists(folder / "cameras.npz", ignored)) return origins;
    if (!isFolder) origins.push_back(folder);
    if (const fs::path clip = clipOf(folder); !clip.empty()) origins.push_back(clip);
    return origins;
}

std::string notesText(const CaptureNotes& notes) {
    toml::table table;
    table.insert("name", notes.name);
    if (!notes.actor.empty()) table.insert("actor", notes.actor);
    if (!notes.motion.empty()) table.insert("motion", notes.motion);
    table.insert("fps", notes.fps);
    toml::array names;
    for (const std::string& frame : notes.frames) names.push_back(frame);
    table.insert("frames", std::move(names));
    if (!notes.scheme.empty()) table.insert("keypoints", toml::table{{"scheme", notes.scheme}});
    toml::table source;
    for (const auto& [key, text] : notes.source) source.insert(key, text);
    if (notes.sourceBetas) {
        toml::array betas;
        for (const float beta : *notes.sourceBetas) betas.push_back(double(beta));
        source.insert("betas", std::move(betas));
    }
    if (!source.empty()) table.insert("source", std::move(source));
    std::ostringstream text;
    text << table << "\n";
    return text.str();
}

}  // namespace doppel
