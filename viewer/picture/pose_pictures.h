// Small pictures of poses, to choose from.
#pragma once

#include <map>
#include <string>

#include "viewer/picture/scene.h"
#include "viewer/pose/skeleton.h"
#include "viewer/window/canvas.h"

namespace doppel {

// An avatar in each pose, seen from the front, all of it.
class PosePictures {
public:
    // What pictures are of, and how they look; with another all are forgotten.
    struct Kind {
        Betas betas{};
        int width = 0, height = 0;  // framebuffer pixels
        std::array<float, 3> behind{};
        ShadeOptions shade;
        bool operator==(const Kind&) const = default;
    };
    void use(const Kind& kind);

    // Of the pose under this name. Null: there is none yet, or it is of another pose.
    const CanvasImage* find(const std::string& name, const Pose& pose) const;
    // Leaves the scene in that pose.
    void draw(const std::string& name, const Pose& pose, Scene& scene);

private:
    Kind kind_;
    std::map<std::string, std::pair<Pose, CanvasImage>> pictures_;
};

}  // namespace doppel
