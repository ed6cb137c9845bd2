#include "trainer/avatar/checkpoint.h"

#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"
#include "engine/io/safetensors.h"
#include "trainer/data/output_folder.h"

namespace doppel {

namespace fs = std::filesystem;

namespace {

fs::path recordPath(const fs::path& avatar) { return avatar / "checkpoints" / "run.toml"; }
fs::path stagePath(const fs::path& avatar) { return avatar / "checkpoints" / "stage.toml"; }

void writeTable(const fs::path& path, const toml::table& table) {
    std::ostringstream text;
    text << table << "\n";
    createFolders(path.parent_path());
    AtomicFile file(path);
    file.write(text.str());
    file.commit();
}

// Nothing where there is no such file.
std::optional<toml::table> readTable(const fs::path& path) {
    std::error_code error;
    if (!fs::exists(path, error)) return std::nullopt;
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{1} << 20);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    try {
        return toml::parse(text, path.string());
    } catch (const toml::parse_error& parse) {
        throwInput("{}: line {}: not TOML: {}; --restart starts over", path.string(),
                   parse.source().begin.line, parse.description());
    }
}

void addSection(WeightMap& arrays, const std::string& prefix, const Parameters& parameters,
                Parameters::Section section) {
    for (const Parameters::Entry& entry : parameters.entries()) {
        auto [place, fresh] =
            arrays.insert({prefix + entry.name, {entry.shape, parameters.read(entry, section)}});
        CHECK(fresh, "{} is there once", place->first);
    }
}

void checkSection(const Parameters& parameters, const WeightMap& arrays, const std::string& prefix,
                  const std::string& where) {
    for (const Parameters::Entry& entry : parameters.entries()) {
        auto found = arrays.find(prefix + entry.name);
        if (found == arrays.end())
            throwInput("{}: expected a tensor {}{}, found none", where, prefix, entry.name);
        if (found->second.shape != entry.shape)
            throwInput("{}: {}{}: expected shape {}, found {}", where, prefix, entry.name,
                       toString(entry.shape), toString(found->second.shape));
    }
}

void loadSection(Parameters& parameters, Parameters::Section section, const WeightMap& arrays,
                 const std::string& prefix) {
    for (const Parameters::Entry& entry : parameters.entries())
        parameters.write(entry, arrays.at(prefix + entry.name).values, section);
}

}  // namespace

void requireFinite(const WeightMap& weights, const std::string& where) {
    for (const auto& [name, tensor] : weights)
        for (size_t i = 0; i < tensor.values.size(); ++i)
            if (!std::isfinite(tensor.values[i]))
                throwInput("{}: {}: expected finite numbers, found {} in element {}", where,
                           printable(name), tensor.values[i], i);
}

WeightMap readWeights(const Parameters& parameters) {
    WeightMap weights;
    addSection(weights, "", parameters, Parameters::kValues);
    return weights;
}

void loadWeights(Parameters& parameters, const WeightMap& weights, const std::string& where) {
    checkSection(parameters, weights, "", where);
    loadSection(parameters, Parameters::kValues, weights, "");
}

// ---- one stage ----------------------------------------------------------------------------------

Checkpoint::Checkpoint(fs::path folder, std::string stage,
                       std::map<std::string, std::string> identity)
    : path_(folder / (stage + ".safetensors")), identity_(std::move(identity)) {
    identity_["stage"] = std::move(stage);
}

void Checkpoint::keepTrained(std::string name, Parameters& parameters) {
    parts_.push_back({name + ".value.", &parameters, Parameters::kValues});
    parts_.push_back({name + ".moment1.", &parameters, Parameters::kMoment1});
    parts_.push_back({name + ".moment2.", &parameters, Parameters::kMoment2});
}

void Checkpoint::keepStatistics(std::string name, Parameters& parameters) {
    parts_.push_back({name + ".value.", &parameters, Parameters::kValues});
}

int64_t Checkpoint::restore() {
    if (!fs::exists(path_)) return 0;
    Safetensors file = readSafetensors(path_);
    for (const auto& [key, value] : identity_) {
        auto found = file.metadata.find(key);
        std::string there = found == file.metadata.end() ? "nothing" : found->second;
        if (there != value)
            throwInput(
                "{}: it was made with {} = {}, this run has {}; --restart starts over, without it",
                path_.string(), key, there, value);
    }
    const std::string& done = file.metadata["steps_done"];
    int64_t steps = -1;
    auto [end, error] = std::from_chars(done.data(), done.data() + done.size(), steps);
    if (error != std::errc() || end != done.data() + done.size() || steps < 0)
        throwInput("{}: steps_done: expected a number from 0 on, found \"{}\"", path_.string(),
                   done);
    for (const Part& part : parts_)
        checkSection(*part.parameters, file.tensors, part.prefix, path_.string());
    requireFinite(file.tensors, path_.string());
    for (const Part& part : parts_)
        loadSection(*part.parameters, part.section, file.tensors, part.prefix);
    return steps;
}

void Checkpoint::save(int64_t stepsDone) {
    createFolders(path_.parent_path());
    Safetensors file;
    for (const Part& part : parts_)
        addSection(file.tensors, part.prefix, *part.parameters, part.section);
    file.metadata = identity_;
    file.metadata["steps_done"] = fmt::format("{}", stepsDone);
    writeSafetensors(path_, file);
    last_ = std::chrono::steady_clock::now();
}

bool Checkpoint::due(double seconds) const {
    std::chrono::duration<double> age = std::chrono::steady_clock::now() - last_;
    return seconds > 0 && age.count() >= seconds;
}

void Checkpoint::remove() {
    std::error_code ignored;
    fs::remove(path_, ignored);
}

// ---- the run ------------------------------------------------------------------------------------

bool RunRecord::isDone(const std::string& stage) const {
    return std::ranges::count(done, stage) > 0;
}

std::optional<RunRecord> readRunRecord(const fs::path& avatar) {
    const fs::path path = recordPath(avatar);
    const std::optional<toml::table> table = readTable(path);
    if (!table) return std::nullopt;
    const toml::table* asked = (*table)["asked"].as_table();
    const toml::array* done = (*table)["done"].as_array();
    if (!asked || !done)
        throwInput(
            "{}: expected a table asked and a list done, found others; --restart starts over",
            path.string());
    RunRecord record;
    for (const auto& [key, value] : *asked)
        record.asked[std::string(key.str())] = value.value_or(std::string());
    for (const toml::node& stage : *done) record.done.push_back(stage.value_or(std::string()));
    return record;
}

void writeRunRecord(const fs::path& avatar, const RunRecord& record) {
    toml::table asked;
    for (const auto& [key, value] : record.asked) asked.insert(key, value);
    toml::array done;
    for (const std::string& stage : record.done) done.push_back(stage);
    writeTable(recordPath(avatar), toml::table{{"asked", asked}, {"done", done}});
}

double secondsSince1970() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch())
        .count();
}

std::optional<StageRecord> readStageRecord(const fs::path& avatar) {
    const fs::path path = stagePath(avatar);
    const std::optional<toml::table> table = readTable(path);
    if (!table) return std::nullopt;
    const auto stage = (*table)["stage"].value<std::string>(),
               device = (*table)["device"].value<std::string>();
    const auto steps = (*table)["steps"].value<int64_t>(),
               first = (*table)["first"].value<int64_t>();
    const auto began = (*table)["began"].value<double>();
    // The stage is a part of a file's name.
    constexpr size_t kLongestStage = 40, kLongestDevice = 256;
    constexpr int64_t kMostSteps = 1'000'000'000;
    constexpr double kLatest = 1e11;
    const bool good = stage && device && steps && first && began && !stage->empty() &&
                      stage->size() <= kLongestStage &&
                      std::ranges::all_of(*stage, [](char c) { return c >= 'a' && c <= 'z'; }) &&
                      device->size() <= kLongestDevice && *steps <= kMostSteps && *first >= 0 &&
                      *first <= *steps && *began >= 0 && *began <= kLatest;
    if (!good)
        throwInput("{}: expected a stage's name, device, steps, first and began, found others",
                   path.string());
    return StageRecord{*stage, *device, *steps, *first, *began};
}

void writeStageRecord(const fs::path& avatar, const StageRecord& record) {
    writeTable(stagePath(avatar), toml::table{{"stage", record.stage},
                                              {"device", record.device},
                                              {"steps", record.steps},
                                              {"first", record.first},
                                              {"began", record.began}});
}

void removeStageRecord(const fs::path& avatar) {
    std::error_code ignored;
    fs::remove(stagePath(avatar), ignored);
    fs::remove(stagePath(avatar).parent_path(), ignored);  // unless there is something else in it
}

void removeTrainingState(const fs::path& avatar) {
    fs::path folder = avatar / "checkpoints";
    std::error_code ignored;
    removeOutputFolder(folder / "live", kAvatarKind);
    // The record goes last: while it is there, the run counts as unfinished.
    for (const char* name : {"fit.safetensors", "shape.safetensors", "texels.safetensors",
                             "caps.safetensors", "mesh.safetensors", "texture.safetensors",
                             "refine.safetensors", "poses.npz", "stage.toml", "run.toml"}) {
        removeLeftovers(folder / name);
        fs::remove(folder / name, ignored);
    }
    fs::remove(folder, ignored);  // unless there is something else in it
}

}  // namespace doppel
