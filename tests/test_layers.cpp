// The order of the folders: what may include what, how much a folder holds, and that a shader says
// what it computes.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/files.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// From the lowest to the highest. A file includes files of its own folder and of folders before it.
// A folder that is not named here has the place of the folder that it lies in.
const std::vector<std::string> kOrder = {
    "engine",         "engine/io",      "nn/core",        "nn/body",        "nn/ops",
    "nn/nets",        "nn/steps",       "nn/tools",       "trainer/data",   "trainer/ranks",
    "trainer/motion", "trainer/avatar", "viewer/window",  "viewer/pose",    "viewer",
    "trainer/eval",   "trainer/person", "trainer/import", "trainer/stages", "trainer/commands"};
// The viewer stands beside these: neither includes the other.
const std::set<std::string> kBesideViewer = {"trainer/eval", "trainer/person", "trainer/import",
                                             "trainer/stages"};

constexpr size_t kMostFiles = 25;  // of one folder

// Text of each source file by its path from the root.
using Sources = std::map<std::string, std::string>;

Sources readSources(const fs::path& root, const std::vector<std::string>& folders,
                    const std::set<std::string>& endings) {
    Sources sources;
    for (const std::string& folder : folders)
        for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
            if (!endings.contains(entry.path().extension())) continue;
            std::stringstream text;
            text << std::ifstream(entry.path()).rdbuf();
            sources[fs::relative(entry.path(), root).generic_string()] = text.str();
        }
    return sources;
}

std::string folderOf(const std::string& file) { return fs::path(file).parent_path().string(); }
// A header and its source file are one unit.
std::string unitOf(const std::string& file) { return fs::path(file).replace_extension().string(); }

std::vector<std::string> includesOf(const std::string& text) {
    static const std::regex kInclude("#include \"([^\"]+)\"");
    std::vector<std::string> includes;
    for (std::sregex_iterator i(text.begin(), text.end(), kInclude), end; i != end; ++i)
        includes.push_back((*i)[1]);
    return includes;
}

// Includes that go up, "FILE includes FILE", and files in folders that have no place in the order.
std::vector<std::string> includesUp(const Sources& sources) {
    std::vector<std::string> found;
    auto placeOf = [](fs::path folder) {
        auto place = std::ranges::find(kOrder, folder.string());
        while (place == kOrder.end() && folder.has_parent_path()) {
            folder = folder.parent_path();
            place = std::ranges::find(kOrder, folder.string());
        }
        return place;
    };
    auto ofViewer = [](const fs::path& folder) {
        return !folder.empty() && *folder.begin() == "viewer";
    };
    for (const auto& [file, text] : sources) {
        const std::string folder = folderOf(file);
        if (placeOf(folder) == kOrder.end())
            found.push_back(file + " lies in a folder without a place in the order");
        for (const std::string& include : includesOf(text)) {
            const std::string other = folderOf(include);
            if (!sources.contains(include)) continue;  // a shader's parameters, say
            bool beside = ofViewer(folder) ? kBesideViewer.contains(other)
                                           : kBesideViewer.contains(folder) && ofViewer(other);
            if (beside || placeOf(other) > placeOf(folder))
                found.push_back(file + " includes " + include);
        }
    }
    return found;
}

// Units that include each other, directly or through others: "A, B, C".
std::vector<std::string> cycles(const Sources& sources) {
    std::map<std::string, std::set<std::string>> uses;
    for (const auto& [file, text] : sources)
        for (const std::string& include : includesOf(text))
            if (sources.contains(include) && unitOf(include) != unitOf(file))
                uses[unitOf(file)].insert(unitOf(include));
    // All that a unit reaches.
    std::map<std::string, std::set<std::string>> reached;
    for (const auto& [unit, direct] : uses) {
        std::vector<std::string> waiting(direct.begin(), direct.end());
        while (!waiting.empty()) {
            std::string next = waiting.back();
            waiting.pop_back();
            if (!reached[unit].insert(next).second) continue;
            if (auto more = uses.find(next); more != uses.end())
                waiting.insert(waiting.end(), more->second.begin(), more->second.end());
        }
    }
    std::set<std::string> found;
    for (const auto& [unit, all] : reached) {
        if (!all.contains(unit)) continue;
        std::string names;
        for (const std::string& other : all)
            if (reached[other].contains(unit)) names += (names.empty() ? "" : ", ") + other;
        found.insert(names);
    }
    return {found.begin(), found.end()};
}

// Folders that hold too many files themselves.
std::vector<std::string> crowded(const fs::path& root, const std::vector<std::string>& folders) {
    std::map<std::string, size_t> counts;
    for (const std::string& folder : folders)
        for (const auto& entry : fs::recursive_directory_iterator(root / folder))
            if (entry.is_regular_file())
                ++counts[folderOf(fs::relative(entry.path(), root).generic_string())];
    std::vector<std::string> found;
    for (const auto& [folder, count] : counts)
        if (count > kMostFiles)
            found.push_back(folder + " holds " + std::to_string(count) + " files");
    return found;
}

// Whether the first twelve lines of a shader say what it computes: a comment of two lines or more
// has a formula (an equals sign), and a comment has a shape (a bracket).
bool saysWhatItComputes(const std::string& shader) {
    std::istringstream lines(shader);
    std::string line;
    int length = 0;  // of the comment at hand
    bool formula = false, blockFormula = false, shape = false;
    for (int i = 0; i < 12 && std::getline(lines, line); ++i) {
        const size_t comment = line.find("//");
        if (comment != std::string::npos) shape |= line.find('[', comment) != std::string::npos;
        length = comment == 0 ? length + 1 : 0;
        blockFormula = length > 0 && ((length > 1 && blockFormula) || line.find('=') != line.npos);
        formula |= length >= 2 && blockFormula;
    }
    return formula && shape;
}

// Files in which a word says that something is not done.
std::vector<std::string> unfinished(const Sources& sources) {
    static const std::regex kWord("\\b(TODO|FIXME|XXX|HACK)\\b");
    std::vector<std::string> found;
    for (const auto& [file, text] : sources)
        if (std::regex_search(text, kWord)) found.push_back(file);
    return found;
}

testing::AssertionResult isEmpty(const std::vector<std::string>& sentences) {
    if (sentences.empty()) return testing::AssertionSuccess();
    std::string text;
    for (const std::string& sentence : sentences) text += "\n" + sentence;
    return testing::AssertionFailure() << sentences.size() << ":" << text;
}

const fs::path kRoot = test::sourceFolder();
const std::vector<std::string> kCode = {"engine", "nn", "trainer", "viewer"};
const std::vector<std::string> kFolders = {"engine", "nn", "trainer", "viewer", "shaders"};

TEST(Layers, NoIncludeGoesUp) {
    EXPECT_TRUE(isEmpty(includesUp(readSources(kRoot, kCode, {".h", ".cpp"}))));
}
TEST(Layers, NoCycles) { EXPECT_TRUE(isEmpty(cycles(readSources(kRoot, kCode, {".h", ".cpp"})))); }
TEST(Layers, FoldersAreSmall) { EXPECT_TRUE(isEmpty(crowded(kRoot, kFolders))); }

TEST(Layers, EveryShaderSaysWhatItComputes) {
    std::vector<std::string> silent;
    for (const auto& [file, text] : readSources(kRoot, {"shaders"}, {".comp"}))
        if (!saysWhatItComputes(text)) silent.push_back(file);
    EXPECT_TRUE(isEmpty(silent));
}

TEST(Layers, NothingIsLeftForLater) {
    Sources sources = readSources(kRoot, {"engine", "nn", "trainer", "viewer", "shaders", "tests"},
                                  {".h", ".cpp", ".comp", ".glsl"});
    sources.erase("tests/test_layers.cpp");
    EXPECT_TRUE(isEmpty(unfinished(sources)));
}

// ---- the checks themselves ----------------------------------------------------------------------

TEST(LayerChecks, FindIncludesUpAndCycles) {
    const Sources sources = {
        {"engine/a.h", "#include \"engine/b.h\"\n#include <vector>\n"},
        {"engine/b.h", ""},
        {"engine/b.cpp", "#include \"engine/b.h\"\n#include \"engine/c.h\"\n"},
        {"engine/c.h", "#include \"engine/a.h\"\n#include \"nn/core/d.h\"\n"},
        {"nn/core/d.h", "#include \"common/shared.h\"\n"},
        {"viewer/e.h", "#include \"trainer/eval/f.h\"\n#include \"trainer/avatar/g.h\"\n"},
        {"trainer/avatar/g.h", ""},
        {"trainer/eval/f.h", ""},
        {"trainer/eval/f.cpp", "#include \"viewer/e.h\"\n"},
        {"trainer/h.h", ""}};
    EXPECT_EQ(includesUp(sources),
              (std::vector<std::string>{"engine/c.h includes nn/core/d.h",
                                        "trainer/eval/f.cpp includes viewer/e.h",
                                        "trainer/h.h lies in a folder without a place in the order",
                                        "viewer/e.h includes trainer/eval/f.h"}));
    EXPECT_EQ(cycles(sources), (std::vector<std::string>{"engine/a, engine/b, engine/c",
                                                         "trainer/eval/f, viewer/e"}));
}

TEST(LayerChecks, CountAFoldersOwnFiles) {
    test::Folder root;
    fs::create_directories(root / "nn" / "ops");
    for (size_t i = 0; i < kMostFiles; ++i) {
        root.write("nn/" + std::to_string(i), "");
        root.write("nn/ops/" + std::to_string(i), "");
    }
    EXPECT_TRUE(crowded(root.path(), {"nn"}).empty());
    root.write("nn/ops/one_more", "");
    EXPECT_EQ(crowded(root.path(), {"nn"}), std::vector<std::string>{"nn/ops holds 26 files"});
}

TEST(LayerChecks, ReadTheHeadOfAShader) {
    EXPECT_TRUE(saysWhatItComputes("#version 460\n// y = a x, where x and y are\n// [n].\n"));
    EXPECT_TRUE(saysWhatItComputes("// Scales:\n// y = a x.\nBUFFER(0, x);  // [n]\n"));
    EXPECT_FALSE(saysWhatItComputes("#version 460\n// y = a x\nBUFFER(0, x);  // [n]\n"));
    EXPECT_FALSE(saysWhatItComputes("// Scales and\n// shifts.\nuint a = b;\nuint c;  // [n]\n"));
    EXPECT_FALSE(saysWhatItComputes("// Scales:\n// y = a x.\nuint a[2];\n"));
    EXPECT_FALSE(saysWhatItComputes(std::string(12, '\n') + "// y = x\n// [n]\n"));
    EXPECT_EQ(unfinished({{"a", "// TODO: all"}, {"b", "uint METHODOLOGY;"}}),
              std::vector<std::string>{"a"});
}

}  // namespace
}  // namespace doppel
