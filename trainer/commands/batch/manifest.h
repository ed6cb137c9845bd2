// Who is to become an avatar, and how: a TOML file that people write by hand or by a script.
//
//     flags = ["--preset", "small"]        # of `doppel avatar`, for everybody
//
//     [[person]]
//     name = "anna"                        # her folder in --out: letters, digits, - and _
//     input = "clips/anna.mp4"             # a clip, a folder of pictures, a capture
//     flags = ["--every", "3"]             # behind everybody's; optional, as all that follows
//     motion = "dance.bvh"                 # `doppel render` films her in it, on a turntable
//     export = "glb"                       # `doppel export`: glb, vrm, usda or obj
//
// Or a table, a .csv, whose first line has these names; flags are words with spaces between them:
//
//     name,input,flags,motion,export
//     anna,clips/anna.mp4,--preset small --every 3,dance.bvh,glb
//
// Paths are as seen from the manifest's folder.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace doppel::batch {

struct Person {
    std::string name;
    int line = 0;  // in the manifest
    std::filesystem::path input, motion;
    std::vector<std::string> flags;  // everybody's, then theirs
    std::string format;              // of the export; empty: none
};

// InputError with a line for everything that is wrong: unknown keys, names that are no folder's or
// there twice, inputs that are not there.
std::vector<Person> readManifest(const std::filesystem::path& path);

}  // namespace doppel::batch
