// The list of keys, and which keys there are.
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/output_folder.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

struct Row {
    std::string keys, does;
    bool head = false;
};

std::vector<Row> rowsOf(const Bindings& bindings, bool snap) {
    std::vector<Row> rows{
        {"Mouse", "", true},
        {"left drag of a joint", "moves it, the limb follows"},
        {"left drag of a ring", snap ? "turns the joint by 5 degrees, with Ctrl freely"
                                     : "turns the joint, with Ctrl by 5 degrees"},
        {"click into the empty", "deselects"}};
    const char* group = "";
    for (size_t i = 0; i < kActions; ++i) {
        const ActionInfo& info = allActions()[i];
        const std::string keys = bindings.keysOf(static_cast<Action>(i));
        if (keys.empty()) continue;
        if (std::string_view(group) != info.group) rows.push_back({group = info.group, "", true});
        rows.push_back({keys, info.does});
    }
    return rows;
}

}  // namespace

void Viewer::drawHelp() {
    if (!settings_.help) return;
    const ImVec2 size = ImGui::GetIO().DisplaySize;
    const auto unit = static_cast<float>(window_.unit());
    ImGui::SetNextWindowPos({std::min(40 * unit, size.x / 20), std::min(60 * unit, size.y / 10)},
                            ImGuiCond_Appearing);
    const std::vector<Row> rows = rowsOf(keys_, preferences_.snap);
    // As wide as its rows where the window has room, else they wrap; what is too high scrolls.
    float keys = 0, meanings = 0;
    for (const Row& row : rows) {
        keys = std::max(keys, ImGui::CalcTextSize(row.keys.c_str()).x);
        meanings = std::max(meanings, ImGui::CalcTextSize(row.does.c_str()).x);
    }
    keys = std::min(keys, 17 * ImGui::GetFontSize());
    const ImGuiStyle& style = ImGui::GetStyle();
    const float wide = std::ceil(keys) + std::ceil(meanings) + 4 * style.CellPadding.x +
                       2 * style.WindowPadding.x + style.ScrollbarSize + unit;
    ImGui::SetNextWindowSizeConstraints({0, 0}, {size.x * .95f, size.y * .88f});
    ImGui::SetNextWindowSize({std::ceil(std::min(wide, size.x * .95f)), 0});  // 0: as high as it is
    ImGui::Begin("Help", &settings_.help,
                 ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoSavedSettings);
    drawKeysControls();
    if (ImGui::BeginTable("keys", 2)) {
        ImGui::TableSetupColumn("keys", ImGuiTableColumnFlags_WidthFixed,
                                std::min(std::ceil(keys), size.x * .45f));
        ImGui::TableSetupColumn("meanings", ImGuiTableColumnFlags_WidthStretch);
        for (const Row& row : rows) {
            ImGui::TableNextRow();
            ImGui::TableNextColumn();
            if (row.head)
                hint(row.keys);
            else
                words(row.keys);
            ImGui::TableNextColumn();
            if (!row.does.empty()) hint(row.does);
        }
        ImGui::EndTable();
    }
    ImGui::End();
}

void Viewer::useKeys(const std::string& nameOrFile) {
    Bindings keys = Bindings::named(nameOrFile);
    if (preferences_.touchpad) keys.useTouchpad();
    keys_ = std::move(keys);
}

void Viewer::chooseKeys(const std::string& nameOrFile) {
    useKeys(nameOrFile);
    const bool preset = Bindings::isPreset(nameOrFile);
    preferences_.keys = preset ? nameOrFile : fs::absolute(nameOrFile).string();
    writePreferences(options_.state, preferences_);
}

// A file that is damaged by now, or gone, is no reason not to open the window.
void Viewer::openKeys() {
    if (!options_.keys.empty()) return useKeys(options_.keys);
    try {
        useKeys(preferences_.keys);
    } catch (const std::exception& error) {
        say(error.what(), true);
        useKeys("gltf");
    }
}

void Viewer::drawKeysControls() {
    const fs::path own = options_.state / "keys.toml";
    std::error_code error;
    const bool isThere = !options_.state.empty() && fs::exists(own, error);
    enum { kGltf, kBlender, kFile };
    int chosen = keys_.name() == "gltf" ? kGltf : keys_.name() == "blender" ? kBlender : kFile;
    constexpr Choice kKeys[] = {
        {"glTF viewers", kGltf, "The left button orbits."},
        {"Blender", kBlender, "The middle button orbits, G and R move and turn."},
        {"of a file", kFile, "As the file says that was opened."}};
    const size_t count = isThere || chosen == kFile ? 3 : 2;
    ImGui::PushItemWidth(12 * ImGui::GetFontSize());
    const bool other = choose("keys", "Whose habits keys and mouse have.", kKeys, count, chosen);
    ImGui::PopItemWidth();
    if (other)
        attempt([&] {
            chooseKeys(chosen == kGltf ? "gltf" : chosen == kBlender ? "blender" : own.string());
        });
    if (checkbox("touchpad", "Two fingers orbit, with Shift pan, with Ctrl go nearer and farther.",
                 preferences_.touchpad))
        attempt([&] { chooseKeys(keys_.name()); });
    beside("own keys");
    if (!button("own keys",
                isThere ? "Reads " + own.string() + " again."
                        : "Writes these keys into " + own.string() + ", to be changed there.",
                !options_.state.empty()))
        return;
    attempt([&] {
        if (!isThere) {
            createFolders(options_.state);
            AtomicFile file(own);
            file.write(Bindings::named(keys_.name()).text());
            file.commit();
        }
        chooseKeys(own.string());
        say((isThere ? "keys as in " : "keys are in ") + own.string());
    });
}

}  // namespace doppel
