// A film as it was asked for: all that it shows, so that whoever asked may go on with something
// else.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/films/picture_sequence.h"
#include "trainer/data/capture.h"
#include "viewer/live/live_avatar.h"
#include "viewer/picture/backdrop.h"
#include "viewer/picture/ghosts.h"
#include "viewer/picture/scene.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// Of the panel.
struct FilmSettings {
    int size = 0;  // of the longer side, pixels; 0: as in the window
    // Frames of the timeline, both included; last < 0: to its end.
    int first = 0, last = -1;
    // Nothing behind the avatar, floor and ghosts neither: the kinds that keep alpha have it.
    bool clear = false;
    int samples = 2;  // per pixel and axis
    // The camera goes once round what it looks at; a pose held still takes so many seconds for it.
    bool turntable = false;
    int turnSeconds = 6;
    bool operator==(const FilmSettings&) const = default;
};

// Of a picture that is drawn as a film is.
struct PictureSettings {
    int size = 0;        // as a film's
    bool clear = false;  // likewise
    bool operator==(const PictureSettings&) const = default;
};

struct FilmFrame {
    Pose pose;
    ViewTransform view;
    Camera camera;  // of the film's size
    // From the pose's world; nothing where there is no floor.
    std::optional<RigidMotion> floor;
    std::vector<Ghost> ghosts;        // the first one furthest back
    std::vector<glm::dvec3> offsets;  // of FilmPlan::others, from the edited one's place
    std::optional<size_t> captured;   // the capture's frame behind it
};

// Of a row of avatars one who is not edited.
struct FilmOther {
    std::shared_ptr<const LoadedAvatar> avatar;
    Betas betas{};
    MeshKind mesh = MeshKind::Refined;
    std::vector<float> texels;
};

struct FilmPlan {
    std::filesystem::path out;
    std::unique_ptr<PictureSequence> pictures;  // null: one picture, which is written to `out`
    DeviceOptions device;                       // that draws it
    std::shared_ptr<const LoadedAvatar> avatar;
    Betas betas{};
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    bool painted = false;       // by the networks, for each frame
    std::vector<float> texels;  // else the texture, as Scene::setTexture() takes it
    ShadeOptions shade;
    int width = 0, height = 0, samples = 2;
    bool clear = false;
    std::array<float, 3> colour{};
    Image backdrop;                  // empty: none
    std::optional<Capture> capture;  // whose frames are seen
    FrameInFront front;              // how, or as Backdrop::Capture says
    double line = 1;                 // width of the floor's lines, pixels
    std::vector<FilmOther> others;
    std::vector<FilmFrame> frames;
};

}  // namespace doppel
