// The whole job on a person who comes with the program: capture, fit, train, render, export, eval.
#include "trainer/commands/demo.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <future>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numeric>

#include "engine/files/atomic_file.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/rendering.h"
#include "trainer/avatar/sheet.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/command.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/hand_held.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/surface.h"
#include "trainer/stages/train.h"

namespace doppel {

namespace {

constexpr int kTurnFrames = 24, kMotionFrames = 8, kFilmSize = 384;
constexpr int kFilmFrames = 72, kFramesPerSecond = 24;

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// Per row: frame, silhouette before and after, render, error.
void writeContactSheet(Device& device, const Avatar& avatar, const Capture& asGiven,
                       const Capture& fitted, const std::filesystem::path& path) {
    FrameCache frames(fitted);
    BackgroundPlate plate(fitted, frames);
    BodyPoser poser(device, avatar.body);
    MeshDrawer drawer(device, avatar.body);
    AvatarRenderer renderer(device, avatar);
    std::vector<std::vector<Image>> rows;
    size_t step = std::max<size_t>(1, fitted.size() / 6);
    for (size_t i = 0; i < fitted.size(); i += step) {
        const Camera& camera = fitted.frames[i].camera;
        int w = camera.width, h = camera.height;
        auto picture = frames.load(i);
        std::vector<float> frame(picture->rgb.begin(), picture->rgb.end());
        for (float& value : frame) value /= 255.0f;
        PosedMesh before = poser.pose(asGiven.theta[i], asGiven.trans[i], asGiven.betas);
        Drawing after = renderer.draw(fitted.theta[i], fitted.trans[i], camera, 2);
        std::vector<float> render = composite(after.rgb, after.mask, plate.behind(*picture));
        rows.push_back({toImage(frame, w, h),
                        compareMasks(picture->mask, drawer.mask(before.verts, camera), w, h),
                        compareMasks(picture->mask, after.mask, w, h), toImage(render, w, h),
                        differenceImage(frame, render, w, h, 4)});
    }
    writeImage(path, contactSheet(rows));
}

// The avatar turning and greeting, and as glTF.
void writeFilms(Device& device, const Avatar& person, const std::filesystem::path& out) {
    Shot rest = restShot(device, person, kFilmSize);
    std::vector<Shot> turn, dance;
    for (int i = 0; i < kFilmFrames; ++i) turn.push_back(turned(rest, i / double(kFilmFrames)));
    Motion greetings;
    greetings.name = "greeting";
    greetings.fps = kFramesPerSecond;
    Trans stage = rest.trans;
    stage[1] *= 0.8f;  // further away, with room for raised hands
    stage[2] *= 1.25f;
    for (const MotionFrame& frame : greeting(kFilmFrames, stage[2])) {
        dance.push_back({frame.theta, stage, rest.camera});
        greetings.theta.push_back(frame.theta);
        greetings.trans.push_back(stage);
    }
    auto grey = [&](size_t) { return plainBackground("#9aa4ad", rest.camera); };
    renderShots(device, person, turn, {grey}, out / "turntable.mp4", kFramesPerSecond, "");
    renderShots(device, person, dance, {grey}, out / "reenact.mp4", kFramesPerSecond, "");
    exportAvatar(device, person, out / "avatar.glb", &greetings);
}

// Who comes with the program, or is in a file.
Actor actorOf(const DemoOptions& options) {
    const std::filesystem::path folder = assetFolder() / "actor", file = options.actor;
    if (std::ranges::count(actorNames(folder), options.actor) > 0)
        return readActor(folder, options.actor);
    if (file.extension() != ".npz")
        throwInput("--actor: expected an actor's name, or the .npz of one, found {}",
                   options.actor);
    return readActor(file.parent_path(), file.stem().string());
}

// The actor, turning and then moving, in out/capture.
Capture recordActor(Device& device, const Actor& actor, const DemoOptions& options) {
    SyntheticOptions synthetic;
    if (options.lamp) synthetic.light = studioLamp();
    synthetic.size = options.size;
    synthetic.seed = options.common.seed;
    return renderActor(device, actor, actorSession(kTurnFrames, kMotionFrames, kActorDistance),
                       options.out / "capture", synthetic);
}

void recordDemo(const Actor& actor, const DemoOptions& options) {
    catchInterrupts();
    claimFiles(options.out, "demo", {"capture"});
    const FolderLock lock(options.out);
    Device device(options.common.deviceOptions());
    const Capture capture = recordActor(device, actor, options);
    const std::string folder = (options.out / "capture").string();
    if (options.common.json)
        printJson(nlohmann::ordered_json{{"capture", folder}, {"frames", capture.size()}});
    else
        fmt::print("{}: {} frames of {}\n", folder, capture.size(), options.actor);
}

void filmDemo(const Actor& actor, const DemoOptions& options) {
    catchInterrupts();
    claimFiles(options.out, "demo", {"clip.mp4", "truth"});
    const FolderLock lock(options.out);
    Device device(options.common.deviceOptions());
    HandHeldOptions film;
    film.seed = options.common.seed;
    film.still = options.still;
    const int frames = std::max(1, static_cast<int>(std::lround(options.clip * film.fps)));
    const Performer performer{&actor, oneTake(frames, kTakeDistance)};
    filmHandHeld(device, {&performer, 1}, options.out / "clip.mp4", options.out / "truth", film);
    if (options.common.json) {
        printJson(nlohmann::ordered_json{{"clip", (options.out / "clip.mp4").string()},
                                         {"truth", (options.out / "truth").string()},
                                         {"frames", frames},
                                         {"longer_side_degrees", film.longerSideDegrees}});
        return;
    }
    fmt::print(
        "in {}: clip.mp4, {} frames of {}, {}×{}, {:.0f} degrees along the longer side; "
        "truth/\n",
        options.out.string(), frames, options.actor, film.width, film.height,
        film.longerSideDegrees);
}

}  // namespace

void runDemo(const DemoOptions& options) {
    const Actor actor = actorOf(options);  // before anything is written
    if (options.record || options.clip > 0) {
        options.record ? recordDemo(actor, options) : filmDemo(actor, options);
        return;
    }
    auto start = std::chrono::steady_clock::now();
    auto seconds = [&] {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    };
    std::filesystem::path out = options.out;
    catchInterrupts();
    claimFiles(out, "demo",
               {"capture", "avatar", "held-out", "avatar.glb", "turntable.mp4", "reenact.mp4",
                "contact.png", "metrics.json"});
    const FolderLock lock(out);
    Device device(options.common.deviceOptions());
    fmt::print(stderr, "demo on {}\n", device.info().name);

    // A recording of the actor, every fourth frame held out.
    const Capture capture = recordActor(device, actor, options);
    std::vector<size_t> seen, heldOut;
    for (size_t i = 0; i < capture.size(); ++i) (i % 4 == 3 ? heldOut : seen).push_back(i);
    double captureSeconds = seconds();

    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = options.preset;
    avatar.provenance["capture"] = capture.name;
    avatar.provenance["capture_folder"] = captureFolder(out / "avatar", capture.folder);
    avatar.provenance["command"] = options.common.commandLine;
    avatar.provenance["seed"] = fmt::format("{}", options.common.seed);
    TrainSettings settings;
    settings.out = out / "avatar";
    settings.seed = options.common.seed;
    settings.stages = stagesOf(options.preset, stageNames());
    settings.pictureSeconds = 0;
    TrainResult trained = trainAvatar(device, std::move(avatar), capture.subset(seen), settings);
    const Avatar& person = trained.avatar;
    double trainSeconds = seconds() - captureSeconds;

    // Films meanwhile, by another device: neither they nor fits keep all of a CPU busy.
    std::future<void> films = std::async(std::launch::async, [&] {
        Device another(options.common.deviceOptions());
        writeFilms(another, person, out);
    });

    // Held-out frames: as their tracker saw them, fitted with the shape that training found, and
    // with the refined mesh.
    Capture test = capture.subset(heldOut), testFitted = test;
    FitResult testFit = fitPosesToMasks(device, person, testFitted, options.common.seed);
    Capture testByPictures = testFitted;
    fitPosesToPictures(device, person, testByPictures, options.common.seed);
    FrameCache testFrames(test);
    double iouGiven = mean(silhouetteIous(device, person.body, {&test}, testFrames)[0]);
    std::vector<FrameMetrics> metrics =
        evaluateAvatar(device, person, testFitted, out / "held-out");
    FrameMetrics byPictures = meanMetrics(evaluateAvatar(device, person, testByPictures));
    Capture unfitted = test;
    unfitted.betas = person.betas;
    FrameMetrics result = meanMetrics(metrics),
                 unfittedResult = meanMetrics(evaluateAvatar(device, person, unfitted));

    writeContactSheet(device, person, test, testFitted, out / "contact.png");
    {
        Progress waiting("films", 1, kQuiet);
        films.get();
        waiting.update(1);
    }

    std::vector<std::pair<std::string, std::optional<double>>> more{
        {"pictures_iou", byPictures.iou}, {"pictures_psnr_body", byPictures.psnrBody}};
    for (const auto& [name, value] : byPictures.figures)
        more.emplace_back("pictures_" + name, value);
    std::string json =
        metricsJson(metrics,
                    {{"capture", "synthetic actor, held-out frames"},
                     {"preset", person.preset.name},
                     {"seed", fmt::format("{}", options.common.seed)},
                     {"fit_test_poses", "true"},
                     {"iou_as_given", fmt::format("{:.4f}", iouGiven)},
                     {"iou_after_fit", fmt::format("{:.4f}", testFit.iouAfter)},
                     {"iou_after_mesh", fmt::format("{:.4f}", result.iou)},
                     {"iou_without_test_fit", fmt::format("{:.4f}", unfittedResult.iou)},
                     {"psnr_body_without_test_fit", fmt::format("{:.3f}", unfittedResult.psnrBody)},
                     {"seconds", fmt::format("{:.1f}", seconds())},
                     {"device", device.info().name}},
                    true, more);
    AtomicFile file(out / "metrics.json");
    file.write(json + "\n");
    file.commit();
    if (options.common.json) {
        std::cout << json << "\n";
        return;
    }
    fmt::print("{} frames seen, {} held out; {:.0f} s in all, {:.0f} s of them training\n",
               seen.size(), heldOut.size(), seconds(), trainSeconds);
    fmt::print("held-out frames            IoU\n");
    fmt::print("  poses as given          {:.3f}\n", iouGiven);
    fmt::print("  after fit               {:.3f}\n", testFit.iouAfter);
    fmt::print("  after mesh refinement   {:.3f}\n", result.iou);
    fmt::print("  PSNR of the body        {:.2f} dB, SSIM of the frame {:.3f}\n", result.psnrBody,
               result.ssimFrame);
    fmt::print("  {:<24}{:>10} {:>12}\n", "poses fitted to", "masks", "pictures");
    auto row = [](std::string_view name, double a, double b) {
        fmt::print("  {:<24}{:>10.3f} {:>12.3f}\n", name, a, b);
    };
    row("iou", result.iou, byPictures.iou);
    row("psnr_body", result.psnrBody, byPictures.psnrBody);
    for (size_t i = 0; i < result.figures.size(); ++i)
        row(result.figures[i].first, result.figures[i].second, byPictures.figures.at(i).second);
    fmt::print(
        "in {}: avatar/, avatar.glb, turntable.mp4, reenact.mp4, contact.png, "
        "held-out/report.html, metrics.json\n",
        out.string());
}

namespace {

void declareFlags(CommandFlags& flags, DemoOptions& o) {
    flags.precision();
    flags.path("--out", o.out, "Folder to write")->capture_default_str();
    flags
        ->add_option("--actor", o.actor,
                     "Who is recorded; or an actor's .npz, with its .png beside it (assets/README)")
        ->check(CLI::IsMember(actorNames(assetFolder() / "actor")) | CLI::ExistingFile)
        ->capture_default_str();
    flags->add_option("--size", o.size, "Of the recording's frames, pixels")
        ->check(CLI::Range(64, 2048))
        ->capture_default_str();
    CLI::Option* record =
        flags->add_flag("--record", o.record, "Write the recording into capture/, and stop there");
    flags
        ->add_option("--clip", o.clip,
                     "Film the actor for so many seconds with a camera in a hand, into clip.mp4, "
                     "with poses and masks in truth/, and stop there")
        ->type_name("SECONDS")
        ->check(CLI::Range(.05, 600.))
        ->excludes(record);
    flags->add_flag("--lamp", o.lamp,
                    "A lamp on the left lights the actor, and not all sides alike (not of --clip)");
    flags->add_flag("--still-camera", o.still, "Of --clip: the camera stands still");
    flags.preset("ci");
}

const Command<DemoOptions> kDemo{{
    .name = "demo",
    .place = 100,
    .summary = "The whole job on the synthetic actor that comes with Doppel",
    .example = "doppel demo --out out/demo",
    .flags = declareFlags,
    .run = runDemo,
}};

}  // namespace

}  // namespace doppel
