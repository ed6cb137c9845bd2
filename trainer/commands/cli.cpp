#include "trainer/commands/cli.h"

#include <fmt/ranges.h>

#include <toml++/toml.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <new>
#include <set>
#include <system_error>

#include "engine/atomic_file.h"
#include "engine/error.h"
#include "trainer/data/progress.h"
#include "trainer/data/version.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Flags of every subcommand, and those that several share.
struct Shared {
    CommonOptions common;
    fs::path config;
    std::string preset;
    std::vector<std::string> set;
};

void addCommon(CLI::App& command, Shared& shared) {
    command.get_formatter()->column_width(32);
    command
        .add_option("--device", shared.common.device,
                    "Vulkan device: part of its name or its number in `doppel devices`")
        ->group("Common");
    command.add_option("--seed", shared.common.seed, "Same seed, same device: same result")
        ->capture_default_str()
        ->check(CLI::NonNegativeNumber)
        ->group("Common");
    command.add_flag("--json", shared.common.json, "Print the result as one JSON object")
        ->group("Common");
    command
        .add_option("--config", shared.config, "TOML file with options as keys; flags win over it")
        ->group("Common");
}

void addPrecision(CLI::App& command, Shared& shared) {
    command
        .add_option("--precision", shared.common.precision,
                    "Of the networks' products: fp32; mixed: inputs in half, sums in single "
                    "precision, on matrix units where the device has them (`doppel devices`)")
        ->capture_default_str()
        ->check(CLI::IsMember({"fp32", "mixed"}))
        ->group("Common");
}

void addPreset(CLI::App& command, Shared& shared, const char* preset) {
    shared.preset = preset;
    command
        .add_option("--preset", shared.preset,
                    fmt::format("Sizes, steps and rates: {}", fmt::join(presetNames(), ", ")))
        ->capture_default_str();
    command
        .add_option("--set", shared.set,
                    "One number of the preset, as NAME=VALUE (mesh.batch=8); may be repeated")
        ->type_name("NAME=VALUE")
        ->take_all()
        ->allow_extra_args(false);
}

void addBody(CLI::App& command, std::string& body) {
    body = "default";
    command
        .add_option("--body", body,
                    "Body model: default, default-full, or SMPL's own .npz or .pkl file")
        ->capture_default_str();
}

void addFrames(CLI::App& command, std::string& frames, const char* what) {
    command.add_option(
        "--frames", frames,
        fmt::format("{}: a:b is from a up to but not b, a:b:step, lists with commas; "
                    "negative numbers count from the end",
                    what));
}

void addTexture(CLI::App& command, std::string& texture) {
    command
        .add_option("--texture", texture,
                    "coarse, refined (for each view), baked (one for all views), or best: refined "
                    "where the avatar has it")
        ->capture_default_str();
}

void addScene(CLI::App& command, std::string& scene) {
    command
        .add_option("--scene", scene,
                    "frame: the frame's own pixels away from the mask, the median over time on it; "
                    "median: that everywhere; or a picture of the empty scene")
        ->capture_default_str();
}

void addMeasures(CLI::App& command, MeasureOptions& measures) {
    command
        .add_option(
            "--lpips", measures.lpips,
            "Weights for LPIPS, .safetensors or .pth: torchvision's network and LPIPS 0.1's "
            "heads, in two files or one")
        ->delimiter(',')
        ->type_name("FILE[,FILE]");
    command.add_option("--lpips-net", measures.lpipsNet, "Their network: alex, vgg or squeeze")
        ->capture_default_str();
    command
        .add_option("--fvd", measures.fvd,
                    "Weights of Inception-3D (RGB, Kinetics) for FVD, .safetensors or .pt")
        ->type_name("FILE");
}

// A TOML value as the words that a flag would be given.
std::vector<std::string> wordsOf(const toml::node& node, const std::string& where) {
    if (const auto* list = node.as_array()) {
        std::vector<std::string> words;
        for (const toml::node& element : *list) {
            for (std::string& word : wordsOf(element, where)) words.push_back(std::move(word));
        }
        return words;
    }
    if (const auto* text = node.as_string()) return {text->get()};
    if (const auto* whole = node.as_integer()) return {fmt::format("{}", whole->get())};
    if (const auto* number = node.as_floating_point()) return {fmt::format("{}", number->get())};
    if (const auto* flag = node.as_boolean()) return {flag->get() ? "true" : "false"};
    throwInput("{}: expected a text, a number, true or false, or a list of these", where);
}

toml::table readConfig(const fs::path& path) {
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{1} << 20);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    try {
        return toml::parse(text, path.string());
    } catch (const toml::parse_error& error) {
        throwInput("{}: line {}: not TOML: {}", path.string(), error.source().begin.line,
                   error.description());
    }
}

// Gives the command's options that were not typed their values from the file. Positional arguments
// are typed always.
void applyConfig(const toml::table& config, const fs::path& path, CLI::App& command,
                 CLI::App& app) {
    const auto optionOf = [](CLI::App& of, const std::string& key) -> CLI::Option* {
        CLI::Option* option = of.get_option_no_throw("--" + key);
        return option && key != "help" && key != "config" ? option : nullptr;
    };
    for (const auto& [tomlKey, node] : config) {
        const std::string key(tomlKey.str());
        const std::string where = fmt::format("{}: {}", path.string(), key);
        if (node.is_table()) {
            if (key == "fit" || key == "mesh" || key == "texture" || key == "refine")
                continue;  // the preset's
            throwInput("{}: expected a table fit, mesh, texture or refine, found another", where);
        }
        const auto subcommands = app.get_subcommands([](CLI::App*) { return true; });
        if (std::none_of(subcommands.begin(), subcommands.end(),
                         [&](CLI::App* c) { return optionOf(*c, key); })) {
            throwInput("{}: expected the name of an option, found one that no command has", where);
        }
        CLI::Option* option = optionOf(command, key);
        if (option == nullptr || option->count() > 0) continue;
        const std::vector<std::string> words = wordsOf(node, where);
        if (words.empty()) continue;
        try {
            option->add_result(words);
            option->run_callback();
        } catch (const CLI::Error& error) {
            throwInput("{}: {}", where, error.what());
        }
    }
}

Preset presetOf(const Shared& shared, const toml::table& config) {
    Preset preset = presetByName(shared.preset);
    for (const char* section : {"fit", "mesh", "texture", "refine"}) {
        const toml::table* table = config[section].as_table();
        if (table == nullptr) continue;
        for (const auto& [key, node] : *table) {
            const std::string name = fmt::format("{}.{}", section, key.str());
            const auto words = wordsOf(node, fmt::format("{}: {}", shared.config.string(), name));
            if (words.size() != 1) {
                throwInput("{}: {}: expected one value, found {}", shared.config.string(), name,
                           words.size());
            }
            setPresetValue(preset, name, words[0], shared.config.string());
        }
    }
    for (const std::string& text : shared.set) {
        const size_t equals = text.find('=');
        if (equals == std::string::npos) {
            throwInput("--set: expected NAME=VALUE (mesh.batch=8), found \"{}\"", text);
        }
        setPresetValue(preset, text.substr(0, equals), text.substr(equals + 1), "--set");
    }
    checkPreset(preset, shared.preset);
    return preset;
}

std::vector<std::string> stagesOf(const std::vector<std::string>& words) {
    static const std::vector<std::string> all{"fit", "mesh", "texture", "refine"};
    std::set<std::string> wanted;
    for (const std::string& word : words) {
        if (std::find(all.begin(), all.end(), word) == all.end()) {
            throwInput("--stages: expected some of {}, found \"{}\"", fmt::join(all, ","), word);
        }
        wanted.insert(word);
    }
    std::vector<std::string> stages;
    for (const std::string& stage : all) {
        if (wanted.contains(stage)) stages.push_back(stage);
    }
    if (stages.empty())
        throwInput("--stages: expected some of {}, found none", fmt::join(all, ","));
    return stages;
}

void checkBackground(const std::string& text) {
    if (text == "capture") return;
    const bool colour = text.size() == 7 && text[0] == '#' &&
                        text.find_first_not_of("0123456789abcdefABCDEF", 1) == std::string::npos;
    if (!colour) {
        throwInput("--background: expected capture or a colour as #rrggbb, found \"{}\"", text);
    }
}

// What CLI11 found wrong, as our one line.
std::string parseSentence(const CLI::App& app, const CLI::ParseError& error) {
    const auto chosen = app.get_subcommands();
    const std::string name = chosen.empty() ? "doppel" : "doppel " + chosen[0]->get_name();
    std::string sentence = error.what();
    std::replace(sentence.begin(), sentence.end(), '\n', ' ');
    while (!sentence.empty() && (sentence.back() == ' ' || sentence.back() == '.')) {
        sentence.pop_back();
    }
    if (dynamic_cast<const CLI::RequiredError*>(&error) && chosen.empty()) {
        sentence = "a command is missing";
    }
    return fmt::format("{}: {}; `{} --help` tells more", name, sentence, name);
}

struct CommandLine {
    CLI::App app{"Doppel makes a controllable avatar of a recorded person.", "doppel"};
    // One set per subcommand, since defaults differ.
    std::map<std::string, Shared> shared;
    ImportOptions import;
    FitOptions fit;
    TrainOptions train;
    RenderOptions render;
    EvalOptions eval;
    AblateOptions ablate;
    ExportOptions exporting;
    ViewOptions view;
    DemoOptions demo;

    CommandLine() {
        app.require_subcommand(1);
        app.set_version_flag("--version", std::string("doppel ") + kVersion);
        app.footer(
            "From a capture to an avatar that dances somebody else's motion:\n"
            "  doppel import SRC --out capture\n"
            "  doppel fit capture --out fitted\n"
            "  doppel train fitted --out avatar --preset small\n"
            "  doppel render avatar --motion other-capture --out dance.mp4\n"
            "\n`doppel COMMAND --help` tells more. Exit status: 0 done, 1 it failed, 2 the input "
            "or\n"
            "the flags are wrong, 130 interrupted.");
        addDevices();
        addImport();
        addFit();
        addTrain();
        addRender();
        addEval();
        addAblate();
        addExport();
        addView();
        addDemo();
        add("bench", "Say where doppel-bench is, which measures the device", "doppel bench");
    }

    CLI::App& add(const char* name, const char* description, const std::string& example) {
        CLI::App& command = *app.add_subcommand(name, description);
        command.footer("Example:\n  " + example);
        addCommon(command, shared[name]);
        for (const char* withNetworks :
             {"train", "render", "eval", "ablate", "export", "view", "demo"})
            if (std::string_view(name) == withNetworks) addPrecision(command, shared[name]);
        return command;
    }

    void addDevices() {
        add("devices", "List every Vulkan device, its limits, and why one is refused",
            "doppel devices --json");
    }

    void addImport() {
        CLI::App& c = add("import", "Bring another program's layout into a capture",
                          "doppel import retargeting/box --out box --key");
        c.description(
            "Brings another program's layout into a capture. The layout is detected: the Human\n"
            "Retargeting dataset's (images/, smpl_pose/*_body.pkl, segmentations/ if there are "
            "any),\nor a capture of Doppel's own. Draws the given pose over each frame "
            "(overlay.jpg, overlays/).");
        c.add_option("SRC", import.source, "Folder to read")->required();
        c.add_option("--out", import.out, "Capture to write")->required();
        c.add_flag("--key", import.key, "Make masks from a green screen for frames that have none");
        c.add_option("--fps", import.fps, "Frames per second of the recording")
            ->capture_default_str()
            ->check(CLI::Range(.01, 1000.));
        addFrames(c, import.frames, "Frames to take");
        addBody(c, import.body);
        c.add_flag("!--no-overlays", import.overlays, "Leave the overlay pictures out");
    }

    void addFit() {
        CLI::App& c = add("fit", "Refine shape, poses and positions until the body fills the masks",
                          "doppel fit capture --out fitted");
        c.add_option("CAPTURE", fit.capture, "Capture to read; it needs masks")->required();
        c.add_option("--out", fit.out, "Capture to write")->required();
        addFrames(c, fit.frames, "Frames to fit and write");
        addBody(c, fit.body);
        addPreset(c, shared["fit"], "small");
    }

    void addTrain() {
        CLI::App& c = add("train", "Learn an avatar's mesh and texture from a capture",
                          "doppel train fitted --out avatar --preset small --stages mesh,texture");
        c.add_option("CAPTURE", train.capture, "Capture to read; it needs masks")->required();
        c.add_option("--out", train.out, "Avatar's folder to write")->required();
        train.stages = {"fit", "mesh", "texture", "refine"};
        c.add_option("--stages", train.stages, "Some of fit,mesh,texture,refine")
            ->delimiter(',')
            ->capture_default_str();
        c.add_flag("!--no-refine", train.refine, "Leave stage refine out: the coarse texture");
        c.add_flag("!--no-gan", train.gan, "Refine without discriminators");
        c.add_flag("!--no-face", train.face, "Refine without the face discriminator");
        c.add_flag("!--no-clamp", train.clamp, "Let the mesh network move vertices freely");
        addFrames(c, train.frames, "Frames to learn from");
        addBody(c, train.body);
        addPreset(c, shared["train"], "small");
        CLI::Option* resume = c.add_flag(
            "--resume", train.resume,
            "Only go on with the unfinished run in the avatar's folder, which happens without it "
            "as well; refuse to start one");
        c.add_flag("--restart", train.restart,
                   "Start over where an unfinished run is in the avatar's folder")
            ->excludes(resume);
        c.add_option("--checkpoint-every", train.checkpointSeconds,
                     "Seconds between checkpoints; 0: only at Ctrl-C")
            ->capture_default_str()
            ->check(CLI::NonNegativeNumber);
        c.add_option("--picture-every", train.pictureSeconds,
                     "Seconds between pictures of the state; 0: none")
            ->capture_default_str()
            ->check(CLI::NonNegativeNumber);
        c.add_flag("--view", train.view,
                   "Open a window (`doppel view`) that shows the present state; the result is the "
                   "same, and closing it does not stop the training");
        c.add_option("--profile", train.profileSteps,
                     "Run so many steps of each stage, print memory and time per op, keep nothing")
            ->check(CLI::Range(1, 1000));
        c.add_option("--memory", train.memoryBudget,
                     "Device memory to use at most (6GB, 512MB); default: what the device has")
            ->transform(CLI::AsSizeValue(false));
    }

    void addRender() {
        CLI::App& c =
            add("render", "Put the avatar into the poses of a motion and draw it",
                "doppel render avatar --motion box --camera turntable --background \"#ffffff\" "
                "--out dance.mp4");
        c.add_option("AVATAR", render.avatar, "Avatar's folder")->required();
        c.add_option("--motion", render.motion, "A capture, a poses.npz or a .bvh")->required();
        c.add_option("--out", render.out, "FILE.mp4, or a folder for PNG pictures")->required();
        c.add_option("--camera", render.camera, "capture, turntable, or a cameras.npz")
            ->capture_default_str();
        c.add_option("--background", render.background, "capture, or a colour as \"#rrggbb\"")
            ->capture_default_str();
        addTexture(c, render.texture);
        c.add_option("--smooth", render.smooth,
                     "Smooth the motion: standard deviation in frames of a Gaussian over time, on "
                     "rotations and positions; 0: none")
            ->capture_default_str()
            ->check(CLI::Range(0., 100.));
        c.add_option("--size", render.size, "Pixels of the picture's longer side; 0: the camera's")
            ->capture_default_str()
            ->check(CLI::Range(0, 8192));
        c.add_option("--fps", render.fps, "Frames per second of the film; 0: the motion's")
            ->capture_default_str()
            ->check(CLI::Range(0., 1000.));
        addFrames(c, render.frames, "Frames of the motion to draw");
    }

    void addEval() {
        CLI::App& c = add("eval", "Compare the avatar with the frames of a capture, or of many",
                          "doppel eval avatar capture --frames 90:120 --fit-test-poses --json\n"
                          "  doppel eval avatars captures --out results");
        c.description(
            "Draws the avatar in each frame's pose over the frame's background, and compares it "
            "with\nthe whole frame. Of a folder of captures, FOLDER/ACTOR/MOTION (actor and motion "
            "in\ncapture.toml win over the folders' names), it prints the paper's tables: by "
            "motion, by\nactor, on average, beside the paper's own figures; AVATAR is then one "
            "avatar for all, or a\nfolder of them, AVATAR/ACTOR.");
        c.add_option("AVATAR", eval.avatar, "Avatar's folder, or a folder of avatars by actor")
            ->required();
        c.add_option("CAPTURE", eval.capture, "Capture with masks, or a folder of captures")
            ->required();
        addFrames(c, eval.frames, "Frames to compare");
        addTexture(c, eval.texture);
        c.add_flag("--fit-test-poses", eval.fitTestPoses,
                   "Fit poses and positions (not shape) to these frames first");
        addScene(c, eval.scene);
        addMeasures(c, eval.measures);
        c.add_option("--out", eval.out, "Folder for results.json, results.csv and results.md");
        c.add_option("--pictures", eval.pictures,
                     "Folder for render, frame and difference side by side");
    }

    void addAblate() {
        CLI::App& c = add("ablate", "Train the paper's ablations on one capture and compare them",
                          "doppel ablate capture --frames 0:90 --test-frames 90:120 "
                          "--fit-test-poses --out ablation");
        c.description(
            "Trains the variants of the paper's ablation study and prints its table 2 with our "
            "figures:\nno-refine (coarse texture), no-clamp (unbounded offsets), complete, and "
            "no-gan, no-face\n(without discriminators, without the face's). What variants have in "
            "common is trained once.\nThe same command goes on where it was stopped. Avatars and "
            "ablation.json, .csv, .md are left\nin the folder.");
        c.add_option("CAPTURE", ablate.capture, "Capture to read; it needs masks")->required();
        c.add_option("--out", ablate.out, "Folder to write")->required();
        addFrames(c, ablate.frames, "Frames to learn from");
        c.add_option("--test-frames", ablate.testFrames,
                     "Frames to measure on; without it, those of the training");
        c.add_flag("--fit-test-poses", ablate.fitTestPoses,
                   "Fit poses and positions (not shape) to the test frames first");
        c.add_option("--variants", ablate.variants,
                     "Some of no-refine,no-clamp,complete,no-gan,no-face")
            ->delimiter(',');
        addBody(c, ablate.body);
        addPreset(c, shared["ablate"], "small");
        addScene(c, ablate.scene);
        addMeasures(c, ablate.measures);
        c.add_option("--pictures", ablate.pictures,
                     "Folder for render, frame and difference side by side");
        c.add_option("--memory", ablate.memoryBudget,
                     "Device memory to use at most (6GB, 512MB); default: what the device has")
            ->transform(CLI::AsSizeValue(false));
    }

    void addExport() {
        CLI::App& c = add("export", "Write the avatar as glTF: skinned mesh, texture, animation",
                          "doppel export avatar --out avatar.glb --motion capture");
        c.add_option("AVATAR", exporting.avatar, "Avatar's folder")->required();
        c.add_option("--out", exporting.out, "FILE.glb")->required();
        c.add_option("--motion", exporting.motion,
                     "A capture, a poses.npz or a .bvh, which becomes an animation");
        addFrames(c, exporting.frames, "Frames of the motion");
        c.add_option("--texture", exporting.texture,
                     "baked (the refined textures of many views in one), coarse, or best: baked "
                     "where there is one")
            ->capture_default_str();
    }

    void addView() {
        CLI::App& c = add("view", "Open a window: drag the joints, turn the camera, play motions",
                          "doppel view avatar --motion capture");
        c.description(
            "Opens a window with the avatar. Drag a joint and the limb follows, turn the camera "
            "with the\nleft or middle button, press H for all keys. While a training runs in the "
            "avatar's folder its\npresent state is shown.");
        c.add_option("AVATAR", view.avatar, "Avatar's folder")->required();
        c.add_option("--motion", view.motion, "A capture, a poses.npz or a .bvh to play");
        addFrames(c, view.frames, "Frames of the motion");
        c.add_option("--pose", view.pose, "A pose to begin with, JSON as the viewer copies it");
        c.add_option_function<std::string>(
             "--size",
             [this](const std::string& text) {
                 int used = 0;
                 if (std::sscanf(text.c_str(), "%dx%d%n", &view.width, &view.height, &used) != 2 ||
                     static_cast<size_t>(used) != text.size() || view.width < 200 ||
                     view.height < 150 || view.width > 8192 || view.height > 8192)
                     throw CLI::ValidationError(
                         "--size", fmt::format("expected WIDTHxHEIGHT, 200x150 to 8192x8192, "
                                               "found \"{}\"",
                                               text));
             },
             "The window's size, WIDTHxHEIGHT")
            ->default_str("1280x800");
    }

    void addDemo() {
        CLI::App& c = add("demo", "The whole job on the synthetic actor that comes with Doppel",
                          "doppel demo --out out/demo");
        c.add_option("--out", demo.out, "Folder to write")->capture_default_str();
        c.add_option("--actor", demo.actor, "woman or man")
            ->check(CLI::IsMember({"woman", "man"}))
            ->capture_default_str();
        addPreset(c, shared["demo"], "ci");
    }
};

int statusOf(const std::function<void()>& run, std::ostream& err) {
    try {
        run();
        return 0;
    } catch (const Interrupted& stop) {
        err << "doppel: interrupted" << (stop.kept.empty() ? "" : "; kept: ") << stop.kept << "\n";
        return interruptStatus();
    } catch (const InputError& error) {
        err << "doppel: " << error.what() << "\n";
        return 2;
    } catch (const std::bad_alloc&) {
        err << "doppel: the machine's memory is used up\n";
    } catch (const std::exception& error) {  // MachineError among them
        err << "doppel: " << error.what() << "\n";
    }
    return 1;
}

}  // namespace

int runCommandLine(const std::vector<std::string>& arguments, const Commands& commands,
                   std::ostream& out, std::ostream& err) {
    CommandLine line;
    std::vector<std::string> names;
    for (const CLI::App* c : line.app.get_subcommands([](CLI::App*) { return true; })) {
        names.push_back(c->get_name());
    }
    if (!arguments.empty() && !arguments[0].starts_with('-') &&
        std::find(names.begin(), names.end(), arguments[0]) == names.end()) {
        err << fmt::format("doppel: there is no command \"{}\"; there are {}\n", arguments[0],
                           fmt::join(names, ", "));
        return 2;
    }
    try {
        // CLI11 takes them from the back.
        line.app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
    } catch (const CLI::Success& success) {  // --help, --version
        return line.app.exit(success, out, err);
    } catch (const CLI::ParseError& error) {
        err << parseSentence(line.app, error) << "\n";
        return 2;
    }
    CLI::App& command = *line.app.get_subcommands().front();
    const std::string name = command.get_name();
    Shared& shared = line.shared.at(name);
    shared.common.commandLine = fmt::format("doppel {}", fmt::join(arguments, " "));
    return statusOf(
        [&] {
            toml::table config;
            if (!shared.config.empty()) {
                config = readConfig(shared.config);
                applyConfig(config, shared.config, command, line.app);
            }
            const auto run = [&](auto& options, const auto& function) {
                options.common = shared.common;
                if constexpr (requires { options.preset; }) {
                    options.preset = presetOf(shared, config);
                }
                function(options);
            };
            DevicesOptions devices;
            if (name == "devices") run(devices, commands.devices);
            if (name == "import") run(line.import, commands.import);
            if (name == "fit") run(line.fit, commands.fit);
            if (name == "train") {
                line.train.stages = stagesOf(line.train.stages);
                if (!line.train.refine) std::erase(line.train.stages, "refine");
                if (line.train.stages.empty())
                    throwInput("--no-refine: stage refine is all that --stages asks for");
                run(line.train, commands.train);
            }
            if (name == "render") {
                checkBackground(line.render.background);
                run(line.render, commands.render);
            }
            if (name == "eval") run(line.eval, commands.eval);
            if (name == "ablate") run(line.ablate, commands.ablate);
            if (name == "export") {
                if (line.exporting.out.extension() != ".glb") {
                    throwInput("--out: expected a name that ends in .glb, found \"{}\"",
                               line.exporting.out.string());
                }
                run(line.exporting, commands.exportAvatar);
            }
            if (name == "view") run(line.view, commands.view);
            if (name == "demo") run(line.demo, commands.demo);
            if (name == "bench") commands.bench();
        },
        err);
}

}  // namespace doppel
