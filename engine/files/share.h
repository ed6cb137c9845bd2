// Where files are that come with the programs or that their user adds. They are found from where
// the program itself is, so that a build and an installation can be moved.
#pragma once

#include <filesystem>
#include <string>

namespace doppel {

// The source from which the program was built, where it is in its build folder; empty where it is
// installed. CMake leaves a file `doppel-source` beside the programs that it builds.
std::filesystem::path sourceFolder();

// `share/doppel` of the prefix in which the program is installed.
std::filesystem::path shareFolder();

// Where modules are that the program loads when it needs them: beside it in a build folder, else
// `lib/doppel` of the prefix.
std::filesystem::path modulesFolder();

// The folder of what set-up fetches under this name: build/NAME of the source; of an installed
// program NAME in the user's data folder or, where only that is there, in shareFolder().
std::filesystem::path fetchedFolder(const char* name);

// What to do where such a folder lacks something: run scripts/setup --NAME or, where the program is
// installed, doppel-fetch NAME, or name the folder by an environment variable.
std::string fetchAdvice(const char* name, const char* variable);

// $XDG_DATA_HOME/doppel, else $HOME/.local/share/doppel; empty where neither is set.
std::filesystem::path userDataFolder();

}  // namespace doppel
