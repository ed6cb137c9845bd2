// Layouts of other programs' recordings, each of which one source file knows.
#pragma once

#include <filesystem>
#include <string>

#include "engine/device.h"
#include "nn/body/body.h"
#include "trainer/data/capture.h"
#include "trainer/import/clip.h"
#include "trainer/import/masks/clip_cutter.h"
#include "trainer/person/blazepose.h"

namespace doppel {

// What to read.
struct ImportRequest {
    std::filesystem::path source;
    std::string frames;           // selectFrames; empty: all
    double fps = 30;              // of the recording, where the layout does not say
    bool key = false;             // frames without a mask will get one
    std::filesystem::path poses;  // of another program, in the place of the source's; may be empty
    bool givenHeads = false;      // heads of given poses stay as they are, see takeSeenHeads

    // Of a clip, whose frames and person have to be found first:
    ClipOptions clip;  // frames and fps are those above
    PoseNet net = PoseNet::Heavy;
    int person = 0;                 // see PersonTracker
    double fov = 0;                 // degrees that the longer side sees; 0: as its file says, else
                                    // kGuessedAngle
    double height = 0;              // of the person, metres; 0: not known
    std::filesystem::path plate;    // a picture of the empty scene; empty: none
    std::filesystem::path matting;  // an ONNX file, see MattingNetwork; empty: none
    std::string mattingKind = "modnet";
    CutOutBy cutOutBy = CutOutBy::All;  // masks of its own
    std::filesystem::path masks;        // of all its pictures, see GivenMasks; empty: none
    Device* device = nullptr;           // that networks run on
    const BodyModel* body = nullptr;    // that is posed
    std::filesystem::path workspace;    // where frames (images/) and masks (masks/) go
    bool goesOn = false;                // what is found is kept there, for a run that goes on
};

// In the workspace while a clip is imported: what its networks have found (AnswerLog), and their
// masks.
inline constexpr const char *kAnswersFile = "answers", *kSharesFolder = "shares";

// A capture whose files are still where they were, or in the request's workspace.
struct ImportSource {
    Capture capture;
    std::string layout;  // its importer's name
};

// One layout. It registers itself, declared as a constant of the source file that reads it:
//
//     const Importer kRetargeting{{
//         .name = "human-retargeting",
//         .looks = "images/ and smpl_pose/ (Human Retargeting)",
//         .recognises = [](const fs::path& source) { ... },
//         .read = readRetargeting,
//     }};
class Importer {
public:
    struct Declaration {
        const char* name;     // kept in capture.toml
        const char* looks;    // for the error that lists what is known
        bool isClip = false;  // whose person has to be found
        // By content; no two importers recognise the same. source: a folder or a file.
        bool (*recognises)(const std::filesystem::path& source);
        // InputErrors name the file, the field, what was expected and what was found.
        Capture (*read)(const ImportRequest& request);
    };
    explicit Importer(const Declaration& declaration);
};

// InputError where no importer recognises the source: what they look for, and what was found.
ImportSource readImportSource(const ImportRequest& request);

}  // namespace doppel
