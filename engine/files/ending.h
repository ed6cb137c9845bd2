// What a file's name ends in, by which formats are told apart.
#pragma once

#include <filesystem>
#include <string>

namespace doppel {

// ".glb" of "Me.GLB": in lower case, since names come from systems that do not tell cases apart.
// Empty where there is none.
inline std::string endingOf(const std::filesystem::path& path) {
    std::string ending = path.extension().string();
    for (char& c : ending)
        if (c >= 'A' && c <= 'Z') c = static_cast<char>(c + 32);
    return ending;
}

}  // namespace doppel
