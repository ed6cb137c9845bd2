// README's commands and the examples of each --help, each run as it stands there and in its order,
// on small stand-ins of what it names; or named here, with what runs it in the place of this test,
// or why nothing does.
#include <thread>

#include "tests/refusals.h"
#include "tests/screen.h"
#include "tests/small_run.h"
#include "tests/tiny_training.h"
#include "trainer/commands/command.h"
#include "trainer/motion/hand_held.h"
#include "trainer/motion/room.h"
#include "trainer/person/blazepose.h"

namespace doppel {
namespace {

using namespace test;

enum class Needs {
    Nothing,
    Environment,  // build/env.sh, which scripts/setup writes
    Networks,     // that find people
    Three,        // three.js
    Screen        // a window opens, is closed, and the command ends
};

struct Line {
    const char* command;
    std::vector<const char*> takes = {};   // made by makeStandIn() where no line before has made it
    std::vector<const char*> leaves = {};  // is there in the end, and not empty
    Needs needs = Needs::Nothing;
    const char* shorter =
        nullptr;  // takes the command's place where the file kSmallRun is not enough
};

const std::vector<Line> kRun{
    {.command = ". build/env.sh", .needs = Needs::Environment},
    {.command = "build/doppel devices"},
    {.command = "build/doppel avatar clip.mp4 --out me",
     .takes = {"clip.mp4"},
     .leaves = {"me/capture/overlay.jpg", "me/capture/overlay.mp4", "me/avatar/avatar.toml",
                "me/avatar/texture.png"},
     .needs = Needs::Networks},
    {.command = "build/doppel view", .needs = Needs::Screen},
    {.command = "build/doppel demo --clip 4 --out film",
     .leaves = {"film/clip.mp4", "film/truth/poses.npz", "film/truth/masks"},
     .shorter = "build/doppel demo --clip .05 --out film"},
    {.command = "build/doppel import clip.mp4 --out capture",
     .takes = {"clip.mp4"},
     .leaves = {"capture/images", "capture/masks", "capture/poses.npz", "capture/quality.json"},
     .needs = Needs::Networks},
    {.command = "build/doppel train capture --out avatar --preset small",
     .takes = {"capture"},
     .leaves = {"avatar/avatar.toml", "avatar/body.npz", "avatar/texture.png",
                "avatar/texels_seen.png", "avatar/poses.npz", "avatar/texture_baked.png"}},
    {.command = "build/doppel render avatar --motion other-capture --camera turntable --out "
                "dance.mp4",
     .takes = {"other-capture"},
     .leaves = {"dance.mp4"}},
    {.command = "build/doppel render avatar --motion other-capture --background none --shadow "
                "--out dance.mov",
     .leaves = {"dance.mov"}},
    {.command = "build/doppel export avatar --out avatar.glb --motion other-capture",
     .leaves = {"avatar.glb"}},
    {.command = "build/doppel export avatar --web page --motion other-capture",
     .leaves = {"page/page.html"},
     .needs = Needs::Three},
    {.command = "build/doppel view avatar --motion other-capture", .needs = Needs::Screen},
    {.command = "build/doppel avatar photos --out friend",
     .takes = {"photos"},
     .leaves = {"friend/capture/overlay.jpg", "friend/avatar/texture.png"},
     .needs = Needs::Networks},
    {.command = "build/doppel demo",
     .leaves = {"out/demo/avatar/avatar.toml", "out/demo/avatar.glb", "out/demo/turntable.mp4",
                "out/demo/reenact.mp4", "out/demo/contact.png", "out/demo/held-out/report.html",
                "out/demo/metrics.json"},
     .shorter = "build/doppel demo --size 64"},
    {.command = "build/doppel mix avatar --hair friend/avatar --bottom another/avatar --out "
                "dressed",
     .takes = {"friend/avatar", "another/avatar"},
     .leaves = {"dressed/avatar.toml", "dressed/texture.png"}},
    {.command = "source <(build/doppel completion bash)"},
    {.command = "build/doppel eval avatars captures --out tables",
     .takes = {"avatars/woman", "captures/woman/turn"},
     .leaves = {"tables/results.json", "tables/results.csv", "tables/results.md"}},
};

struct Unrun {
    const char* command;
    const char* test;  // that runs it; null: none does
    const char* why;
};

const std::vector<Unrun> kNotRun{
    {"scripts/demo", nullptr, "it is scripts/setup and `doppel demo`"},
    {"scripts/test", nullptr, "it runs this test"},
    {"scripts/setup --models", "Install.FetchesNetworksToWhereTheProgramLooks", "it fetches 41 MB"},
    {"scripts/setup --tools", nullptr, "it installs packages"},
    {"scripts/gpu-report", nullptr, "its benchmarks take minutes"},
    {"scripts/gpu-report --pack FILE.tar.gz", nullptr, "it packs what is built for a report"},
    {"VK_DRIVER_FILES=/usr/share/vulkan/icd.d/radeon_icd.x86_64.json scripts/test", nullptr,
     "it takes that device"},
    {"mpirun -n N doppel train …", "MpiRun.TrainsWithTheSameBitsEveryTime", "N is a number"},
    {"cmake --install build --prefix PREFIX", "Install.FindsItsAssets",
     "with --component programs, for nothing else need be built then"},
    {"cpack -G DEB", "Install.DebianPackageHoldsAProgramThatRuns", "with less compression"},
    {"apt install ./doppel_*.deb", nullptr, "scripts/test-package does so, in a Debian of its own"},
    {"cmake --preset release && cmake --build build", nullptr, "it is how this test is built"},
    {"doppel-fetch models", "Install.FetchesNetworksToWhereTheProgramLooks", "it fetches 41 MB"},
    {"doppel-fetch web", nullptr, "it fetches three.js"},
    {"man doppel-train", "Install.ManualPagesAreClean", "groff shows what man does"},
};

// Of commands' help, in an order in which each has what it takes.
const std::vector<Line> kExamples{
    {.command = "doppel devices --json"},
    {.command = "doppel import clip.mp4 --out me --every 3",
     .takes = {"clip.mp4"},
     .leaves = {"me/images", "me/masks", "me/poses.npz", "me/quality.json"},
     .needs = Needs::Networks},
    {.command = "doppel fit capture --out fitted",
     .takes = {"capture"},
     .leaves = {"fitted/poses.npz", "fitted/images"}},
    {.command = "doppel train fitted --out avatar --preset small --stages mesh,texture",
     .leaves = {"avatar/avatar.toml", "avatar/texture.png"}},
    {.command = "doppel fit capture --avatar avatar --out reenacted",
     .leaves = {"reenacted/poses.npz"}},
    {.command = "doppel mix avatar --top other/avatar --hair other/avatar --out mixed",
     .takes = {"other/avatar"},
     .leaves = {"mixed/avatar.toml", "mixed/texture.png"}},
    {.command = "doppel render avatar --motion box --camera turntable --background \"#ffffff\" "
                "--out dance.mp4",
     .takes = {"box"},
     .leaves = {"dance.mp4"}},
    {.command = "doppel retarget dance.bvh --avatar avatar --out dance.npz",
     .takes = {"dance.bvh"},
     .leaves = {"dance.npz"}},
    {.command = "doppel eval avatar capture --frames 90:120 --fit-test-poses --json",
     .shorter = "doppel eval avatar capture --frames 3:5 --fit-test-poses --json"},
    {.command = "doppel eval avatars captures --out results",
     .takes = {"other-capture", "avatars/woman", "captures/woman/turn"},
     .leaves = {"results/results.json", "results/results.csv", "results/results.md"}},
    {.command = "doppel check capture out/demo/truth", .takes = {"out/demo/truth"}},
    {.command = "doppel ablate capture --frames 0:90 --test-frames 90:120 --fit-test-poses --out "
                "ablation",
     .leaves = {"ablation/ablation.json", "ablation/ablation.md"},
     .shorter = "doppel ablate capture --frames 0:4 --test-frames 4:6 --fit-test-poses --out "
                "ablation"},
    {.command = "doppel export avatar --out avatar.glb --motion capture", .leaves = {"avatar.glb"}},
    {.command = "doppel view avatar --motion capture", .needs = Needs::Screen},
    {.command = "doppel bench"},
    {.command = "doppel completion bash > ~/.local/share/bash-completion/completions/doppel",
     .takes = {".local/share/bash-completion/completions"},
     .leaves = {".local/share/bash-completion/completions/doppel"}},
    {.command = "doppel manual --out man && man -l man/doppel-train.1",
     .leaves = {"man/doppel-train.1"},
     .shorter = "doppel manual --out man"},
};

const std::vector<Unrun> kExamplesNotRun{
    {"doppel avatar clip.mp4 --out me", "Readme.ItsCommandsDoWhatItSays", "README has it, too"},
    {"doppel demo --out out/demo", "Readme.ItsCommandsDoWhatItSays", "README has it, too"},
    {"doppel batch people.toml --out people", "Batch.WhoFailsStopsNobodyAndWhatIsDoneStays",
     "it takes a list of people"},
};

struct Page {
    std::vector<std::string> commands;  // in their order: lines of code, and what runs in quotes
    std::vector<std::string> named;     // `doppel render`, `export --web DIR`: commands and flags
    std::vector<std::string> scripts;
};

std::vector<std::string> wordsOf(const std::string& text) {
    std::istringstream stream(text);
    return {std::istream_iterator<std::string>(stream), {}};
}

// Without what stands around words and between them, in help and in tables.
std::vector<std::string> plainWordsOf(std::string text) {
    std::ranges::replace_if(
        text, [](unsigned char c) { return !std::isalnum(c) && c != '-'; }, ' ');
    return wordsOf(text);
}

bool isCommand(const std::string& name) {
    return std::ranges::any_of(CommandEntry::all(),
                               [&](const CommandEntry& entry) { return entry.name == name; });
}

// Everything between backquotes of several words is a command, a command's name with flags, an
// option's value, or a message of a script, which ends its first word with a colon.
Page readPage() {
    Page page;
    std::istringstream lines(bytesOf(sourceFolder() / "README.md"));
    std::string prose;
    const auto readProse = [&] {
        for (size_t at = 0; (at = prose.find('`', at)) != std::string::npos;) {
            const size_t end = prose.find('`', at + 1);
            if (end == std::string::npos) break;
            const std::string quoted = prose.substr(at + 1, end - at - 1);
            at = end + 1;
            std::vector<std::string> words = wordsOf(quoted);
            if (words.empty() || words[0].starts_with("-") || words[0].ends_with(":")) continue;
            if (words[0].starts_with("scripts/")) page.scripts.push_back(words[0]);
            if (words.size() == 1) continue;
            if (words[0] == "doppel" || isCommand(words[0])) {
                if (words[0] == "doppel") words.erase(words.begin());
                page.named.push_back(fmt::format("{}", fmt::join(words, " ")));
            } else {
                page.commands.push_back(fmt::format("{}", fmt::join(words, " ")));
            }
        }
        prose.clear();
    };
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("    ")) {
            readProse();
            page.commands.push_back(
                fmt::format("{}", fmt::join(wordsOf(line.substr(0, line.find(" # "))), " ")));
        } else if (line.starts_with("| `doppel ")) {
            // What follows the command's name in its row: all flags are its own.
            prose += line + "\n";
            readProse();
            const std::vector<std::string> words = plainWordsOf(line);
            page.named.push_back(fmt::format("{}", fmt::join(words.begin() + 1, words.end(), " ")));
        } else {
            prose += line + "\n";
            if (line.empty()) readProse();
        }
    }
    readProse();
    return page;
}

// What README's names stand for, of few and small pictures.
void makeStandIn(const Folder& folder, const std::string& name) {
    const fs::path place = folder / name;
    fs::create_directories(place.parent_path());
    const Actor woman = readActor(assetFolder() / "actor", "woman");
    const auto copy = [&](const char* from) {
        fs::copy(folder / from, place, fs::copy_options::recursive);
    };
    if (name == "clip.mp4") {
        HandHeldOptions film;
        film.width = 180, film.height = 320;
        const Performer performer{&woman, oneTake(6, kTakeDistance)};
        filmHandHeld(testDevice(), {&performer, 1}, place, folder / "truth", film);
    } else if (name == "photos") {
        fs::create_directory(place);
        const fs::path images = folder / "other-capture/images";
        for (const char* picture : {"0000_turn.png", "0003_turn.png"})
            fs::copy(images / picture, place / picture);
    } else if (name.ends_with("capture") || name == "box") {
        tinyCapture(place);
    } else if (name == "dance.bvh") {
        ASSERT_EQ(doppel({"export", (folder / "avatar").string(), "--motion",
                          (folder / "capture").string(), "--out", place.string()})
                      .status,
                  0);
    } else if (name == "out/demo/truth") {
        copy("capture");
    } else if (name.ends_with("completions")) {
        fs::create_directories(place);
    } else {
        copy(name.starts_with("captures") ? "other-capture" : "avatar");
    }
}

// Why a line cannot be run on this machine; empty: it can.
std::string whatLacks(Needs needs, const Folder& folder) {
    const fs::path build = sourceFolder() / "build";
    if (needs == Needs::Environment && !fs::exists(folder / "build/env.sh"))
        return "scripts/setup writes that file";
    if (needs == Needs::Networks && !poseModelsAreThere(PoseNet::Lite, build / "models"))
        return "scripts/setup --models fetches the networks";
    if (needs == Needs::Three && !fs::exists(build / "web/three.module.min.js"))
        return "scripts/setup --web fetches three.js";
    if (needs == Needs::Screen && start({"sh", "-c", "command -v Xvfb"}).status != 0)
        return "there is no Xvfb";
    return {};
}

// Closes the window once it is there, if the program does not end before.
void closeWindow(Screen& screen, pid_t program) {
    siginfo_t ended{};
    while (waitid(P_PID, static_cast<id_t>(program), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           ended.si_pid == 0) {
        try {
            return screen.closeWindow();
        } catch (const std::runtime_error&) {  // there is none yet
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
}

// Runs a line in the folder, on small stand-ins; says why where this machine cannot.
void run(const Line& line, const Folder& folder) {
    if (const std::string lack = whatLacks(line.needs, folder); !lack.empty()) {
        fmt::print(stderr, "not run: {}: {}\n", line.command, lack);
        return;
    }
    for (const char* taken : line.takes)
        if (!fs::exists(folder / taken)) makeStandIn(folder, taken);
    std::string shell = line.shorter ? line.shorter : line.command;
    // Which these two do not take.
    const bool hasConfig =
        !shell.starts_with("doppel completion") && !shell.starts_with("doppel manual");
    if (hasConfig && (shell.starts_with("build/doppel") || shell.starts_with("doppel")))
        shell += " --config small.toml";
    if (line.needs == Needs::Networks) shell += " --pose lite";
    std::unique_ptr<Screen> screen;
    if (line.needs == Needs::Screen) screen = std::make_unique<Screen>(1280, 800);
    std::function<void(pid_t)> meanwhile;
    if (screen) meanwhile = [&](pid_t child) { closeWindow(*screen, child); };
    const std::string home = folder.path().string();
    const Outcome outcome = start(
        {"env", "-C", home, "HOME=" + home, "XDG_STATE_HOME=" + home,
         "PATH=" + program().parent_path().string() + ":" + getenv("PATH"), "bash", "-c", shell},
        nullptr, meanwhile);
    ASSERT_EQ(outcome.status, 0) << shell << "\n" << outcome.err;
    for (const char* left : line.leaves)
        EXPECT_TRUE(fs::exists(folder / left) && !fs::is_empty(folder / left))
            << shell << ": " << left;
}

TEST(Readme, ItsCommandsDoWhatItSays) {
    Folder folder;
    folder.write("small.toml", std::string(kSmallRun));
    folder.link(program().parent_path(), "build");
    for (const std::string& command : readPage().commands) {
        if (std::ranges::count(kNotRun, command, &Unrun::command) > 0) continue;
        const auto line = std::ranges::find(kRun, command, &Line::command);
        ASSERT_NE(line, kRun.end())
            << "README has a command that is neither run nor listed here: " << command;
        ASSERT_NO_FATAL_FAILURE(run(*line, folder));
    }
}

TEST(Help, ItsExamplesDoWhatTheySay) {
    size_t count = 0;
    for (const CommandEntry& entry : CommandEntry::all()) {
        std::istringstream lines(entry.example);
        for (std::string line; std::getline(lines, line);) {
            const std::string example = fmt::format("{}", fmt::join(wordsOf(line), " "));
            EXPECT_EQ(std::ranges::count(kExamples, example, &Line::command) +
                          std::ranges::count(kExamplesNotRun, example, &Unrun::command),
                      1)
                << "an example that is neither run nor listed here: " << example;
            ++count;
        }
    }
    EXPECT_EQ(count, kExamples.size() + kExamplesNotRun.size());
    Folder folder;
    folder.write("small.toml", std::string(kSmallRun));
    for (const Line& line : kExamples) ASSERT_NO_FATAL_FAILURE(run(line, folder));
}

// What this test says of the page is true, and so is what the page says of flags.
TEST(Readme, NamesWhatThereIs) {
    const Page page = readPage();
    for (const Line& line : kRun)
        EXPECT_GT(std::ranges::count(page.commands, line.command), 0) << line.command;
    std::string tests;
    for (const auto& entry : fs::directory_iterator(sourceFolder() / "tests"))
        if (entry.path().extension() == ".cpp") tests += bytesOf(entry.path());
    const auto isATest = [&](const Unrun& line) {
        if (!line.test) return true;
        std::string test = line.test;
        test.replace(test.find('.'), 1, ", ");
        return tests.find("(" + test + ")") != std::string::npos;
    };
    for (const Unrun& line : kExamplesNotRun) EXPECT_TRUE(isATest(line)) << line.test;
    for (const Unrun& line : kNotRun) {
        EXPECT_TRUE(isATest(line)) << line.test;
        EXPECT_GT(std::ranges::count(page.commands, line.command) +
                      std::ranges::count(page.scripts, line.command),
                  0)
            << line.command;
    }
    for (const std::string& script : page.scripts)
        EXPECT_TRUE(fs::exists(sourceFolder() / script)) << script;
    EXPECT_GT(page.named.size(), 20u);
    std::map<std::string, std::vector<std::string>> helps;
    for (const std::string& named : page.named) {
        const std::vector<std::string> words = wordsOf(named);
        ASSERT_TRUE(isCommand(words[0])) << named;
        std::vector<std::string>& help = helps[words[0]];
        if (help.empty()) help = plainWordsOf(doppel({words[0], "--help"}).out);
        for (const std::string& word : plainWordsOf(named)) {
            if (!word.starts_with("--") || word.size() == 2) continue;
            EXPECT_GT(std::ranges::count(help, word), 0) << words[0] << " has no " << word;
        }
    }
}

}  // namespace
}  // namespace doppel
