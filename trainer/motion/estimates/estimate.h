// Poses that other programs have estimated of the people in a clip.
//
//     const Estimates found = readEstimates("wham_output.pkl");
//     found.program;                       // "WHAM"
//     found.people[0].poses[12].picture;   // which picture of the clip it is of
//
// What a program says of its camera is kept as it says it (EstimatedView), since most of it depends
// on the size of the pictures, which these files seldom hold; placePose makes a camera of it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/io/torch_file.h"
#include "trainer/data/camera.h"
#include "trainer/data/pose.h"
#include "trainer/motion/motion.h"

namespace doppel {

// Where a body is seen, by one reading of what the file says.
struct EstimatedView {
    enum class Kind : uint8_t {
        Nowhere,  // the file does not say it
        Metres,   // at `pelvis`, before a camera of the focal length `focal`
        Square,   // u = centre + side/2 · scale · (x + offset), and v likewise: weak perspective
    };
    enum class Focal : uint8_t {
        Guess,    // the file does not say it
        Pixels,   // `focal` pixels
        Longest,  // `focal` times the picture's longer side
        Shortest,
        Diagonal,
    };

    Kind kind = Kind::Nowhere;
    glm::dquat turn{1, 0, 0, 0};  // from the pose's space into the camera's
    // Metres: of the pelvis, camera space (x right, y down, z forward).
    // Square: x, y of the pelvis from the square's centre, metres.
    glm::dvec3 pelvis{0};

    Focal of = Focal::Guess;
    double focal = 0;
    std::optional<glm::dvec2> principal;  // pixels; nothing: the picture's middle
    // Metres: the focal length is a number that the program was trained with and not the camera's:
    // only what it draws in the picture means anything. Nowhere: the program saw a square of the
    // picture with the person in its middle.
    bool nominal = false;

    double scale = 0;      // Square: half sides per metre
    glm::dvec2 centre{0};  // of the square, pixels
    double side = 0;       // of the square, pixels; 0: the picture with bars to a square
};

struct EstimatedPose {
    int64_t picture = 0;  // its number in the clip, from 0
    std::string name;     // of the picture's file, without its ending; empty: not said
    Theta theta{};
    std::vector<EstimatedView> views;  // one per reading
    // Where the file also follows the person in a world that stands still. Trans: metres, for a
    // body whose pelvis rests at kRestPelvis.
    struct World {
        Theta theta{};
        Trans trans{};
    };
    std::optional<World> world;
};

struct EstimatedPerson {
    std::string name;                     // as the file calls them, "3"
    std::vector<EstimatedPose> poses;     // each of another picture, in the clip's order
    std::optional<Betas> betas;           // of the program's own body: the mean over the poses
    ShapeSpace shape = ShapeSpace::Smpl;  // whose betas these are
};

struct Estimates {
    std::filesystem::path source;
    std::string program;    // "VIBE"
    bool measured = false;  // see EstimateFormat
    // What each of a pose's views takes the file to mean, the most likely one first: "boxes as they
    // are". One at least; its text is empty where there is only one way to read the file.
    std::vector<std::string> readings;
    std::vector<EstimatedPerson> people;  // one at least, each with a pose at least
    std::optional<double> fps;            // as the file says
};

// Of whatever program, told by content. InputErrors name the file and the field, what was expected
// and what was found; a file of no known program is one as well.
Estimates readEstimates(const std::filesystem::path& path);

// The same, and nothing for other content.
std::optional<Estimates> findEstimates(const std::filesystem::path& path);

// The pose in the space of a camera. clip: the one of a file that does not say its own, of the size
// of the pictures that the program saw. known: it is no guess, so that it counts more than what
// programs assume (Longest, Shortest, Diagonal): the body is seen where they see it, through this
// one. A body that is nowhere is put a few metres before it.
struct PlacedPose {
    Theta theta{};
    Trans trans{};
    Camera camera;
};
PlacedPose placePose(const EstimatedPose& pose, const EstimatedView& view, const Camera& clip,
                     bool known = false);

// ---- for the formats ----------------------------------------------------------------------------

// A file or folder, opened as far as its kind goes.
struct EstimateSource {
    std::filesystem::path path;
    bool folder = false;
    std::optional<PickleValue> pickle;  // also joblib's
    std::optional<Npz> npz;
    std::vector<uint8_t> bytes;  // of a PyTorch file
    std::unique_ptr<TorchFile> torch;
};

// One program's format. It registers itself, declared as a constant of the source file that reads
// it.
class EstimateFormat {
public:
    struct Declaration {
        const char* program;  // "VIBE"
        const char* looks;    // for the error that lists what is known: "VIBE's vibe_output.pkl"
        // By markers or several cameras, so that heads are better known than one picture tells.
        bool measured = false;
        // By content; no two formats recognise the same source.
        bool (*recognises)(const EstimateSource& source);
        // Fills people and readings.
        void (*read)(EstimateSource& source, Estimates& estimates);
    };
    explicit EstimateFormat(const Declaration& declaration);
};

}  // namespace doppel
