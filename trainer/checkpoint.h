// Training state on disk, so that an interrupted stage can go on.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

#include "nn/parameters.h"
#include "trainer/avatar.h"

namespace doppel {

// checkpoints/STAGE.safetensors: values and moments of every parameter, the networks' running
// statistics, and the step; with what must agree for a run to go on (preset, seed, body).
class Checkpoint {
public:
    Checkpoint(std::filesystem::path folder, std::string stage, const Avatar& avatar, uint64_t seed,
               int64_t steps);

    const std::filesystem::path& path() const { return path_; }
    // Steps done; 0 where there is no checkpoint. InputError where it belongs to another run.
    int64_t restore(Parameters& parameters, Parameters* state = nullptr) const;
    // Appears whole or not at all.
    void save(const Parameters& parameters, int64_t stepsDone, const Parameters* state = nullptr);
    // Every few minutes.
    void saveIfDue(const Parameters& parameters, int64_t stepsDone,
                   const Parameters* state = nullptr);
    // The stage is done.
    void remove();

private:
    std::filesystem::path path_;
    std::map<std::string, std::string> identity_;
    std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

// Every parameter's values as float32 arrays, and back. InputError naming `where` for a missing
// parameter or another shape.
WeightMap readWeights(const Parameters& parameters);
void loadWeights(Parameters& parameters, const WeightMap& weights, const std::string& where);

}  // namespace doppel
