#include "viewer/preferences.h"

#include <algorithm>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/output_folder.h"
#include "viewer/picture/orbit_camera.h"
#include "viewer/pose/json_text.h"

namespace doppel {
namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr size_t kMostRecent = 12, kLongestPath = 4096;
constexpr uint64_t kLargestFile = uint64_t{1} << 20;

bool isCameraText(const std::string& text) {
    try {
        readCameraText(text);
        return true;
    } catch (const InputError&) {
        return false;
    }
}

fs::path fileIn(const fs::path& state) { return state / "preferences.json"; }

}  // namespace

Preferences readPreferences(const fs::path& state) {
    Preferences found;
    if (state.empty()) return found;
    try {
        const std::vector<uint8_t> bytes = readWholeFile(fileIn(state), kLargestFile);
        const json document =
            parsedJson({reinterpret_cast<const char*>(bytes.data()), bytes.size()},
                       fileIn(state).string(), "preferences");
        if (document.value("theme", "") == "light") found.theme = Theme::Light;
        found.snap = document.value("snap", false);
        found.undoCamera = document.value("undo_camera", false);
        found.touchpad = document.value("touchpad", false);
        if (std::string keys = document.value("keys", ""); !keys.empty()) found.keys = keys;
        const double scale = document.value("scale", 1.);
        if (scale >= kSmallestScale && scale <= kLargestScale) found.scale = scale;
        for (const json& path : document.value("recent", json::array()))
            if (path.is_string() && path.get_ref<const std::string&>().size() <= kLongestPath &&
                found.recent.size() < kMostRecent)
                found.recent.push_back(path.get<std::string>());
        for (int digit = 1; digit <= kMostBookmarks; ++digit) {
            const json kept = document.value("bookmarks", json::object())
                                  .value(fmt::format("{}", digit), json::object());
            const Bookmark bookmark{kept.value("name", ""), kept.value("camera", "")};
            if (bookmark.name.size() <= kLongestBookmark && isCameraText(bookmark.camera))
                found.bookmarks[digit] = bookmark;
        }
    } catch (const std::exception&) {
        return {};
    }
    return found;
}

void writePreferences(const fs::path& state, const Preferences& preferences) {
    if (state.empty()) return;
    json bookmarks = json::object();
    for (const auto& [digit, kept] : preferences.bookmarks)
        bookmarks[fmt::format("{}", digit)] = {{"name", kept.name}, {"camera", kept.camera}};
    const json document = {{"theme", preferences.theme == Theme::Light ? "light" : "dark"},
                           {"scale", preferences.scale},
                           {"snap", preferences.snap},
                           {"keys", preferences.keys},
                           {"undo_camera", preferences.undoCamera},
                           {"touchpad", preferences.touchpad},
                           {"recent", preferences.recent},
                           {"bookmarks", bookmarks}};
    try {
        createFolders(state);
        AtomicFile file(fileIn(state));
        file.write(document.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
        file.commit();
    } catch (const std::exception&) {
        return;
    }
}

WindowOptions windowOptions(const ViewerOptions& options, const Preferences& preferences) {
    return {.title = "Doppel",
            .width = options.width,
            .height = options.height,
            .scale = std::clamp(options.scale.value_or(preferences.scale), kSmallestScale,
                                kLargestScale),
            .theme = options.theme.value_or(preferences.theme),
            .device = {}};
}

void remember(Preferences& preferences, const fs::path& file) {
    std::error_code error;
    const fs::path path = fs::weakly_canonical(file, error);
    if (error || path.string().size() > kLongestPath) return;
    std::erase(preferences.recent, path.string());
    preferences.recent.insert(preferences.recent.begin(), path.string());
    if (preferences.recent.size() > kMostRecent) preferences.recent.resize(kMostRecent);
}

}  // namespace doppel
