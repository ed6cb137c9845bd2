#include "trainer/commands/batch/manifest.h"

#include <fmt/format.h>

#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/files/printable.h"

namespace doppel::batch {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMostBytes = uint64_t{64} << 20;
constexpr size_t kMostFlags = 200, kLongest = 64;  // words; letters of a name

bool isName(std::string_view text) {
    return !text.empty() && text.size() <= kLongest && text[0] != '-' &&
           std::ranges::all_of(text, [](char c) {
               return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '-' || c == '_';
           });
}

// What is wrong, line by line.
class Complaints {
public:
    explicit Complaints(const fs::path& file) : file_(file) {}
    template <typename... Args>
    void add(const toml::source_region& where, fmt::format_string<Args...> format, Args&&... args) {
        if (++count_ <= 50)
            text_ +=
                fmt::format("{}{}: line {}: {}", text_.empty() ? "" : "\n", file_.string(),
                            where.begin.line, fmt::format(format, std::forward<Args>(args)...));
    }
    void raise() const {
        if (count_ > 50) throwInput("{}\nand {} more", text_, count_ - 50);
        if (count_ > 0) throwInput("{}", text_);
    }

private:
    fs::path file_;
    std::string text_;
    size_t count_ = 0;
};

std::string textAt(const toml::table& table, std::string_view key, Complaints& wrong) {
    const toml::node* node = table.get(key);
    if (!node) return {};
    const auto text = node->value_exact<std::string>();
    if (!text || text->empty() || text->find('\0') != std::string::npos) {
        wrong.add(node->source(), "{}: expected a text", key);
        return {};
    }
    return *text;
}

std::vector<std::string> flagsAt(const toml::table& table, Complaints& wrong) {
    std::vector<std::string> words;
    const toml::node* node = table.get("flags");
    if (!node) return words;
    const toml::array* array = node->as_array();
    if (!array || array->size() > kMostFlags) {
        wrong.add(node->source(),
                  "flags: expected a list of at most {} texts, as [\"--every\", \"3\"]",
                  kMostFlags);
        return words;
    }
    for (const toml::node& word : *array) {
        const auto text = word.value_exact<std::string>();
        if (!text || text->find('\0') != std::string::npos)
            wrong.add(word.source(), "flags: expected texts, as \"3\" with quotation marks");
        else
            words.push_back(*text);
    }
    return words;
}

void refuseOthers(const toml::table& table, const std::set<std::string_view>& known,
                  Complaints& wrong) {
    for (const auto& [key, value] : table)
        if (!known.contains(key.str()))
            wrong.add(key.source(), "expected one of {}, found {}", fmt::join(known, ", "),
                      printable(key.str()));
}

fs::path placeAt(const toml::table& table, std::string_view key, const fs::path& folder,
                 Complaints& wrong) {
    const std::string text = textAt(table, key, wrong);
    if (text.empty()) return {};
    const fs::path place = fs::absolute(folder / text).lexically_normal();
    std::error_code ignored;
    if (!fs::exists(place, ignored))
        wrong.add(table.get(key)->source(), "{}: expected a file or a folder, found none at {}",
                  key, printable(place.string(), 300));
    return place;
}

const std::set<std::string_view> kKeys{"name", "input", "flags", "motion", "export"};

// The cells of a line (RFC 4180), which ends in no quotation; nothing where it is wrong.
std::optional<std::vector<std::string>> cellsOf(std::string_view line) {
    std::vector<std::string> cells(1);
    bool quoted = false;
    for (size_t i = 0; i < line.size(); ++i) {
        const char c = line[i];
        if (quoted && c == '"' && i + 1 < line.size() && line[i + 1] == '"')
            cells.back() += line[++i];
        else if (c == '"' && (quoted || cells.back().empty()))
            quoted = !quoted;
        else if (c == ',' && !quoted)
            cells.emplace_back();
        else
            cells.back() += c;
    }
    if (quoted) return std::nullopt;
    return cells;
}

std::string tomlText(std::string_view text) {
    std::string quoted = "\"";
    for (char c : text) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
            quoted += fmt::format("\\u{:04X}", static_cast<unsigned char>(c));
        else
            quoted += (c == '"' || c == '\\') ? std::string{'\\', c} : std::string(1, c);
    }
    return quoted + "\"";
}

// A table of people as TOML, each on the line that it has, for one reader tells what is wrong.
std::string tomlOfCsv(std::string_view text, const std::string& file) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // as spreadsheets begin
    std::string toml;
    std::vector<std::string> keys;
    for (int number = 1; !text.empty(); ++number) {
        const size_t end = std::min(text.find('\n'), text.size());
        std::string_view line = text.substr(0, end);
        text.remove_prefix(std::min(end + 1, text.size()));
        if (line.ends_with('\r')) line.remove_suffix(1);
        const auto cells = cellsOf(line);
        if (!cells) throwInput("{}: line {}: a quotation has no end", file, number);
        if (keys.empty()) {
            keys = *cells;
            for (const std::string& key : keys)
                if (!kKeys.contains(key) || std::ranges::count(keys, key) > 1)
                    throwInput("{}: line {}: expected a head of {}, each once, found {}", file,
                               number, fmt::join(kKeys, ", "), printable(key));
            toml += "person = [";
        } else if (!line.empty()) {
            if (cells->size() != keys.size())
                throwInput("{}: line {}: expected {} cells, as the head has, found {}", file,
                           number, keys.size(), cells->size());
            std::vector<std::string> pairs;
            for (size_t k = 0; k < keys.size(); ++k) {
                const std::string& cell = (*cells)[k];
                if (cell.empty()) continue;
                std::string value = tomlText(cell);
                if (keys[k] == "flags") {
                    std::vector<std::string> words;
                    std::istringstream all(cell);
                    for (std::string word; all >> word;) words.push_back(tomlText(word));
                    value = fmt::format("[{}]", fmt::join(words, ", "));
                }
                pairs.push_back(keys[k] + " = " + value);
            }
            toml += fmt::format("{{ {} }},", fmt::join(pairs, ", "));
        }
        toml += '\n';
    }
    return keys.empty() ? "" : toml + "]\n";
}

}  // namespace

std::vector<Person> readManifest(const fs::path& path) {
    const std::vector<uint8_t> bytes = readWholeFile(path, kMostBytes);
    std::string text(bytes.begin(), bytes.end());
    const bool isCsv = endingOf(path) == ".csv";
    if (isCsv) text = tomlOfCsv(text, path.string());
    toml::table table;
    try {
        table = toml::parse(text, path.string());
    } catch (const toml::parse_error& error) {
        throwInput("{}: line {}: not TOML: {}; `doppel batch --help` shows a manifest",
                   path.string(), error.source().begin.line, error.description());
    }
    Complaints wrong(path);
    const fs::path folder = fs::absolute(path).parent_path();
    refuseOthers(table, {"flags", "person"}, wrong);
    const std::vector<std::string> everybodys = flagsAt(table, wrong);
    wrong.raise();
    const toml::array* people = table["person"].as_array();
    if (!people || people->empty())
        throwInput("{}: expected a {} for each person, found none", path.string(),
                   isCsv ? "line" : "table [[person]]");
    std::vector<Person> found;
    std::map<std::string, int>
        lines;  // of names, in small letters: some file systems know no others
    for (const toml::node& node : *people) {
        const toml::table* of = node.as_table();
        if (!of) {
            wrong.add(node.source(), "person: expected tables [[person]]");
            continue;
        }
        refuseOthers(*of, kKeys, wrong);
        Person person;
        person.line = static_cast<int>(of->source().begin.line);
        person.name = textAt(*of, "name", wrong);
        person.input = placeAt(*of, "input", folder, wrong);
        person.motion = placeAt(*of, "motion", folder, wrong);
        person.flags = everybodys;
        const std::vector<std::string> own = flagsAt(*of, wrong);
        person.flags.insert(person.flags.end(), own.begin(), own.end());
        person.format = textAt(*of, "export", wrong);
        if (!person.format.empty() &&
            std::ranges::count(std::initializer_list<std::string_view>{"glb", "vrm", "usda", "obj"},
                               person.format) == 0)
            wrong.add(of->get("export")->source(),
                      "export: expected glb, vrm, usda or obj, found \"{}\"",
                      printable(person.format));
        if (!of->get("input"))
            wrong.add(of->source(), "input: expected a clip or folder, found none");
        if (!isName(person.name)) {
            wrong.add(of->source(),
                      "name: expected up to {} letters, digits, - and _, no - first, found \"{}\"",
                      kLongest, printable(person.name));
            continue;
        }
        std::string small = person.name;
        std::ranges::transform(small, small.begin(),
                               [](char c) { return c >= 'A' && c <= 'Z' ? char(c + 32) : c; });
        const auto [before, isNew] = lines.try_emplace(small, person.line);
        if (small == "jobs")
            wrong.add(of->source(), "name: expected another than jobs, which has the logs");
        if (!isNew)
            wrong.add(of->source(), "name: expected another than line {}'s, found \"{}\"",
                      before->second, person.name);
        found.push_back(std::move(person));
    }
    wrong.raise();
    return found;
}

}  // namespace doppel::batch
