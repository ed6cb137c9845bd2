// Doppel's own captures, so that frames can be picked and masks keyed.
#include "trainer/data/frame_selection.h"
#include "trainer/import/importer.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

const Importer kOwnCapture{{
    .name = "capture",
    .looks = "images/, cameras.npz and poses.npz (a capture)",
    .recognises =
        [](const fs::path& folder) {
            std::error_code error;
            return fs::is_directory(folder / "images", error) &&
                   !fs::is_directory(folder / "smpl_pose", error) &&
                   fs::exists(folder / "cameras.npz", error) &&
                   fs::exists(folder / "poses.npz", error);
        },
    .read =
        [](const ImportRequest& request) {
            const Capture all = readCapture(request.source);
            return all.subset(selectFrames(request.frames, all.size()));
        },
}};

}  // namespace

}  // namespace doppel
