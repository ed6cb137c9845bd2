// `doppel import`.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "trainer/commands/common_options.h"
#include "trainer/import/import.h"

namespace doppel {

struct ImportOptions {
    CommonOptions common;
    ImportSettings settings;
    std::string net = "heavy";   // poseNetByName
    std::string cutOut = "all";  // cutOutByName
    std::string body;            // "default", "default-full" or a file
};

class CommandFlags;

// Of what a source is made, and how it is brought in: all but where it goes.
void declareImportFlags(CommandFlags& flags, ImportOptions& options);

// The files and folders that are read, for requireApart(); those that are not given are empty.
std::vector<std::filesystem::path> inputsOf(const ImportOptions& options);

// All that the capture depends on.
std::string workOf(const ImportOptions& options);

// Writes the capture; goes on where a run of the same work was stopped.
ImportResult bringIn(const ImportOptions& options);
// What is worth knowing about it, on stdout, and for programs.
void printImport(const ImportOptions& options, const ImportResult& result);
nlohmann::ordered_json importJson(const ImportOptions& options, const ImportResult& result);
// Of that what the capture itself has kept, into `json`.
void tellFindings(const Capture& capture, nlohmann::ordered_json& json);
void runImport(const ImportOptions& options);

}  // namespace doppel
