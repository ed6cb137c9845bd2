#include "trainer/train.h"

#include <algorithm>

#include "engine/io/image.h"
#include "trainer/networks.h"
#include "trainer/output_folder.h"
#include "trainer/rendering.h"

namespace doppel {

namespace {

// The avatar standing, from the front and from a side.
void writePreview(Device& device, const Avatar& avatar, const std::filesystem::path& path) {
    Shot rest = restShot(device, avatar, 384);
    AvatarRenderer renderer(device, avatar);
    Image preview(2 * 384, 384, 3, 255);
    for (int view = 0; view < 2; ++view) {
        Shot shot = turned(rest, view * 0.125);
        Drawing drawing = renderer.draw(shot.theta, shot.trans, shot.camera, 2);
        for (int y = 0; y < 384; ++y)
            for (int x = 0; x < 384; ++x) {
                size_t i = static_cast<size_t>(y * 384 + x);
                float rest1 = 1 - static_cast<float>(drawing.mask[i]) / 255.0f;
                for (size_t c = 0; c < 3; ++c)
                    preview.pixel(384 * view + x, y)[c] = static_cast<uint8_t>(
                        255 * std::clamp(drawing.rgb[3 * i + c] + rest1, 0.0f, 1.0f));
            }
    }
    writeImage(path, preview);
}

}  // namespace

TrainResult trainAvatar(Device& device, Avatar avatar, Capture capture,
                        const TrainSettings& settings) {
    capture.requireMasks();
    TrainResult result{std::move(avatar), std::move(capture), std::nullopt};
    bool keeps = settings.profileSteps == 0;
    if (keeps) createFolders(settings.out);
    auto wanted = [&](const char* stage) { return std::ranges::count(settings.stages, stage) > 0; };

    // A resumed run that got as far as its networks has its fitted poses on disk.
    std::filesystem::path fittedPoses = settings.out / "checkpoints" / "poses.npz";
    if (wanted("fit") && settings.resume && std::filesystem::exists(fittedPoses)) {
        Motion poses = readMotion(fittedPoses);
        if (poses.size() != result.capture.size())
            throwInput("{}: it has {} poses, the capture {} frames; train without --resume",
                       fittedPoses.string(), poses.size(), result.capture.size());
        result.capture.theta = poses.theta;
        result.capture.trans = poses.trans;
        result.capture.betas = poses.betas;
    } else if (wanted("fit")) {
        FitSettings fit;
        fit.preset = result.avatar.preset.fit;
        fit.seed = settings.seed;
        if (keeps) fit.logFolder = settings.out / "log";
        result.fit = fitCapture(device, result.avatar.body, result.capture, fit);
        if (keeps) {
            createFolders(fittedPoses.parent_path());
            writeNpz(fittedPoses,
                     posesArrays(result.capture.theta, result.capture.trans, result.capture.betas),
                     false);
        }
    }
    if (wanted("fit")) result.avatar.betas = result.capture.betas;
    result.capture.betas = result.avatar.betas;
    if (keeps) writeAvatar(settings.out, result.avatar);
    bool meshDone = settings.resume && !result.avatar.meshNet.empty() &&
                    !std::filesystem::exists(settings.out / "checkpoints" / "mesh.safetensors");
    if (wanted("mesh") && !meshDone) {
        trainMesh(device, result.avatar, result.capture, settings);
        if (keeps) writeAvatar(settings.out, result.avatar);
    }
    if (wanted("texture")) {
        trainTexture(device, result.avatar, result.capture, settings);
        if (keeps) writeAvatar(settings.out, result.avatar);
    }
    if (keeps && !result.avatar.texture.empty())
        writePreview(device, result.avatar, settings.out / "preview.png");
    return result;
}

}  // namespace doppel
