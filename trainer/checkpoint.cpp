#include "trainer/checkpoint.h"

#include <charconv>

#include "engine/io/safetensors.h"
#include "trainer/output_folder.h"

namespace doppel {

namespace {

constexpr std::chrono::minutes kInterval{3};

void addSection(WeightMap& arrays, const std::string& prefix, const Parameters& parameters,
                Parameters::Section section) {
    for (const Parameters::Entry& entry : parameters.entries())
        arrays[prefix + entry.name] = {entry.shape, parameters.read(entry, section)};
}

void loadSection(Parameters& parameters, Parameters::Section section, const WeightMap& arrays,
                 const std::string& prefix, const std::string& where) {
    for (const Parameters::Entry& entry : parameters.entries()) {
        auto found = arrays.find(prefix + entry.name);
        if (found == arrays.end())
            throwInput("{}: expected a tensor {}{}, found none", where, prefix, entry.name);
        if (found->second.shape != entry.shape)
            throwInput("{}: {}{}: expected shape {}, found {}", where, prefix, entry.name,
                       toString(entry.shape), toString(found->second.shape));
        parameters.write(entry, found->second.values, section);
    }
}

}  // namespace

WeightMap readWeights(const Parameters& parameters) {
    WeightMap weights;
    addSection(weights, "", parameters, Parameters::kValues);
    return weights;
}

void loadWeights(Parameters& parameters, const WeightMap& weights, const std::string& where) {
    loadSection(parameters, Parameters::kValues, weights, "", where);
}

Checkpoint::Checkpoint(std::filesystem::path folder, std::string stage, const Avatar& avatar,
                       uint64_t seed, int64_t steps)
    : path_(folder / (stage + ".safetensors")) {
    identity_["stage"] = stage;
    identity_["seed"] = fmt::format("{}", seed);
    identity_["steps"] = fmt::format("{}", steps);
    identity_["vertices"] = fmt::format("{}", avatar.body.vertexCount);
    for (const auto& [name, value] : presetValues(avatar.preset))
        if (name.starts_with(stage + ".")) identity_[name] = value;
}

int64_t Checkpoint::restore(Parameters& parameters, Parameters* state) const {
    if (!std::filesystem::exists(path_)) return 0;
    Safetensors file = readSafetensors(path_);
    for (const auto& [key, value] : identity_) {
        auto found = file.metadata.find(key);
        std::string there = found == file.metadata.end() ? "nothing" : found->second;
        if (there != value)
            throwInput(
                "{}: it was made with {} = {}, this run has {}; train without --resume to "
                "start over",
                path_.string(), key, there, value);
    }
    const WeightMap& arrays = file.tensors;
    loadSection(parameters, Parameters::kValues, arrays, "value.", path_.string());
    loadSection(parameters, Parameters::kMoment1, arrays, "moment1.", path_.string());
    loadSection(parameters, Parameters::kMoment2, arrays, "moment2.", path_.string());
    if (state) loadSection(*state, Parameters::kValues, arrays, "state.", path_.string());
    const std::string& done = file.metadata["steps_done"];
    int64_t steps = -1;
    auto [end, error] = std::from_chars(done.data(), done.data() + done.size(), steps);
    if (error != std::errc() || end != done.data() + done.size() || steps < 0)
        throwInput("{}: steps_done: expected a number from 0 on, found \"{}\"", path_.string(), done);
    return steps;
}

void Checkpoint::save(const Parameters& parameters, int64_t stepsDone, const Parameters* state) {
    createFolders(path_.parent_path());
    WeightMap arrays;
    addSection(arrays, "value.", parameters, Parameters::kValues);
    addSection(arrays, "moment1.", parameters, Parameters::kMoment1);
    addSection(arrays, "moment2.", parameters, Parameters::kMoment2);
    if (state) addSection(arrays, "state.", *state, Parameters::kValues);
    Safetensors file;
    file.tensors = std::move(arrays);
    file.metadata = identity_;
    file.metadata["steps_done"] = fmt::format("{}", stepsDone);
    writeSafetensors(path_, file);
    last_ = std::chrono::steady_clock::now();
}

void Checkpoint::saveIfDue(const Parameters& parameters, int64_t stepsDone,
                           const Parameters* state) {
    if (std::chrono::steady_clock::now() - last_ >= kInterval) save(parameters, stepsDone, state);
}

void Checkpoint::remove() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
}

}  // namespace doppel
