#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/tensorboard.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"

namespace doppel {
namespace fs = std::filesystem;

struct LossLog::Files {
    fs::path csvPath;
    std::ofstream csv;
    std::unique_ptr<EventWriter> events;
};

namespace {

struct Row {
    int64_t step;
    std::vector<double> values;
};

// The rows before `end`, up to the first that is not ours or was cut short.
std::vector<Row> keptRows(const fs::path& path, const std::string& header, int64_t end) {
    std::vector<Row> rows;
    std::error_code error;
    if (!fs::exists(path, error)) return rows;
    const std::vector<uint8_t> bytes = readWholeFile(path);
    std::istringstream text(std::string(bytes.begin(), bytes.end()));
    std::string line;
    if (!std::getline(text, line) || line != header) return rows;
    const auto columns = size_t(std::count(header.begin(), header.end(), ','));
    while (std::getline(text, line) && !text.eof()) {
        Row row{0, {}};
        const char *at = line.data(), *last = line.data() + line.size();
        auto result = std::from_chars(at, last, row.step);
        while (result.ec == std::errc() && result.ptr < last && *result.ptr == ',') {
            double value = 0;
            result = std::from_chars(result.ptr + 1, last, value);
            row.values.push_back(value);
        }
        if (result.ec != std::errc() || result.ptr != last || row.values.size() != columns) break;
        if (row.step < end) rows.push_back(std::move(row));
    }
    return rows;
}

}  // namespace

LossLog::LossLog(const fs::path& folder, std::string stage, std::vector<std::string> columns,
                 int64_t firstStep)
    : files_(std::make_unique<Files>()), stage_(std::move(stage)), columns_(std::move(columns)) {
    createFolders(folder);
    files_->csvPath = folder / fmt::format("losses_{}.csv", stage_);
    const std::string header = fmt::format("step,{}", fmt::join(columns_, ","));
    std::vector<Row> rows;
    if (firstStep > 0) rows = keptRows(files_->csvPath, header, firstStep);

    // Both are written afresh from the rows that count, so that they always agree.
    files_->csv.open(files_->csvPath, std::ios::trunc);
    if (!files_->csv) throwMachine("{}: cannot be written", files_->csvPath.string());
    files_->csv << header << "\n";
    const fs::path events = folder / "events" / stage_;
    std::error_code ignored;
    fs::remove_all(events, ignored);
    files_->events = std::make_unique<EventWriter>(events);
    for (const Row& row : rows) add(row.step, row.values);
    flush();
}

LossLog::~LossLog() = default;

void LossLog::add(int64_t step, const std::vector<double>& values) {
    CHECK(values.size() == columns_.size(), "a row has {} values, not {}", columns_.size(),
          values.size());
    files_->csv << fmt::format("{},{:.9g}\n", step, fmt::join(values, ","));
    for (size_t i = 0; i < values.size(); ++i) {
        files_->events->scalar(fmt::format("{}/{}", stage_, columns_[i]), step, float(values[i]));
    }
    flush();  // curves are watched while they grow
}

void LossLog::flush() {
    files_->csv.flush();
    if (!files_->csv) {
        throwMachine("{}: cannot be written; is the disk full?", files_->csvPath.string());
    }
}

}  // namespace doppel
