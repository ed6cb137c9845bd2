// capture.toml: what a capture says of itself.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "trainer/data/pose.h"

namespace doppel {

struct CaptureNotes {
    std::string name;
    double fps = 30;
    std::string actor, motion;
    std::vector<std::string> frames;  // empty: not listed
    std::string scheme;               // of the keypoints; empty: not said
    std::map<std::string, std::string> source;
    std::optional<Betas> sourceBetas;
};

// Where the folder has no capture.toml, its name is the capture's. InputErrors name the file, the
// field, what was expected and what was found.
CaptureNotes readNotes(const std::filesystem::path& folder);

// The film or folder that a capture was made of, as its notes say (source.folder); empty: not said,
// or not there any more. InputErrors as of readNotes().
std::filesystem::path clipOf(const std::filesystem::path& folder);

// Files and folders that a motion's file or folder stands for and that nothing may be written over:
// itself, the capture that it is a file of, and what that capture was made of.
std::vector<std::filesystem::path> originsOf(const std::filesystem::path& motion);

std::string notesText(const CaptureNotes& notes);

// fps, where it is a number of frames per second; InputError otherwise. what: file and field.
double checkedFps(double fps, const std::string& what);

}  // namespace doppel
