#include "viewer/window/look.h"

#include <imgui.h>

#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "engine/files/atomic_file.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kFontPixels = 15, kOwnFontPixels = 13;
constexpr uint64_t kLargestFont = uint64_t{64} << 20;

// Letters of Europe, and the few signs that the interface has; names of files may use them.
constexpr std::array<ImWchar, 11> kLetters = {0x20,   0x17f,  0x370,  0x3ff,  0x400, 0x4ff,
                                              0x2010, 0x2027, 0x2190, 0x2193, 0};

bool addFont(const fs::path& path, float pixels) {
    if (path.empty()) return false;
    std::vector<uint8_t> bytes;
    try {
        bytes = readWholeFile(path, kLargestFont);
    } catch (const std::exception&) {
        return false;
    }
    // TrueType and OpenType begin so; Dear ImGui aborts over anything else.
    constexpr std::array<uint8_t, 4> kTrueType = {0, 1, 0, 0};
    if (bytes.size() < 1024 || !std::equal(kTrueType.begin(), kTrueType.end(), bytes.begin()))
        return false;
    void* owned = IM_ALLOC(bytes.size());  // the atlas frees it
    std::memcpy(owned, bytes.data(), bytes.size());
    ImFontConfig config;
    config.OversampleH = config.OversampleV = 1;  // drawn pixel by pixel (canvas.h)
    config.PixelSnapH = true;
    ImGui::GetIO().Fonts->AddFontFromMemoryTTF(owned, static_cast<int>(bytes.size()), pixels,
                                               &config, kLetters.data());
    return true;
}

}  // namespace

fs::path interfaceFont() {
    for (const char* path :
         {"/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf", "/usr/share/fonts/TTF/DejaVuSans.ttf",
          "/usr/share/fonts/dejavu-sans-fonts/DejaVuSans.ttf",
          "/usr/share/fonts/dejavu/DejaVuSans.ttf",
          "/usr/share/fonts/truetype/noto/NotoSans-Regular.ttf",
          "/usr/share/fonts/noto/NotoSans-Regular.ttf",
          "/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf"}) {
        std::error_code none;
        if (fs::is_regular_file(path, none)) return path;
    }
    return {};
}

void applyLook(const Look& look) {
    ImGuiIO& io = ImGui::GetIO();
    io.Fonts->Clear();
    const double pixels = look.unit * look.density;
    if (!addFont(interfaceFont(), static_cast<float>(std::round(kFontPixels * pixels)))) {
        ImFontConfig config;
        config.SizePixels = static_cast<float>(std::round(kOwnFontPixels * pixels));
        io.Fonts->AddFontDefault(&config);
    }
    io.Fonts->Build();
    io.FontGlobalScale = static_cast<float>(1 / look.density);

    ImGuiStyle style;
    const bool light = look.theme == Theme::Light;
    light ? ImGui::StyleColorsLight(&style) : ImGui::StyleColorsDark(&style);
    style.WindowRounding = 4;
    style.FrameRounding = 3;
    style.FramePadding.y = 3;
    style.WindowBorderSize = 0;
    // What a slider says stands over its grab, and is read through it.
    style.Colors[ImGuiCol_SliderGrab].w = style.Colors[ImGuiCol_SliderGrabActive].w = .45f;
    style.Colors[ImGuiCol_TextDisabled] =
        light ? ImVec4(.36f, .37f, .40f, 1) : ImVec4(.64f, .66f, .70f, 1);
    if (light) {
        style.FrameBorderSize = 1;
        style.Colors[ImGuiCol_WindowBg] = ImVec4(.95f, .95f, .96f, 1);
        style.Colors[ImGuiCol_Button] = ImVec4(.26f, .52f, .92f, .28f);
        style.Colors[ImGuiCol_CheckMark] = ImVec4(.12f, .40f, .82f, 1);
    } else {
        style.Colors[ImGuiCol_WindowBg] = ImVec4(.10f, .105f, .115f, 1);
        // Dear ImGui's own are too bright to read white letters on (WCAG AA asks for 4.5 to 1).
        for (const ImGuiCol hovered :
             {ImGuiCol_ButtonHovered, ImGuiCol_HeaderHovered, ImGuiCol_TabHovered})
            style.Colors[hovered] = ImVec4(.18f, .42f, .74f, 1);
        for (const ImGuiCol held : {ImGuiCol_ButtonActive, ImGuiCol_HeaderActive})
            style.Colors[held] = ImVec4(.14f, .36f, .66f, 1);
        style.Colors[ImGuiCol_SliderGrabActive] = ImVec4(.20f, .46f, .82f, .45f);
        // Dear ImGui's own lightens what is behind a question.
        style.Colors[ImGuiCol_ModalWindowDimBg] = ImVec4(.02f, .02f, .03f, .55f);
    }
    style.ScaleAllSizes(static_cast<float>(look.unit));
    ImGui::GetStyle() = style;
}

}  // namespace doppel
