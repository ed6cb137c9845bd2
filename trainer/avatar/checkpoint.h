// Training state on disk, so that a stopped run can go on and end as if it had not been stopped.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "engine/io/safetensors.h"
#include "nn/core/parameters.h"

namespace doppel {

// What the list in an avatar's folder calls it (trainer/data/output_folder.h).
inline constexpr const char* kAvatarKind = "avatar";

// checkpoints/STAGE.safetensors: what a stage keeps, and the step; with what must agree for a run
// to go on.
class Checkpoint {
public:
    Checkpoint(std::filesystem::path folder, std::string stage,
               std::map<std::string, std::string> identity);

    // What the file holds: values and both moments of trained parameters, values alone of running
    // statistics. Names are unique in a checkpoint; the parameters outlive it.
    void keepTrained(std::string name, Parameters& parameters);
    void keepStatistics(std::string name, Parameters& parameters);

    const std::filesystem::path& path() const { return path_; }
    // Steps done; 0 where there is no checkpoint. InputError where it belongs to another run or
    // lacks something, and then nothing is changed on the device.
    int64_t restore();
    // Appears whole or not at all.
    void save(int64_t stepsDone);
    // Whether the last one is older than so many seconds; never for 0.
    bool due(double seconds) const;
    // The stage is done.
    void remove();

private:
    struct Part {
        std::string prefix;
        Parameters* parameters;
        Parameters::Section section;
    };
    std::filesystem::path path_;
    std::map<std::string, std::string> identity_;
    std::vector<Part> parts_;
    std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

// checkpoints/run.toml, which is there from a run's start to its end: what was asked for, and the
// stages that are done.
struct RunRecord {
    std::map<std::string, std::string> asked;
    std::vector<std::string> done;

    bool isDone(const std::string& stage) const;
};

// Nothing where the avatar's folder has no unfinished run. InputError for a file that is not ours.
std::optional<RunRecord> readRunRecord(const std::filesystem::path& avatar);
void writeRunRecord(const std::filesystem::path& avatar, const RunRecord& record);

double secondsSince1970();

// checkpoints/stage.toml, while a stage's steps are taken: what its curves (log/losses_STAGE.csv) do
// not tell those who watch.
struct StageRecord {
    std::string stage, device;
    int64_t steps = 0, first = 0;  // in all, and done before this process went on with it
    double began = 0;              // when it did: secondsSince1970()
    bool operator==(const StageRecord&) const = default;
};

// Nothing where no stage is at its steps. InputError for a file that is not ours.
std::optional<StageRecord> readStageRecord(const std::filesystem::path& avatar);
void writeStageRecord(const std::filesystem::path& avatar, const StageRecord& record);
// With the folder, where it was all that was in it.
void removeStageRecord(const std::filesystem::path& avatar);

// Removes the record with all other training state, and what killed runs have left of it: the run
// is done, or starts over. Files that Doppel does not write there stay.
void removeTrainingState(const std::filesystem::path& avatar);

// InputError naming `where`, the tensor and the element where a number is not finite.
void requireFinite(const WeightMap& weights, const std::string& where);

// Every parameter's values as float32 arrays, and back. InputError naming `where` for a missing
// parameter or another shape.
WeightMap readWeights(const Parameters& parameters);
void loadWeights(Parameters& parameters, const WeightMap& weights, const std::string& where);

}  // namespace doppel
