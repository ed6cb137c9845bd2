#include "trainer/avatar/preset.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <type_traits>

#include "engine/error.h"

namespace doppel {

namespace {

// Calls visit(name, field, lowest, highest) for every number, in the order of the declaration; for
// texts the limits are ignored.
template <typename P, typename Visit>
void visitFields(P& preset, Visit visit) {
    constexpr double kMany = 1e9;
    auto& f = preset.fit;
    visit("fit.size", f.size, 16, 4096);
    visit("fit.passes", f.passes, 0, kMany);
    visit("fit.sigmaStart", f.sigmaStart, 1e-9, 1);
    visit("fit.sigma", f.sigma, 1e-9, 1);
    visit("fit.lrTheta", f.lrTheta, 0, 10);
    visit("fit.lrBeta", f.lrBeta, 0, 10);
    visit("fit.constantPart", f.constantPart, 0, 1);
    visit("fit.priorTheta", f.priorTheta, 0, kMany);
    visit("fit.smoothTheta", f.smoothTheta, 0, kMany);
    visit("fit.priorBeta", f.priorBeta, 0, kMany);
    visit("fit.keypoints", f.keypoints, 0, kMany);
    auto& m = preset.mesh;
    visit("mesh.size", m.size, 16, 4096);
    visit("mesh.blocks", m.blocks, 1, 16);
    visit("mesh.layers", m.layers, 1, 64);
    visit("mesh.hidden", m.hidden, 4, 1024);
    visit("mesh.deviation", m.deviation, 0, 1);
    visit("mesh.batch", m.batch, 1, 256);
    visit("mesh.epochs", m.epochs, 0, kMany);
    visit("mesh.steps", m.steps, 0, kMany);
    visit("mesh.lr", m.lr, 0, 10);
    visit("mesh.beta1", m.beta1, 0, .999999);
    visit("mesh.beta2", m.beta2, 0, .999999);
    visit("mesh.weightDecay", m.weightDecay, 0, 10);
    visit("mesh.constantPart", m.constantPart, 0, 1);
    visit("mesh.sigma", m.sigma, 1e-9, 1);
    visit("mesh.blurRadius", m.blurRadius, 0, 1);
    visit("mesh.laplacian", m.laplacian, 0, kMany);
    visit("mesh.normal", m.normal, 0, kMany);
    visit("mesh.silhouette", m.silhouette, 0, kMany);
    visit("mesh.gradientClip", m.gradientClip, 0, kMany);
    visit("mesh.dilateMask", m.dilateMask, 0, 1);
    visit("mesh.balanceHeadings", m.balanceHeadings, 0, 1);
    visit("mesh.clamps", m.clamps, 0, 0);
    auto& t = preset.texture;
    visit("texture.size", t.size, 16, 4096);
    visit("texture.textureSize", t.textureSize, 16, 4096);
    visit("texture.width", t.width, 1, 512);
    visit("texture.depth", t.depth, 2, 12);
    visit("texture.batch", t.batch, 1, 256);
    visit("texture.steps", t.steps, 0, kMany);
    visit("texture.lr", t.lr, 0, 10);
    visit("texture.beta1", t.beta1, 0, .999999);
    visit("texture.beta2", t.beta2, 0, .999999);
    visit("texture.weightDecay", t.weightDecay, 0, 10);
    visit("texture.constantPart", t.constantPart, 0, 1);
    visit("texture.weight", t.weight, 0, kMany);
    visit("texture.dropout", t.dropout, 0, .99);
    visit("texture.region", t.region, 0, 0);
    visit("texture.constantInput", t.constantInput, 0, 1);
    auto& r = preset.refine;
    visit("refine.size", r.size, 16, 4096);
    visit("refine.width", r.width, 1, 512);
    visit("refine.depth", r.depth, 2, 12);
    visit("refine.discriminatorWidth", r.discriminatorWidth, 1, 512);
    visit("refine.faceSize", r.faceSize, 12, 4096);
    visit("refine.batch", r.batch, 1, 256);
    visit("refine.epochs", r.epochs, 0, kMany);
    visit("refine.steps", r.steps, 0, kMany);
    visit("refine.lr", r.lr, 1e-12, 10);
    visit("refine.lrDiscriminator", r.lrDiscriminator, 0, 10);
    visit("refine.beta1", r.beta1, 0, .999999);
    visit("refine.beta2", r.beta2, 0, .999999);
    visit("refine.weightDecay", r.weightDecay, 0, 10);
    visit("refine.constantPart", r.constantPart, 0, 1);
    visit("refine.dropout", r.dropout, 0, .99);
    visit("refine.loss", r.loss, 0, 0);
    visit("refine.adversarial", r.adversarial, 0, kMany);
    visit("refine.reconstruction", r.reconstruction, 0, kMany);
    visit("refine.misaligned", r.misaligned, 0, kMany);
    visit("refine.imageDiscriminator", r.imageDiscriminator, 0, 1);
    visit("refine.faceDiscriminator", r.faceDiscriminator, 0, 1);
    visit("refine.region", r.region, 0, 0);
    visit("refine.masks", r.masks, 0, 0);
    visit("refine.apart", r.apart, 0, 0);
    visit("refine.residual", r.residual, 0, 0);
    visit("refine.balanceHeadings", r.balanceHeadings, 0, 1);
}

// The words that a number that is a text may be.
std::vector<std::string_view> choicesOf(std::string_view name) {
    if (name == "mesh.clamps") return {"paper", "program", "none"};
    if (name == "refine.loss") return {"log", "squares"};
    if (name == "refine.masks") return {"region", "own"};
    if (name == "refine.apart") return {"different", "rendered"};
    if (name == "refine.residual") return {"clamped", "program"};
    return {"union", "intersection"};  // of the regions
}

std::string textOf(bool value) { return value ? "true" : "false"; }
std::string textOf(int value) { return fmt::format("{}", value); }
std::string textOf(double value) { return fmt::format("{}", value); }
std::string textOf(const std::string& value) { return value; }

// The whole text as a number, or nothing.
template <typename T>
bool parseNumber(std::string_view text, T& value) {
    if (text.starts_with('+')) text.remove_prefix(1);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size();
}

std::vector<std::string> namesInSection(const Preset& preset, std::string_view name) {
    const std::string section(name.substr(0, name.find('.')));
    std::vector<std::string> near, all;
    for (const auto& [known, value] : presetValues(preset)) {
        all.push_back(known);
        if (known.starts_with(section + ".")) near.push_back(known);
    }
    return near.empty() ? all : near;
}

}  // namespace

const std::vector<std::string>& presetNames() {
    static const std::vector<std::string> names{"ci", "small", "paper"};
    return names;
}

Preset presetByName(std::string_view name) {
    Preset preset;  // the declarations' values are the paper's
    preset.name = name;
    if (name == "paper") {
        return preset;
    }
    // What the authors' program does makes short runs steadier: clipped gradients, all sides seen
    // alike, one texture for all sides, which never learns the background. A network of fewer
    // features needs larger first weights, and one of fewer steps a higher rate and less smoothing.
    preset.mesh.gradientClip = 2;
    preset.mesh.balanceHeadings = true;
    preset.mesh.lr = 1e-3;
    preset.mesh.normal = .05;
    preset.mesh.batch = 1;
    preset.texture.constantInput = true;
    preset.texture.region = "intersection";
    preset.texture.batch = 1;
    preset.refine.balanceHeadings = true;
    preset.refine.region = "intersection";
    preset.refine.batch = 1;
    preset.refine.lr = 2e-3;
    preset.refine.lrDiscriminator = 2e-4;
    if (name == "small") {
        preset.mesh.hidden = 64;
        preset.mesh.deviation = .02;
        preset.mesh.lr = 5e-4;
        preset.mesh.steps = 1500;
        preset.texture.width = 16;
        preset.texture.steps = 600;
        preset.refine.width = 16;
        preset.refine.discriminatorWidth = 16;
        preset.refine.steps = 600;
        return preset;
    }
    if (name == "ci") {
        preset.fit.passes = 25;
        preset.mesh.blocks = 2;
        preset.mesh.layers = 3;
        preset.mesh.hidden = 32;
        preset.mesh.deviation = .03;
        preset.mesh.steps = 200;
        preset.texture.size = 256;
        preset.texture.textureSize = 256;
        preset.texture.depth = 8;
        preset.texture.width = 12;
        preset.texture.dropout = 0;
        preset.texture.steps = 400;
        preset.refine.size = 256;
        preset.refine.depth = 8;
        preset.refine.width = 12;
        preset.refine.discriminatorWidth = 8;
        preset.refine.faceSize = 40;
        preset.refine.dropout = 0;
        preset.refine.steps = 120;
        return preset;
    }
    throwInput("--preset: expected one of {}, found \"{}\"", fmt::join(presetNames(), ", "), name);
}

std::vector<std::pair<std::string, std::string>> presetValues(const Preset& preset) {
    std::vector<std::pair<std::string, std::string>> values;
    visitFields(preset, [&](const char* name, const auto& field, double, double) {
        values.emplace_back(name, textOf(field));
    });
    return values;
}

void setPresetValue(Preset& preset, std::string_view name, std::string_view value,
                    std::string_view where) {
    Preset changed = preset;
    bool known = false;
    visitFields(changed, [&](const char* field, auto& target, double lowest, double highest) {
        if (name != field) return;
        known = true;
        using T = std::remove_reference_t<decltype(target)>;
        if constexpr (std::is_same_v<T, std::string>) {
            const std::vector<std::string_view> choices = choicesOf(name);
            if (std::ranges::find(choices, value) == choices.end()) {
                throwInput("{}: {}: expected {}, found \"{}\"", where, name,
                           fmt::join(choices, " or "), value);
            }
            target = value;
        } else if constexpr (std::is_same_v<T, bool>) {
            if (value != "true" && value != "false") {
                throwInput("{}: {}: expected true or false, found \"{}\"", where, name, value);
            }
            target = value == "true";
        } else {
            const char* kind = std::is_integral_v<T> ? "a whole number" : "a number";
            T parsed{};
            if (!parseNumber(value, parsed) || !(double(parsed) >= lowest) ||
                !(double(parsed) <= highest)) {
                throwInput("{}: {}: expected {} from {} to {}, found \"{}\"", where, name, kind,
                           lowest, highest, value);
            }
            target = parsed;
        }
    });
    if (!known) {
        throwInput("{}: there is no number \"{}\"; there are {}", where, name,
                   fmt::join(namesInSection(preset, name), ", "));
    }
    preset = std::move(changed);
}

void checkPreset(const Preset& preset, std::string_view where) {
    const TexturePreset& t = preset.texture;
    if ((t.textureSize & (t.textureSize - 1)) != 0) {
        throwInput("{}: texture.textureSize: expected a power of two, found {}", where,
                   t.textureSize);
    }
    if (t.textureSize >> t.depth < 1) {
        throwInput("{}: texture.depth: expected at most {} for a texture of {} pixels, found {}",
                   where, std::bit_width(unsigned(t.textureSize)) - 1, t.textureSize, t.depth);
    }
    const RefinePreset& r = preset.refine;
    if (t.textureSize >> r.depth < 1) {
        throwInput("{}: refine.depth: expected at most {} for a texture of {} pixels, found {}",
                   where, std::bit_width(unsigned(t.textureSize)) - 1, t.textureSize, r.depth);
    }
}

}  // namespace doppel
