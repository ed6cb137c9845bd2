// A job that goes on while the window answers.
#pragma once

#include <filesystem>
#include <future>

namespace doppel {

// A glTF file, or an avatar, being written in the background.
struct ExportJob {
    std::future<void> done;
    std::filesystem::path out;
};

}  // namespace doppel
