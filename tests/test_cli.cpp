#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <tuple>

#include "engine/error.h"
#include "tests/files.h"
#include "trainer/commands/ablate.h"
#include "trainer/commands/cli.h"
#include "trainer/commands/clips/import.h"
#include "trainer/commands/demo.h"
#include "trainer/commands/eval.h"
#include "trainer/commands/export.h"
#include "trainer/commands/render.h"
#include "trainer/commands/train.h"
#include "trainer/data/progress.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

// A command that this file adds: whether it is shown, parsed and run like the others.
struct GreetOptions {
    CommonOptions common;
    std::filesystem::path out;
    Preset preset;
    int times = 1;
};
int greeted = 0;

const Command<GreetOptions> kGreet{{
    .name = "greet",
    .place = 35,
    .summary = "Say hello",
    .description = "Says hello, once or more.",
    .example = "doppel greet --times 2",
    .flags =
        [](CommandFlags& flags, GreetOptions& o) {
            flags.path("--out", o.out, "Where to");
            flags->add_option("--times", o.times, "How often");
            flags.preset("ci");
        },
    .check =
        [](GreetOptions& o) {
            if (o.times == 13) throwInput("--times: expected another number, found 13");
        },
    .run = [](const GreetOptions& o) { greeted += o.times; },
}};

// What one command line leads to: the options of the one command that was called.
struct Outcome {
    int status = -1;
    std::string called, out, err;
    ImportOptions import;
    TrainOptions train;
    RenderOptions render;
    EvalOptions eval;
    AblateOptions ablate;
    ExportOptions exporting;
    DemoOptions demo;
    GreetOptions greet;
    CommonOptions common;
};

Outcome run(
    const std::vector<std::string>& arguments, const std::function<void()>& during = [] {}) {
    Outcome o;
    std::ostringstream out, err;
    o.status = runCommandLine(arguments, out, err, [&](const ParsedCommand& command) {
        const auto keep = [&]<typename Options>(Options& place) {
            if (const auto* options = std::any_cast<Options>(&command.options)) place = *options;
        };
        keep(o.import), keep(o.train), keep(o.render), keep(o.eval), keep(o.ablate);
        keep(o.exporting), keep(o.demo), keep(o.greet);
        o.called = command.name;
        o.common = command.common;
        during();
    });
    o.out = out.str();
    o.err = err.str();
    return o;
}

TEST(CommandLine, ACommandIsOneDeclaration) {
    const Outcome o = run({"greet", "--times", "3", "--set", "mesh.batch=2", "--seed", "4"});
    EXPECT_EQ(o.status, 0) << o.err;
    EXPECT_EQ(o.called, "greet");
    EXPECT_EQ(o.greet.times, 3);
    EXPECT_EQ(o.greet.common.seed, 4u);
    EXPECT_EQ(o.greet.preset.mesh.batch, 2);
    EXPECT_EQ(run({"greet", "--times", "13"}).err,
              "doppel: --times: expected another number, found 13\n");
    const std::string help = run({"--help"}).out;
    EXPECT_LT(help.find("\n  fit "), help.find("\n  greet "));
    EXPECT_LT(help.find("\n  greet "), help.find("\n  train "));
    EXPECT_NE(run({"greet", "--help"}).out.find("Says hello, once or more."), std::string::npos);
    // Without anything in its place, the command itself runs.
    std::ostringstream out, err;
    EXPECT_EQ(runCommandLine({"greet", "--times", "2"}, out, err), 0) << err.str();
    EXPECT_EQ(greeted, 2);
}

TEST(CommandLine, FillsOptions) {
    const Outcome import = run({"import", "src", "--out", "c", "--key", "--fps", "25", "--frames",
                                "0:9", "--no-overlays", "--device", "llvmpipe", "--seed", "9"});
    EXPECT_EQ(import.status, 0) << import.err;
    EXPECT_EQ(import.called, "import");
    EXPECT_EQ(import.import.settings.request.source, "src");
    EXPECT_EQ(import.import.settings.out, "c");
    EXPECT_TRUE(import.import.settings.request.key);
    EXPECT_FALSE(import.import.settings.overlays);
    EXPECT_EQ(import.import.settings.request.fps, 25);
    EXPECT_EQ(import.import.settings.request.frames, "0:9");
    EXPECT_EQ(import.import.body, "default");
    EXPECT_EQ(import.common.device, "llvmpipe");
    EXPECT_EQ(import.common.seed, 9u);
    EXPECT_EQ(import.common.commandLine.find("doppel import src --out c"), 0u);

    const Outcome train =
        run({"train", "c", "--out", "a", "--preset", "paper", "--stages", "texture,mesh", "--set",
             "mesh.batch=2", "--set", "mesh.lr=1e-3", "--memory", "2GB", "--frames", "-3:"});
    EXPECT_EQ(train.status, 0) << train.err;
    EXPECT_EQ(train.train.stages, (std::vector<std::string>{"mesh", "texture"}));
    EXPECT_EQ(train.train.preset.name, "paper");
    EXPECT_EQ(train.train.preset.mesh.batch, 2);
    EXPECT_EQ(train.train.preset.mesh.lr, 1e-3);
    EXPECT_EQ(train.train.preset.texture.batch, 8);
    EXPECT_EQ(train.train.memoryBudget, uint64_t{2} << 30);
    EXPECT_EQ(train.train.frames, "-3:");
    EXPECT_EQ(
        run({"train", "c", "--out", "a"}).train.stages,
        (std::vector<std::string>{"fit", "caps", "shape", "texels", "mesh", "texture", "refine"}));
    // The paper's preset is the paper's method.
    EXPECT_EQ(run({"train", "c", "--out", "a", "--preset", "paper"}).train.stages,
              (std::vector<std::string>{"fit", "mesh", "texture", "refine"}));
    EXPECT_EQ(run({"train", "--prior", "cast,people", "c", "--out", "a"}).train.prior,
              (std::vector<std::string>{"cast", "people"}));
    const TrainOptions plain = run({"train", "c", "--out", "a"}).train;
    EXPECT_TRUE(plain.prior.empty());
    EXPECT_TRUE(plain.gan && plain.face && plain.clamp);
    const TrainOptions ablation =
        run({"train", "c", "--out", "a", "--no-refine", "--no-gan", "--no-face", "--no-clamp"})
            .train;
    EXPECT_EQ(ablation.stages,
              (std::vector<std::string>{"fit", "caps", "shape", "texels", "mesh", "texture"}));
    EXPECT_FALSE(ablation.gan || ablation.face || ablation.clamp);
    const Outcome out = run({"train", "c", "--out", "a", "--preset", "paper", "--stages", "shape"});
    EXPECT_EQ(out.status, 2);
    EXPECT_NE(out.err.find("--stages: preset paper leaves shape out; --set shape.steps=200"),
              std::string::npos)
        << out.err;
    const Outcome nothing = run({"train", "c", "--out", "a", "--stages", "refine", "--no-refine"});
    EXPECT_EQ(nothing.status, 2);
    EXPECT_NE(nothing.err.find("--no-refine: stage refine is all"), std::string::npos);

    const RenderOptions render =
        run({"render", "a", "--motion", "m", "--out", "x", "--texture", "baked", "--smooth", "1.5"})
            .render;
    EXPECT_EQ(render.texture, "baked");
    EXPECT_EQ(render.smooth, 1.5);
    EXPECT_EQ(run({"eval", "a", "c", "--texture", "coarse"}).eval.texture, "coarse");
    EXPECT_EQ(run({"export", "a", "--out", "a.glb"}).exporting.texture, "best");

    EXPECT_EQ(run({"demo"}).demo.preset.name, "ci");
    EXPECT_EQ(run({"demo"}).demo.out, "out/demo");
    EXPECT_EQ(run({"demo"}).demo.actor, "woman");
    for (const std::string& actor : actorNames(assetFolder() / "actor"))
        EXPECT_EQ(run({"demo", "--actor", actor}).demo.actor, actor);
    const std::string file = (assetFolder() / "actor" / "man.npz").string();
    EXPECT_EQ(run({"demo", "--actor", file}).demo.actor, file);
    EXPECT_EQ(run({"demo"}).demo.size, 512);
    EXPECT_EQ(run({"demo", "--size", "256"}).demo.size, 256);
    EXPECT_EQ(run({"demo", "--size", "63"}).status, 2);
    EXPECT_EQ(run({"demo"}).demo.clip, 0);
    EXPECT_EQ(run({"demo", "--clip", "2.5", "--still-camera"}).demo.clip, 2.5);
    EXPECT_EQ(run({"demo", "--clip", "-1"}).status, 2);
    EXPECT_EQ(run({"check", "capture", "truth"}).called, "check");
    EXPECT_NE(run({"demo", "--actor", "nobody"}).err.find("nobody not in {"), std::string::npos);
    EXPECT_EQ(run({"render", "a", "--motion", "m", "--out", "x.mp4", "--background", "#00ff7F"})
                  .render.background,
              "#00ff7F");
    EXPECT_EQ(run({"eval", "a", "c", "--fit-test-poses", "--json"}).eval.fitTestPoses, "masks");
    EXPECT_EQ(run({"eval", "a", "c", "--fit-test-poses=pictures"}).eval.fitTestPoses, "pictures");
    const Outcome eval = run({"eval", "a", "c", "--lpips", "vgg.pth,heads.pth", "--lpips-net",
                              "vgg", "--fvd", "i3d.pt", "--scene", "median", "--out", "tables"});
    EXPECT_EQ(eval.status, 0) << eval.err;
    EXPECT_EQ(eval.eval.measures.lpips,
              (std::vector<std::filesystem::path>{"vgg.pth", "heads.pth"}));
    EXPECT_EQ(eval.eval.measures.lpipsNet, "vgg");
    EXPECT_EQ(eval.eval.measures.fvd, "i3d.pt");
    EXPECT_EQ(eval.eval.scene, "median");
    EXPECT_EQ(eval.eval.out, "tables");
    EXPECT_EQ(run({"eval", "a", "c"}).eval.scene, "frame");
    const Outcome ablate = run({"ablate", "c", "--out", "d", "--frames", "0:90", "--test-frames",
                                "90:120", "--fit-test-poses", "--variants", "complete,no-gan",
                                "--preset", "ci", "--set", "refine.steps=3"});
    EXPECT_EQ(ablate.status, 0) << ablate.err;
    EXPECT_EQ(ablate.called, "ablate");
    EXPECT_EQ(ablate.ablate.testFrames, "90:120");
    EXPECT_TRUE(ablate.ablate.fitTestPoses);
    EXPECT_EQ(ablate.ablate.variants, (std::vector<std::string>{"complete", "no-gan"}));
    EXPECT_EQ(ablate.ablate.preset.name, "ci");
    EXPECT_EQ(ablate.ablate.preset.refine.steps, 3);
    EXPECT_TRUE(run({"devices", "--json"}).common.json);
    EXPECT_EQ(run({"bench"}).called, "bench");
    EXPECT_EQ(run({"retarget", "m", "--avatar", "a", "--out", "o.npz"}).called, "retarget");
    EXPECT_EQ(run({"mix", "a", "--hair", "b", "--out", "c"}).called, "mix");
    EXPECT_TRUE(run({"render", "a", "--motion", "m", "--out", "x"}).render.retarget.on);
    const RetargetSettings settings =
        run({"render", "a", "--motion", "m", "--out", "x", "--retarget", "off", "--contacts",
             "c.json", "--reach", "space"})
            .render.retarget;
    EXPECT_FALSE(settings.on);
    EXPECT_EQ(settings.contacts, "c.json");
    EXPECT_EQ(settings.reach, "space");
}

TEST(CommandLine, NetworksTakeAPrecision) {
    const std::vector<std::vector<std::string>> commands{
        {"train", "capture", "--out", "x"},
        {"render", "avatar", "--motion", "m", "--out", "x"},
        {"eval", "avatar", "capture"},
        {"ablate", "capture", "--out", "x"},
        {"export", "avatar", "--out", "x.glb"},
        {"view", "avatar"},
        {"demo"}};
    for (std::vector<std::string> command : commands) {
        Outcome o = run(command);
        EXPECT_EQ(o.status, 0) << command[0] << o.err;
        EXPECT_EQ(o.common.precision, "fp32") << command[0];
        command.insert(command.end(), {"--precision", "mixed"});
        o = run(command);
        EXPECT_EQ(o.called, command[0]) << o.err;
        EXPECT_EQ(o.common.deviceOptions().precision, Precision::Mixed) << command[0];
        command.back() = "half";
        o = run(command);
        EXPECT_EQ(o.status, 2) << command[0];
        EXPECT_EQ(o.called, "") << command[0];
        EXPECT_NE(o.err.find("--precision"), std::string::npos) << o.err;
    }
}

TEST(CommandLine, ConfigUnderFlags) {
    Folder folder;
    folder.write("run.toml", std::string("device = \"llvm\"\nseed = 5\npreset = \"paper\"\n"
                                         "stages = [\"mesh\"]\nfps = 12\nresume = true\n"
                                         "[mesh]\nbatch = 3\nlaplacian = 2.5\ndilateMask = true\n"
                                         "[texture]\nregion = \"intersection\"\n"));
    const std::string config = (folder / "run.toml").string();
    const Outcome o = run(
        {"train", "c", "--out", "a", "--config", config, "--seed", "6", "--set", "mesh.batch=7"});
    EXPECT_EQ(o.status, 0) << o.err;
    EXPECT_EQ(o.common.device, "llvm");
    EXPECT_EQ(o.common.seed, 6u);
    EXPECT_EQ(o.train.stages, std::vector<std::string>{"mesh"});
    EXPECT_TRUE(o.train.resume);
    EXPECT_EQ(o.train.preset.name, "paper");
    EXPECT_EQ(o.train.preset.mesh.batch, 7);
    EXPECT_EQ(o.train.preset.mesh.laplacian, 2.5);
    EXPECT_TRUE(o.train.preset.mesh.dilateMask);
    EXPECT_EQ(o.train.preset.texture.region, Region::Intersection);
    // The same file serves another command, and flags win.
    EXPECT_EQ(run({"import", "s", "--out", "c", "--config", config}).import.settings.request.fps,
              12);
    EXPECT_EQ(
        run({"train", "c", "--out", "a", "--config", config, "--preset", "ci"}).train.preset.name,
        "ci");

    const auto refuse = [&](const std::string& text, const std::string& sentence) {
        folder.write("bad.toml", text);
        const Outcome bad =
            run({"train", "c", "--out", "a", "--config", (folder / "bad.toml").string()});
        EXPECT_EQ(bad.status, 2);
        EXPECT_TRUE(bad.called.empty());
        EXPECT_NE(bad.err.find(sentence), std::string::npos) << bad.err;
        EXPECT_EQ(std::count(bad.err.begin(), bad.err.end(), '\n'), 1) << bad.err;
    };
    refuse("sed = 5", "bad.toml: sed: expected the name of an option, found one that no command");
    refuse("seed = \"many\"", "bad.toml: seed: ");
    refuse("preset = ", "bad.toml: line 1: not TOML");
    refuse("[mesh]\nbatches = 3", "bad.toml: there is no number \"mesh.batches\"; there are mesh.");
    refuse("[mesh]\nbatch = 0", "bad.toml: mesh.batch: expected a whole number from 1 to 256");
    refuse("[mash]\nbatch = 1",
           "bad.toml: mash: expected one of the tables fit, caps, shape, texels, mesh, texture, "
           "refine");
    const Outcome missing = run({"train", "c", "--out", "a", "--config", "no/such.toml"});
    EXPECT_EQ(missing.status, 2);
    EXPECT_NE(missing.err.find("no/such.toml"), std::string::npos);
}

TEST(CommandLine, RefusesWithOneLineAndTwo) {
    const auto refuse = [](const std::vector<std::string>& arguments, const std::string& sentence) {
        const Outcome o = run(arguments);
        EXPECT_EQ(o.status, 2);
        EXPECT_TRUE(o.called.empty()) << o.called;
        EXPECT_TRUE(o.out.empty()) << o.out;
        EXPECT_NE(o.err.find(sentence), std::string::npos) << o.err;
        EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
    };
    refuse({}, "doppel: a command is missing; `doppel --help` tells more");
    refuse({"trian"}, "doppel: there is no command \"trian\"; there are devices, avatar, import");
    refuse({"fit", "c"}, "doppel fit: --out is required");
    refuse({"fit", "c", "--out", "d", "--colour"}, "--colour");
    refuse({"import", "--out", "c"}, "SRC is required");
    refuse({"import", "s", "--out", "c", "--fps", "0"}, "--fps");
    refuse({"train", "c", "--out", "a", "--preset", "huge"},
           "--preset: expected one of ci, small, best, paper, found \"huge\"");
    refuse({"train", "c", "--out", "a", "--stages", "mesh,hair"},
           "--stages: expected some of fit,caps,shape,texels,mesh,texture,refine, found \"hair\"");
    refuse({"train", "c", "--out", "a", "--set", "mesh.batch"},
           "--set: expected NAME=VALUE (mesh.batch=8), found \"mesh.batch\"");
    refuse({"train", "c", "--out", "a", "--set", "mesh.batch=two"},
           "--set: mesh.batch: expected a whole number from 1 to 256, found \"two\"");
    refuse({"train", "c", "--out", "a", "--set", "texture.textureSize=300"},
           "texture.textureSize: expected 0 or a power of two from 16 on, found 300");
    refuse({"train", "c", "--out", "a", "--set", "texture.depth=12"}, "texture.depth: expected");
    refuse({"train", "c", "--out", "a", "--seed", "-1"}, "--seed");
    refuse({"render", "a", "--motion", "m", "--out", "d", "--background", "green"},
           "--background: expected capture, none, a colour as #rrggbb, or a picture, a film or a "
           "folder of pictures that is there, found \"green\"");
    refuse(
        {"render", "a", "--motion", "m", "--out", "d", "--occluder", "no.png"},
        "--occluder: expected a mask, a film or a folder of masks that is there, found \"no.png");
    refuse({"render", "a", "--motion", "m", "--out", "d", "--audio", "no.wav"},
           "--audio: expected source, none, or a file with sound that is there, found \"no.wav\"");
    refuse(
        {"render", "a", "--motion", "m", "--out", "d", "--background", "none", "--match-colours"},
        "--match-colours: expected something behind to match, found --background none");
    refuse({"export", "a", "--out", "a.fbx"}, "--out: expected a name that ends in .glb");
    refuse({"export", "a", "--out", "a.bvh"}, "--motion: expected one for a.bvh");
    refuse({"export", "a", "--out", "a.glb", "--motion", "m", "--motion", "n", "--contacts", "c"},
           "--contacts: expected one --motion, whose contacts they are, found 2");
    refuse({"retarget", "m", "--avatar", "a", "--out", "o.bvh"},
           "--out: expected a name that ends in .npz, found \"o.bvh\"");
    refuse({"mix", "a", "--out", "b"}, "mix: expected who gives something: --head, --hair");
    refuse({"render", "a", "--motion", "m", "--out", "d", "--reach", "far"}, "--reach");
    refuse({"export", "a", "--out", "a.glb", "--names", "maya"},
           "--names: expected smpl, vrm, mixamo or unreal");
    refuse({"train", "c", "--out", "a", "--memory", "-5"},
           "--memory: expected a number of bytes, as 6GB or 512MB, found \"-5\"");
    refuse({"train", "c", "--out", "a", "--memory", "0"}, "--memory: expected more than 0 bytes");
    refuse({"train", "c", "--out", "a", "--preset", ""}, "--preset: expected one of ci, small");
}

TEST(CommandLine, PathsAreNotEmpty) {
    const auto refuse = [](const std::vector<std::string>& arguments, const std::string& name) {
        const Outcome o = run(arguments);
        EXPECT_EQ(o.status, 2) << name;
        EXPECT_TRUE(o.called.empty()) << o.called;
        EXPECT_NE(o.err.find(name + ": expected a path, found an empty text"), std::string::npos)
            << o.err;
    };
    refuse({"fit", "c", "--out", ""}, "--out");
    refuse({"fit", "", "--out", "d"}, "CAPTURE");
    refuse({"import", "s", "--out", ""}, "--out");
    refuse({"train", "c", "--out", ""}, "--out");
    refuse({"render", "a", "--motion", "m", "--out", ""}, "--out");
    refuse({"render", "a", "--motion", "", "--out", "d"}, "--motion");
    refuse({"eval", "a", "c", "--out", ""}, "--out");
    refuse({"eval", "a", "c", "--pictures", ""}, "--pictures");
    refuse({"ablate", "c", "--out", ""}, "--out");
    refuse({"export", "a", "--out", ""}, "--out");
    refuse({"demo", "--out", ""}, "--out");
    refuse({"demo", "--config", ""}, "--config");
    Folder folder;
    folder.write("run.toml", std::string("out = \"\""));
    refuse({"demo", "--config", (folder / "run.toml").string()}, "run.toml: out: --out");
}

TEST(CommandLine, JsonTakesTextsThatAreNotUtf8) {
    testing::internal::CaptureStdout();
    printJson({{"out", "caf\xe9/avatar.glb"}, {"frames", 3}});
    const auto json = nlohmann::json::parse(testing::internal::GetCapturedStdout());
    EXPECT_EQ(json["out"], "caf\xef\xbf\xbd/avatar.glb");
    EXPECT_EQ(json["frames"], 3);
}

TEST(Devices, DeviceChoosesAmongThem) {
    const auto devices = [](std::vector<std::string> more) {
        std::vector<std::string> arguments{"devices", "--json"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        std::ostringstream out, err;
        testing::internal::CaptureStdout();
        const int status = runCommandLine(arguments, out, err);
        const std::string printed = testing::internal::GetCapturedStdout();
        return std::tuple(status, err.str(), printed);
    };
    const auto [status, err, printed] = devices({});
    ASSERT_EQ(status, 0) << err;
    const auto all = nlohmann::json::parse(printed)["devices"];
    ASSERT_FALSE(all.empty());
    for (const auto& device : all) {
        const auto [one, error, text] =
            devices({"--device", fmt::format("{}", device["index"].get<int>())});
        const auto shown = nlohmann::json::parse(text)["devices"];
        ASSERT_EQ(shown.size(), 1u);
        EXPECT_EQ(shown[0]["name"], device["name"]);
        EXPECT_EQ(shown[0]["chosen"], device["refusals"].empty());
    }
    const auto [best, why, listed] = devices({"--device", "auto"});
    EXPECT_EQ(best, 0) << why;
    EXPECT_EQ(listed, printed) << "as without";
    const auto [none, error, text] = devices({"--device", "no such device"});
    EXPECT_EQ(none, 2);
    EXPECT_EQ(text, "");
    EXPECT_NE(error.find("--device: expected a number or part of a name of 0 " +
                         all[0]["name"].get<std::string>()),
              std::string::npos)
        << error;
    EXPECT_NE(error.find("found \"no such device\""), std::string::npos) << error;
}

TEST(CommandLine, ExitStatusSaysWhoseFaultItIs) {
    const auto statusWhen = [](const std::function<void()>& during) {
        return run({"devices"}, during);
    };
    EXPECT_EQ(statusWhen([] {}).status, 0);
    const Outcome input = statusWhen([] { throw InputError("a.npz: x: wrong"); });
    EXPECT_EQ(input.status, 2);
    EXPECT_EQ(input.err, "doppel: a.npz: x: wrong\n");
    const Outcome machine = statusWhen([] { throw MachineError("no space"); });
    EXPECT_EQ(machine.status, 1);
    EXPECT_EQ(machine.err, "doppel: no space\n");
    EXPECT_EQ(statusWhen([] { throw std::bad_alloc(); }).status, 1);
    const Outcome stopped = statusWhen([] { throw Interrupted{"checkpoint a/checkpoints"}; });
    EXPECT_EQ(stopped.status, 130);
    EXPECT_EQ(stopped.err, "doppel: interrupted; kept: checkpoint a/checkpoints\n");
}

TEST(CommandLine, HelpShowsAnExample) {
    const Outcome all = run({"--help"});
    EXPECT_EQ(all.status, 0);
    for (const char* command : {"devices", "import", "fit", "check", "train", "render", "eval",
                                "ablate", "export", "demo", "bench", "retarget", "mix"}) {
        EXPECT_NE(all.out.find(command), std::string::npos) << command;
        const Outcome one = run({command, "--help"});
        EXPECT_EQ(one.status, 0);
        EXPECT_TRUE(one.err.empty());
        EXPECT_NE(one.out.find(std::string("Example:\n  doppel ") + command), std::string::npos)
            << one.out;
        EXPECT_NE(one.out.find("--device"), std::string::npos);
    }
    // The list has a line for each, and each command's own help says more.
    EXPECT_NE(all.out.find("Dress an avatar with the clothes, hair or head of others"),
              std::string::npos);
    EXPECT_EQ(all.out.find("Makes one avatar of several"), std::string::npos);
    EXPECT_NE(run({"mix", "--help"}).out.find("Makes one avatar of several"), std::string::npos);
    EXPECT_NE(run({"--version"}).out.find("doppel 0."), std::string::npos);
    // The numbers of the presets, whatever else the command would need.
    for (const char* command : {"fit", "train", "ablate"}) {
        auto numbers = run({command, "--help-presets"});
        EXPECT_EQ(numbers.status, 0);
        EXPECT_EQ(numbers.out, presetHelp());
        EXPECT_TRUE(numbers.err.empty());
    }
}

// The words of a shell's line, up to where another command or a file begins.
std::vector<std::string> wordsOfLine(const std::string& line) {
    std::vector<std::string> words;
    std::string word;
    bool quoted = false;
    for (const char c : line + " ") {
        if (c == '"') {
            quoted = !quoted;
        } else if (c != ' ' || quoted) {
            word += c;
        } else if (!word.empty()) {
            if (word == "&&" || word == ">") break;
            words.push_back(word);
            word.clear();
        }
    }
    return words;
}

TEST(CommandLine, EveryExampleIsOneThatItTakes) {
    for (const char* command :
         {"ablate", "avatar", "batch", "bench", "check", "completion", "demo", "devices", "eval",
          "export", "fit", "import", "manual", "mix", "render", "retarget", "train", "view"}) {
        const std::string help = run({command, "--help"}).out;
        const size_t begin = help.find("Example:\n");
        ASSERT_NE(begin, std::string::npos) << command;
        std::istringstream text(help.substr(begin));
        std::string line, whole;
        size_t examples = 0;
        while (std::getline(text, line)) {
            // A line that ends in a backslash goes on.
            whole += line;
            if (whole.ends_with('\\')) {
                whole.pop_back();
                continue;
            }
            const std::vector<std::string> words = wordsOfLine(std::exchange(whole, {}));
            if (words.empty() || words[0] != "doppel") continue;
            const Outcome o = run({words.begin() + 1, words.end()});
            EXPECT_EQ(o.status, 0) << line << "\n" << o.err;
            EXPECT_EQ(o.called, words.at(1)) << line;
            ++examples;
        }
        EXPECT_GT(examples, 0u) << command;
    }
}

// The commands of the pages that come with the program: lines of code, and such words between
// backquotes as begin with where it is built.
std::vector<std::string> commandsOfPage(const std::filesystem::path& page) {
    std::vector<std::string> commands;
    std::ifstream file(page);
    std::string line, whole;
    bool fenced = false;
    const auto take = [&](std::string command, std::initializer_list<const char*> starts) {
        for (const std::string start : starts)
            if (command.starts_with(start)) {
                // What follows after two spaces or a sign of a comment is for the reader.
                command.resize(std::min({command.find("  "), command.find(" #"), command.size()}));
                commands.push_back("doppel " + command.substr(start.size()));
            }
    };
    while (std::getline(file, line)) {
        if (line.starts_with("```")) fenced = !fenced;
        const bool code = fenced || line.starts_with("    ");
        if (!code) {
            for (size_t at = 0, end = 0;
                 (at = line.find("`build/doppel ", at)) != std::string::npos; at = end) {
                end = line.find('`', at + 1);
                if (end == std::string::npos) break;
                const std::string command = line.substr(at + 1, end - at - 1);
                if (command.find_first_of("|[<") == std::string::npos &&
                    command.find("…") == std::string::npos)
                    take(command, {"build/doppel "});
            }
            continue;
        }
        whole += line.substr(std::min(line.find_first_not_of(' '), line.size()));
        if (whole.ends_with('\\')) {
            whole.pop_back();
            continue;
        }
        if (whole.find("...") == std::string::npos) take(whole, {"build/doppel ", "doppel "});
        whole.clear();
    }
    return commands;
}

TEST(CommandLine, TakesTheCommandsOfThePages) {
    size_t found = 0;
    std::vector<std::filesystem::path> pages{test::sourceFolder() / "README.md"};
    for (const auto& entry : std::filesystem::directory_iterator(test::sourceFolder() / "docs"))
        if (entry.path().extension() == ".md") pages.push_back(entry.path());
    for (const std::filesystem::path& page : pages)
        for (const std::string& command : commandsOfPage(page)) {
            const std::vector<std::string> words = wordsOfLine(command);
            ASSERT_GT(words.size(), 1u) << page;
            const Outcome o = run({words.begin() + 1, words.end()});
            EXPECT_EQ(o.status, 0) << page << ": " << command << "\n" << o.err;
            EXPECT_TRUE(o.called == words[1] || std::ranges::find(words, "--help") != words.end())
                << page << ": " << command;
            ++found;
        }
    EXPECT_GT(found, 20u);
}

TEST(Presets, PaperIsThePapers) {
    const Preset paper = presetByName("paper");
    EXPECT_EQ(paper.mesh.size, 256);
    EXPECT_EQ(paper.mesh.blocks * paper.mesh.layers, 18);
    EXPECT_EQ(paper.mesh.lr, 1e-4);
    EXPECT_EQ(paper.mesh.gradientClip, 0);
    EXPECT_EQ(paper.texture.textureSize, 512);
    EXPECT_EQ(paper.texture.depth, 9);
    EXPECT_EQ(paper.texture.steps, 2000);
    EXPECT_EQ(paper.texture.region, Region::Union);
    EXPECT_EQ(paper.refine.epochs, 40);
    EXPECT_EQ(paper.refine.batch, 8);
    EXPECT_EQ(paper.refine.lr, 2e-4);
    EXPECT_EQ(paper.refine.lrDiscriminator, 2e-5);
    EXPECT_EQ(paper.refine.constantPart, .5);
    EXPECT_EQ(paper.refine.loss, GanLoss::Log);
    EXPECT_EQ(paper.refine.faceSize, 80);
    EXPECT_EQ(paper.refine.reconstruction, 100);
    EXPECT_EQ(paper.refine.misaligned, 100);
    Preset changed = paper;
    setPresetValue(changed, "mesh.clamps", "none", "test");
    EXPECT_EQ(changed.mesh.clamps, ClampBounds::None);
    EXPECT_NE(messageOf<InputError>([&] {
                  setPresetValue(changed, "refine.loss", "hinge", "test");
              }).find("expected log or squares, found \"hinge\""),
              std::string::npos);
    changed.caps.cell = .001;
    EXPECT_NE(messageOf<InputError>([&] { checkPreset(changed, "test"); }).find("caps.cell"),
              std::string::npos);
    changed.caps.cell = 0;
    changed.refine.depth = 10;
    EXPECT_NE(messageOf<InputError>([&] { checkPreset(changed, "test"); }).find("refine.depth"),
              std::string::npos);
    for (const std::string& name : presetNames()) {
        Preset preset = presetByName(name);
        EXPECT_NO_THROW(checkPreset(preset, name));
        // Every number can be set to what it is.
        for (const auto& [field, value] : presetValues(preset)) {
            EXPECT_NO_THROW(setPresetValue(preset, field, value, "test")) << field;
        }
        EXPECT_EQ(presetValues(preset), presetValues(presetByName(name)));
    }
}

TEST(Progress, SaysWhatIsLeft) {
    const Progress progress("mesh", 400);
    EXPECT_EQ(progress.line(100, {{"loss", .25}}, 30), "mesh 100/400  loss 0.25  1:30 left");
    EXPECT_EQ(progress.line(400, {}, 3725), "mesh 400/400  1:02:05 in all");
    EXPECT_EQ(clockText(59.6), "1:00");
    EXPECT_EQ(clockText(0), "0:00");
}

TEST(Progress, IsWrittenAsOftenAsAsked) {
    const auto said = [](const char* seconds) {
        setenv("DOPPEL_PROGRESS", seconds, 1);
        testing::internal::CaptureStderr();
        {
            Progress progress("mesh", 400);
            std::this_thread::sleep_for(std::chrono::milliseconds(150));
            progress.update(100);
            progress.update(101);
        }
        unsetenv("DOPPEL_PROGRESS");
        return testing::internal::GetCapturedStderr();
    };
    const std::string often = said(".1"), seldom = said("");
    EXPECT_EQ(std::ranges::count(often, '\n'), 2) << often;  // and the last
    EXPECT_EQ(std::ranges::count(seldom, '\n'), 1) << seldom;
    for (const char* wrong : {"often", "0", "-1", "5s", "nan"}) {
        setenv("DOPPEL_PROGRESS", wrong, 1);
        EXPECT_NE(messageOf<InputError>([] { Progress("mesh", 1); }).find("expected seconds"),
                  std::string::npos)
            << wrong;
        unsetenv("DOPPEL_PROGRESS");
    }
}

TEST(LossLog, CurvesGoOnWhereARunResumes) {
    Folder folder;
    {
        LossLog log(folder / "log", "mesh", {"loss", "iou"});
        for (int step = 0; step < 5; ++step) log.add(step, {1. / (step + 1), .1 * step});
        log.flush();
    }
    // Steps 3 and 4 came after the checkpoint, and the last row was cut short.
    std::ofstream(folder / "log" / "losses_mesh.csv", std::ios::app) << "5,0.1";
    {
        LossLog log(folder / "log", "mesh", {"loss", "iou"}, 3);
        log.add(3, {.5, .25});
        log.flush();
    }
    std::ifstream csv(folder / "log" / "losses_mesh.csv");
    const std::string text((std::istreambuf_iterator<char>(csv)), {});
    EXPECT_EQ(text, "step,loss,iou\n0,1,0\n1,0.5,0.1\n2,0.333333333,0.2\n3,0.5,0.25\n");
    const auto events = folder / "log" / "events" / "mesh";
    ASSERT_EQ(std::distance(std::filesystem::directory_iterator(events), {}), 1);
    // Eight scalars, each with its tag.
    std::ifstream file(std::filesystem::directory_iterator(events)->path(), std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(file)), {});
    size_t tags = 0;
    for (size_t at = 0; (at = bytes.find("mesh/", at)) != std::string::npos; ++at) ++tags;
    EXPECT_EQ(tags, 8u);
    // A fresh run starts again.
    LossLog again(folder / "log", "mesh", {"loss", "iou"});
    std::ifstream fresh(folder / "log" / "losses_mesh.csv");
    EXPECT_EQ(std::string((std::istreambuf_iterator<char>(fresh)), {}), "step,loss,iou\n");
}

// How a child ends that gets these signals, and says after each whether it knows.
int endedBy(const std::vector<int>& signals, bool nohup = false) {
    const pid_t child = fork();
    if (child == 0) {
        if (nohup) signal(SIGHUP, SIG_IGN);
        catchInterrupts();
        if (interrupted()) _exit(1);
        for (int number : signals) {
            raise(number);
            if (!interrupted()) _exit(2);
        }
        _exit(interruptStatus());
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

TEST(Progress, TheThirdInterruptKills) {
    EXPECT_EQ(endedBy({SIGINT}), 130);
    EXPECT_EQ(endedBy({SIGTERM}), 143);
    EXPECT_EQ(endedBy({SIGHUP}), 129);
    EXPECT_EQ(endedBy({SIGINT, SIGINT}), 130) << "a hasty second one spoils nothing";
    EXPECT_EQ(endedBy({SIGTERM, SIGINT}), 143) << "the first one counts";
    EXPECT_EQ(endedBy({SIGINT, SIGINT, SIGINT}), -SIGINT);
    EXPECT_EQ(endedBy({SIGHUP}, true), 2) << "nohup stays nohup";
}

}  // namespace
}  // namespace doppel
