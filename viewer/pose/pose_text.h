// Poses and sessions as JSON: for the clipboard, for --pose, and for what a killed viewer leaves.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "viewer/pose/take.h"

namespace doppel {

// {"doppel_pose": 1, "joints": {"left_wrist": [x, y, z], …}, "trans": [x, y, z],
//  "betas": [10 numbers]}
// Rotations are axis-angle in radians.
std::string poseText(const Pose& pose, const Betas& betas);

// Takes what is there and leaves the rest: joints that are not named, trans. betas say whose pose
// it was, and have to be right, too: her shape does not go over to somebody else. InputError,
// nothing being changed, where the text is longer than 64 KiB, is not JSON, names what does not
// exist, or holds something else than finite numbers of sensible size.
void readPoseText(std::string_view text, Pose& pose);

// What was being edited, and over which files. The take's motion is not in it, but its name is.
struct Session {
    std::string avatar, motion, frames;  // absolute paths; frames: of the motion, as --frames says
    std::string saved;                   // the file that it was written to last; empty: none
    std::string when;                    // for people
    double time = 0;                     // of the timeline
    bool edited = true;                  // the take is not saved
    Take take;
    std::map<std::string, std::string> worn;  // what is mixed and not saved: whose avatar gives a
                                              // part, by the part's name; absolute paths
};
std::string sessionText(const Session& session);

// InputError that begins with `name` where the text is no session, or holds what a session cannot.
Session readSessionText(std::string_view text, const std::string& name);

}  // namespace doppel
