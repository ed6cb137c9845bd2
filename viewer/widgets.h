// Widgets that several parts of the window share.
#pragma once

#include <imgui.h>

namespace doppel {

inline bool slider(const char* label, double& value, double low, double high, const char* format) {
    return ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &low, &high, format);
}

constexpr ImGuiWindowFlags kFixed = ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize |
                                    ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar |
                                    ImGuiWindowFlags_NoBringToFrontOnFocus |
                                    ImGuiWindowFlags_NoSavedSettings;

}  // namespace doppel
