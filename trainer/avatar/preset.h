// The numbers of a training run: presets `ci`, `small` and `paper`, changed by a config file and by
// flags. Names follow the symbols of Gomes et al., WACV 2022; where the authors' program differs
// from their paper, the preset `paper` takes the paper's value and the number's help gives the
// program's. A number is declared once, in its stage's step (nn/steps); its default is `paper`'s.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "nn/steps/caps_numbers.h"
#include "nn/steps/fit_step.h"
#include "nn/steps/mesh_step.h"
#include "nn/steps/refine_step.h"
#include "nn/steps/surface_step.h"
#include "nn/steps/texture_step.h"

namespace doppel {

// A section per stage, in the order of the stages. Its numbers are declared beside its step.
#define PRESET_SECTIONS(SECTION)    \
    SECTION(FitPreset, fit)         \
    SECTION(CapsPreset, caps)       \
    SECTION(SurfacePreset, shape)   \
    SECTION(SurfacePreset, texels)  \
    SECTION(MeshPreset, mesh)       \
    SECTION(TexturePreset, texture) \
    SECTION(RefinePreset, refine)

struct Preset {
    std::string name;
#define SECTION_MEMBER(Type, name) Type name;
    PRESET_SECTIONS(SECTION_MEMBER)
#undef SECTION_MEMBER
};

// "ci" (two minutes, for demo and tests), "small" (some twenty minutes on a CPU), "best" (small
// with finer texels, larger networks and longer schedules, for GPUs), "paper". InputError that
// lists them for another name.
Preset presetByName(std::string_view name);
const std::vector<std::string>& presetNames();

// "fit", "mesh", …: the parts of the numbers' names before the dot, and the tables of a config
// file.
const std::vector<std::string>& presetSections();

// Every number as text under its dotted name, in order: {"mesh.batch", "4"}.
std::vector<std::pair<std::string, std::string>> presetValues(const Preset& preset);

// Sets one of them: ("mesh.batch", "8"). InputError for an unknown name (it lists the near ones), a
// value of another type, or one out of its range; `where` says whose it is ("--set", "run.toml").
void setPresetValue(Preset& preset, std::string_view name, std::string_view value,
                    std::string_view where);

// Takes the numbers of one section, "mesh", from another preset.
void copySection(Preset& to, const Preset& from, std::string_view section);

// A table of all numbers: what each is in every preset, its range, and what it means.
std::string presetHelp();

// What must hold between the numbers (2^depth fits the texture). InputError.
void checkPreset(const Preset& preset, std::string_view where);

}  // namespace doppel
