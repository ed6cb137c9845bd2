// Avatars for browsers: a folder with pages, which shows the avatar with three.js.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace doppel {

// InputError where three.js is not there (scripts/setup --web fetches it) or the pages' own sources
// are not. For a look before there is much work to be lost.
void requireWebSources();

// Puts around folder/avatar.glb, which has to be there, what shows it: index.html, doppel-avatar.js
// and three/ for web servers; page.html, in which all of that is; README.txt. `title` is what the
// pages are called. InputError: as above, and where three.js is another than what scripts/setup
// fetches.
void writeWebPage(const std::filesystem::path& folder, const std::string& title);

}  // namespace doppel
