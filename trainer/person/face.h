// Which way a face looks: MediaPipe's Face Mesh (Kartynnik and others, Real-time Facial Surface
// Geometry from Monocular Video on Mobile GPUs, 2019), which scripts/setup --models fetches.
#pragma once

#include <array>
#include <filesystem>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "engine/device.h"
#include "engine/io/image.h"
#include "trainer/data/capture.h"
#include "trainer/person/blazepose.h"

namespace doppel {

struct FaceMesh {
    static constexpr size_t kPoints = kFacePoints;
    double presence = 0;  // [0, 1]: that the square shows a face
    Roi roi;              // where the network looked
    // pixels across and down; z away from the camera on the same scale, about the face's middle.
    std::array<Point3, kPoints> points{};

    // Columns: towards the face's left, up to the forehead, and where it looks, in axes across,
    // down and away from the camera, as if it were in the picture's middle. Orthonormal; nothing
    // where the points span no face.
    std::optional<glm::dmat3> axes() const;

    SeenFace seen() const;  // its points with its presence as their confidence
};

class FaceFinder {
public:
    FaceFinder(Device& device, std::filesystem::path folder = poseModelFolder());
    ~FaceFinder();

    // Whether the network is in the folder.
    static bool isThere(const std::filesystem::path& folder = poseModelFolder());

    // See BlazePose.
    void remember(AnswerLog& log) { log_ = &log; }

    // The face of this person; nothing where it is turned away, hidden or too small to tell.
    std::optional<FaceMesh> operator()(const Image& rgb, const PersonLandmarks& person);

private:
    FaceMesh look(const Image& rgb, const Roi& roi);

    Device& device_;
    std::filesystem::path folder_;
    std::unique_ptr<class PictureNet> net_;
    AnswerLog* log_ = nullptr;
};

// ---- for tests ----------------------------------------------------------------------------------

// From the network's outputs, points [468,3] in pixels of its input and a logit [1].
FaceMesh faceOf(const std::vector<float>& points, float presence, const Roi& roi);

}  // namespace doppel
