// BlazePose: a person found in a picture, 33 landmarks in the picture and in space, and a mask.
// Bazarevsky and others, BlazePose: On-device Real-time Body Pose Tracking (2020), with the
// networks of MediaPipe Pose, which scripts/setup --models fetches, on our own ops.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "engine/device.h"
#include "trainer/person/answer_log.h"
#include "trainer/person/roi.h"

namespace doppel {

// Numbers of the landmarks; left and right are the person's own.
namespace landmark {
enum Number : size_t {
    kNose = 0,
    kLeftEye = 2,
    kRightEye = 5,
    kLeftEar = 7,
    kRightEar,
    kMouthLeft,
    kMouthRight,
    kLeftShoulder,
    kRightShoulder,
    kLeftElbow,
    kRightElbow,
    kLeftWrist,
    kRightWrist,
    kLeftPinky,
    kRightPinky,
    kLeftIndex,
    kRightIndex,
    kLeftThumb,
    kRightThumb,
    kLeftHip,
    kRightHip,
    kLeftKnee,
    kRightKnee,
    kLeftAnkle,
    kRightAnkle,
    kLeftHeel,
    kRightHeel,
    kLeftFootTip,
    kRightFootTip,
    kCount,            // 33
    kCentre = kCount,  // mid-hip, and the point beyond the head: where to look next
    kScalePoint,
    kAll = 39,  // with four more that mean nothing
};
}  // namespace landmark

// The landmark on the person's other side; of the nose, itself. Of the first 33.
size_t oppositeLandmark(size_t number);

// What the detector says of one person.
struct Detection {
    double score = 0;              // [0.5, 1]
    std::array<Point2, 2> face{};  // pixels: corners of the face's box
    std::array<Point2, 4>
        keypoints{};  // pixels: mid-hip, beyond the head, mid-shoulder, upper body
    Roi roi() const { return roiOfBody(keypoints[0], keypoints[1]); }
};

struct Landmark {
    Point3 picture{};  // pixels; z: about the hips, towards the camera negative, on the same scale
    Point3 world{};    // metres (the scale is a guess): x right, y down, z away, from mid-hip
    double visibility = 0, presence = 0;  // [0, 1]: not hidden; within the picture
};

struct PersonLandmarks {
    Roi roi;              // where the network looked
    double presence = 0;  // [0, 1]: that there is a person
    std::array<Landmark, landmark::kAll> points{};
    // [256,256] logits of the person, in the square `roi`.
    std::vector<float> mask;
};

inline constexpr int kRoiMaskSide = 256;

enum class PoseNet : uint8_t { Lite, Full, Heavy };
// InputError for other names than lite, full and heavy; where: the flag.
PoseNet poseNetByName(std::string_view name, std::string_view where);
const char* poseNetName(PoseNet net);

// The folder of the networks: DOPPEL_MODELS, else build/models of the source or, for an installed
// program, `models` of the user's data folder or of share/doppel, whichever is there.
std::filesystem::path poseModelFolder();
// Whether this network and the detector are there.
bool poseModelsAreThere(PoseNet net, const std::filesystem::path& folder = poseModelFolder());

// A network is read, and its kernels compiled, when it is first needed.
class BlazePose {
public:
    BlazePose(Device& device, PoseNet net, std::filesystem::path folder = poseModelFolder());
    ~BlazePose();

    // InputError that says how to fetch the networks where they are missing.
    void requireModels() const;

    // What the networks find is kept there from now on, and taken from there where the same square
    // of a picture was looked at before. It has to outlive this.
    void remember(AnswerLog& log) { log_ = &log; }

    // People in the picture, the surest first; overlapping ones are merged.
    std::vector<Detection> detect(const Image& rgb);
    PersonLandmarks landmarks(const Image& rgb, const Roi& roi);
    // The mean of that and of what the network sees in the square's mirror image, turned back: what
    // it holds to be nearer on one side than on the other cancels. Twice the work.
    PersonLandmarks landmarksBothWays(const Image& rgb, const Roi& roi);

    PoseNet net() const { return net_; }

    // What the networks make of their own input [3,224,224] or [3,256,256], in [0, 1]: the
    // detector's boxes [2254,12] and scores [2254]; landmarks [39,5], presence [1], mask
    // [256,256], heat maps [39,64,64] and world landmarks [39,3], logits as they are.
    std::array<std::vector<float>, 2> runDetector(std::vector<float> rgb);
    std::array<std::vector<float>, 5> runLandmarks(const std::vector<float>& rgb);

private:
    struct Net;
    Net& detector();
    Net& landmarker();
    // Of a square [3,256,256] of the picture.
    PersonLandmarks ask(std::vector<float> square, const Roi& roi, bool bothWays);
    PersonLandmarks askOnce(const Image& rgb, const Roi& roi, bool bothWays);

    Device& device_;
    PoseNet net_;
    std::filesystem::path folder_;
    std::unique_ptr<Net> detector_, landmarker_;
    AnswerLog* log_ = nullptr;
};

// ---- for tests ----------------------------------------------------------------------------------

// The people among the detector's boxes [2254,12] and score logits [2254], in pixels of a picture
// of this size.
std::vector<Detection> detections(const std::vector<float>& boxes, const std::vector<float>& scores,
                                  int width, int height);

// From what runLandmarks() gives.
PersonLandmarks landmarksOf(std::array<std::vector<float>, 5> raw, const Roi& roi);

// Of the person whose mirror image, about the square's upright axis, has these landmarks.
PersonLandmarks mirrored(const PersonLandmarks& person);

}  // namespace doppel
