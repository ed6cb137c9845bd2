#include "trainer/avatar/preset.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <type_traits>

#include "engine/error.h"

namespace doppel {

namespace {

// Calls visit(dotted name, NumberInfo, member) for every number, in the order of the declaration.
template <typename P, typename Visit>
void visitNumbers(P&& preset, Visit visit) {
    auto section = [&](const std::string& name, auto& numbers) {
        std::remove_cvref_t<decltype(numbers)>::each(
            numbers, [&](const NumberInfo& info, auto& member) {
                visit(fmt::format("{}.{}", name, info.name), info, member);
            });
    };
#define VISIT_SECTION(Type, name) section(#name, preset.name);
    PRESET_SECTIONS(VISIT_SECTION)
#undef VISIT_SECTION
}

template <typename T>
std::string textOf(const NumberInfo& info, const T& value) {
    if constexpr (std::is_enum_v<T>)
        return info.words.at(static_cast<size_t>(value));
    else
        return fmt::format("{}", value);
}

// "1 to 256", "true or false", "union or intersection".
template <typename T>
std::string rangeOf(const NumberInfo& info, const T&) {
    if constexpr (std::is_enum_v<T>) return fmt::format("{}", fmt::join(info.words, " or "));
    if constexpr (std::is_same_v<T, bool>) return "true or false";
    return fmt::format("{} to {}", info.lowest, info.highest);
}

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
    static const std::vector<std::string> names{"ci", "small", "best", "paper"};
    return names;
}

const std::vector<std::string>& presetSections() {
#define SECTION_NAME(Type, name) #name,
    static const std::vector<std::string> sections{PRESET_SECTIONS(SECTION_NAME)};
#undef SECTION_NAME
    return sections;
}

void copySection(Preset& to, const Preset& from, std::string_view section) {
#define COPY_SECTION(Type, name) \
    if (section == #name) to.name = from.name;
    PRESET_SECTIONS(COPY_SECTION)
#undef COPY_SECTION
}

Preset presetByName(std::string_view name) {
    Preset preset;  // the declarations' values are the paper's
    preset.name = name;
    preset.texels.lrTheta = .005;
    preset.texels.lrTrans = .0015;
    preset.texels.lrOffsets = .03;
    preset.texels.lambda = 1;  // colours tell finer things than outlines do
    preset.texels.smooth = 50;
    preset.texels.lrTexels = .03;
    preset.texels.lrLight = .005;
    preset.texels.lrGain = .01;
    preset.texels.decay = .3;
    preset.texels.robust = .005;
    preset.texels.facing = 4;
    preset.texels.priorTheta = .02;
    preset.texels.priorTrans = .2;
    preset.texels.silhouette1 = 1;
    preset.texels.silhouette2 = .5;
    preset.texels.silhouette4 = .25;
    preset.texels.silhouette8 = 0;
    if (name == "paper") {
        return preset;
    }
    // What the authors' program does makes short runs steadier: clipped gradients, all sides seen
    // alike, one texture for all sides, which never learns the background. A network of fewer
    // features needs larger first weights, and one of fewer steps a higher rate and less smoothing.
    preset.mesh.gradientClip = 2;
    preset.mesh.balanceHeadings = true;
    preset.mesh.loss = SilhouetteLoss::Edges;
    // The body has a surface of its own by then, which is not to be smoothed away.
    preset.mesh.laplacian = 0;
    preset.mesh.colour = 4;
    preset.mesh.stay = 10;
    preset.mesh.smooth = 3000;
    preset.fit.priorFew = .2;
    preset.fit.likely = .004;
    preset.fit.limits = .5;
    preset.fit.balance = .02;
    preset.fit.priorBeta = 3e-4;
    preset.fit.keypoints = .3;  // what clothes stand off, outlines would have the body fill
    preset.texels.others = 60;
    // What clothes stand off would take limbs into the body that hang beside it.
    preset.shape.keypoints = .3;
    preset.texels.keypoints = .1;
    preset.shape.facePoints = preset.texels.facePoints = .3;
    preset.shape.hands = preset.texels.hands = 1e4;
    preset.mesh.hands = 1000;
    preset.shape.toes = preset.texels.toes = .008;
    preset.shape.lrHands = .02;
    preset.texels.cleanHands = true;
    preset.texels.fine = .25;
    preset.texture.texel = .9;
    preset.mesh.lr = 5e-4;
    preset.mesh.normal = 0;
    preset.mesh.batch = 1;
    preset.texture.constantInput = true;
    preset.texture.region = Region::Intersection;
    preset.texture.batch = 1;
    preset.refine.balanceHeadings = true;
    preset.refine.region = Region::Intersection;
    preset.refine.batch = 1;
    preset.refine.lr = 2e-3;
    preset.refine.lrDiscriminator = 2e-4;
    if (name == "small" || name == "best") {
        preset.mesh.hidden = 64;
        preset.mesh.deviation = .02;
        preset.fit.sigma = 1e-6;
        preset.caps.cell = .01;
        preset.texture.textureSize = 0;
        preset.shape.size = preset.texels.size = 512;
        preset.shape.steps = 500;
        preset.shape.coarse = .6;
        // People let their hands hang half closed; the actors hold theirs as the model does.
        preset.shape.ease = 1;
        preset.shape.folds = preset.texels.folds = 30;
        preset.texels.steps = 400;
        preset.texels.samples = 2;
        // Real poses are off by more than the actors', and few frames may show a texel: neither is
        // to be answered by creases and noise.
        preset.texels.lambda = 4;
        preset.texels.smooth = 200;
        preset.texels.lrOffsets = .02;
        preset.texels.face = 1e4;
        preset.texels.stayTexels = 16;
        preset.texels.seams = .3;
        // Where poses are off, surfaces crease, and a crease's sides face other views than the skin
        // around them does: whoever sees a place best would paint streaks. Eyes and mouths that
        // views have in other places become one where the best view decides; on a face that is
        // told by the bare body, which has no creases.
        // Of few frames no mean is left of a button, or a fold, that each has elsewhere.
        preset.texels.facing = 0;
        preset.texels.facingFace = 4;
        preset.texels.facingMiddle = .6;
        preset.texels.facingFew = 3;
        preset.texels.rim = 4;
        preset.texels.robust = .02;
        preset.mesh.steps = 300;
        preset.texture.width = 16;
        preset.texture.steps = 150;
        preset.refine.width = 16;
        preset.refine.discriminatorWidth = 16;
        preset.refine.steps = 150;
        if (name == "small") return preset;
        // Texels as fine as a near camera's pixels, and time to settle.
        preset.texture.textureSize = 1024;
        preset.shape.steps = 800;
        preset.shape.size = preset.texels.size = 768;
        preset.texels.steps = 1200;
        preset.texels.lrTexels = .01;
        preset.texels.decay = .1;
        preset.mesh.hidden = 128;
        preset.mesh.steps = 1000;
        preset.texture.width = 32;
        preset.texture.steps = 600;
        preset.refine.width = 32;
        preset.refine.discriminatorWidth = 32;
        preset.refine.steps = 1000;
        return preset;
    }
    if (name == "ci") {
        preset.fit.passes = 25;
        preset.fit.sigma = 1e-6;
        preset.caps.cell = .01;
        preset.shape.size = preset.texels.size = 512;  // the demo's frames, pixel for pixel
        preset.shape.steps = 200;
        preset.shape.coarse = .6;
        // Steps over small crops are bold, and fold faces where nothing else holds them.
        preset.shape.folds = preset.texels.folds = 30;
        preset.texels.steps = 400;
        preset.texels.coarse = .5;
        preset.mesh.blocks = 2;
        preset.mesh.layers = 3;
        preset.mesh.hidden = 32;
        preset.mesh.deviation = .03;
        preset.mesh.size = 512;
        preset.mesh.stay = 200;  // poses and texels were found without the network
        preset.mesh.steps = 150;
        preset.texture.size = 256;
        preset.texture.textureSize = 512;  // texels of about a pixel,
        preset.texture.block = 2;          // painted at the cost of whole ones
        preset.texture.depth = 8;
        preset.texture.width = 12;
        preset.texture.dropout = 0;
        preset.texture.steps = 50;
        preset.refine.size = 256;
        preset.refine.depth = 8;
        preset.refine.width = 12;
        preset.refine.discriminatorWidth = 8;
        preset.refine.faceSize = 40;
        preset.refine.dropout = 0;
        preset.refine.steps = 70;
        return preset;
    }
    throwInput("--preset: expected one of {}, found \"{}\"", fmt::join(presetNames(), ", "), name);
}

std::vector<std::pair<std::string, std::string>> presetValues(const Preset& preset) {
    std::vector<std::pair<std::string, std::string>> values;
    visitNumbers(preset, [&](const std::string& name, const NumberInfo& info, const auto& member) {
        values.emplace_back(name, textOf(info, member));
    });
    return values;
}

void setPresetValue(Preset& preset, std::string_view name, std::string_view value,
                    std::string_view where) {
    Preset changed = preset;
    bool known = false;
    visitNumbers(changed, [&](const std::string& number, const NumberInfo& info, auto& member) {
        if (name != number) return;
        known = true;
        using T = std::remove_reference_t<decltype(member)>;
        auto expected = [&](std::string_view kind) {
            throwInput("{}: {}: expected {}{}, found \"{}\"", where, name, kind,
                       rangeOf(info, member), value);
        };
        if constexpr (std::is_enum_v<T>) {
            auto word = std::ranges::find(info.words, value);
            if (word == info.words.end()) expected("");
            member = static_cast<T>(word - info.words.begin());
        } else if constexpr (std::is_same_v<T, bool>) {
            if (value != "true" && value != "false") expected("");
            member = value == "true";
        } else {
            T parsed{};
            if (!parseNumber(value, parsed) || !(double(parsed) >= info.lowest) ||
                !(double(parsed) <= info.highest))
                expected(std::is_integral_v<T> ? "a whole number from " : "a number from ");
            member = parsed;
        }
    });
    if (!known) {
        throwInput("{}: there is no number \"{}\"; there are {}", where, name,
                   fmt::join(namesInSection(preset, name), ", "));
    }
    preset = std::move(changed);
}

std::string presetHelp() {
    std::vector<std::vector<std::pair<std::string, std::string>>> values;
    for (const std::string& name : presetNames())
        values.push_back(presetValues(presetByName(name)));
    std::string text = fmt::format("{:<28}", "number");
    for (const std::string& name : presetNames()) text += fmt::format(" {:<13}", name);
    text += fmt::format(" {:<24} meaning\n", "range");
    size_t row = 0;
    visitNumbers(presetByName("paper"), [&](const std::string& name, const NumberInfo& info,
                                            const auto& member) {
        text += fmt::format("{:<28}", name);
        for (const auto& column : values) text += fmt::format(" {:<13}", column[row].second);
        std::string range = info.highest >= kNoLimit ? fmt::format("{} or more", info.lowest)
                                                     : rangeOf(info, member);
        text += fmt::format(" {:<24} {}\n", range, info.help);
        ++row;
    });
    return text;
}

void checkPreset(const Preset& preset, std::string_view where) {
    const TexturePreset& t = preset.texture;
    constexpr double kLeastCell = .005;  // of which a body has some ten million around it
    if (preset.caps.cell != 0 && preset.caps.cell < kLeastCell)
        throwInput("{}: caps.cell: expected 0 or at least {}, found {}", where, kLeastCell,
                   preset.caps.cell);
    constexpr int kLeastSide = 16;  // texels
    if ((t.textureSize & (t.textureSize - 1)) != 0 ||
        (t.textureSize != 0 && t.textureSize < kLeastSide))
        throwInput("{}: texture.textureSize: expected 0 or a power of two from {} on, found {}",
                   where, kLeastSide, t.textureSize);
    const int texels = t.textureSize == 0 ? kLeastSideByFrames : t.textureSize;
    if ((t.block & (t.block - 1)) != 0 || t.block > texels)
        throwInput("{}: texture.block: expected a power of two, found {}", where, t.block);
    auto fits = [&](std::string_view name, int depth) {
        const int side = texels / t.block;
        if (side >> depth < 1)
            throwInput(
                "{}: {}: expected at most {} for a texture of {} texels in blocks of {}, found {}",
                where, name, std::bit_width(unsigned(side)) - 1, texels, t.block, depth);
    };
    fits("texture.depth", t.depth);
    fits("refine.depth", preset.refine.depth);
}

}  // namespace doppel
