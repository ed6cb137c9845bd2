#include <fmt/ranges.h>

#include <fstream>
#include <sstream>

#include "engine/error.h"
#include "engine/io/tensorboard.h"
#include "trainer/output_folder.h"
#include "trainer/progress.h"

namespace doppel {

namespace fs = std::filesystem;

struct LossLog::Files {
    fs::path csvPath;
    std::ofstream csv;
    EventWriter events;

    Files(const fs::path& folder, const fs::path& path)
        : csvPath(path), csv(path), events(folder) {}
};

LossLog::LossLog(const fs::path& folder, std::string stage, std::vector<std::string> columns,
                 int64_t firstStep)
    : stage_(std::move(stage)), columns_(std::move(columns)) {
    createFolders(folder);
    // One table per stage, because their columns differ.
    fs::path path = folder / (stage_ + ".csv");
    std::string kept = fmt::format("step,{}\n", fmt::join(columns_, ","));
    if (firstStep > 0) {
        std::ifstream before(path);
        std::string line;
        std::getline(before, line);  // the header
        while (std::getline(before, line)) {
            std::istringstream number(line);
            int64_t step = -1;
            if (number >> step && step < firstStep) kept += line + "\n";
        }
    }
    files_ = std::make_unique<Files>(folder, path);
    files_->csv << kept;
    if (!files_->csv) throwMachine("{}: cannot be written", path.string());
}

LossLog::~LossLog() = default;

void LossLog::add(int64_t step, const std::vector<double>& values) {
    CHECK(values.size() == columns_.size(), "{} values for {} columns", values.size(),
          columns_.size());
    files_->csv << fmt::format("{},{:.6g}\n", step, fmt::join(values, ","));
    if (!files_->csv)
        throwMachine("{}: cannot be written; is the disk full?", files_->csvPath.string());
    for (size_t i = 0; i < values.size(); ++i)
        files_->events.scalar(stage_ + "/" + columns_[i], step, static_cast<float>(values[i]));
}

void LossLog::flush() { files_->csv.flush(); }

}  // namespace doppel
