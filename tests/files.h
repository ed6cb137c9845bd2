// Temporary folders and refusals, for the tests of file formats.
#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace doppel::test {

// The source that the tests came from, with their data; DOPPEL_SOURCE says where it is on another
// machine.
inline std::filesystem::path sourceFolder() {
    const char* elsewhere = std::getenv("DOPPEL_SOURCE");
    return elsewhere && *elsewhere ? elsewhere : DOPPEL_SOURCE_DIR;
}

// A fresh folder, gone with the object.
class Folder {
public:
    Folder() {
        std::string name = (std::filesystem::temp_directory_path() / "doppel-test-XXXXXX").string();
        if (mkdtemp(name.data()) == nullptr) std::abort();
        path_ = name;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    const std::filesystem::path& path() const { return path_; }
    std::filesystem::path operator/(std::string_view name) const { return path_ / name; }

    void write(std::string_view name, std::span<const uint8_t> bytes) const {
        std::ofstream out(path_ / name, std::ios::binary | std::ios::trunc);
        out.write(reinterpret_cast<const char*>(bytes.data()),
                  static_cast<std::streamsize>(bytes.size()));
        if (!out.flush()) std::abort();
    }
    void write(std::string_view name, const std::string& text) const {
        write(name, std::span(reinterpret_cast<const uint8_t*>(text.data()), text.size()));
    }
    void link(const std::filesystem::path& to, std::string_view name) const {
        std::filesystem::create_symlink(to, path_ / name);
    }

    // What is in the folder, hidden files included, sorted.
    std::vector<std::string> names() const {
        std::vector<std::string> names;
        for (const auto& entry : std::filesystem::directory_iterator(path_)) {
            names.push_back(entry.path().filename().string());
        }
        std::sort(names.begin(), names.end());
        return names;
    }

private:
    std::filesystem::path path_;
};

// All of a file; nothing where there is none.
inline std::string bytesOf(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

// The sentence of the error that `call` throws; a test failure where it throws none.
template <typename Error, typename Call>
std::string messageOf(Call call) {
    try {
        call();
    } catch (const Error& error) {
        return error.what();
    }
    ADD_FAILURE() << "no error was thrown";
    return {};
}

}  // namespace doppel::test
