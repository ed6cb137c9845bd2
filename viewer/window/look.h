// How the interface looks: its font, sizes and colours.
#pragma once

#include <filesystem>

namespace doppel {

enum class Theme { Dark, Light };

struct Look {
    double unit = 1;     // window coordinates for what is one pixel of a plain monitor
    double density = 1;  // framebuffer pixels per window coordinate
    Theme theme = Theme::Dark;
    bool operator==(const Look&) const = default;
};

// The first that is installed of a few fonts that systems come with: DejaVu Sans, Noto Sans,
// Liberation Sans, all under free licences (DejaVu's is Bitstream Vera's, with additions in the
// public domain). Empty: none of them, and Dear ImGui's own font of fixed pixels is taken.
std::filesystem::path interfaceFont();

// For Dear ImGui's current context, between two frames.
void applyLook(const Look& look);

}  // namespace doppel
