#include "trainer/commands/render.h"

#include <algorithm>
#include <charconv>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "engine/files/npz.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/films/footage.h"
#include "trainer/avatar/films/picture_sequence.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/command.h"
#include "trainer/data/capture_notes.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/motion/smooth.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

// The same view with `size` pixels on the longer side.
Camera scaled(Camera camera, int size) {
    if (size == 0) return camera;
    double scale = static_cast<double>(size) / std::max(camera.width, camera.height);
    camera.width = std::max(1, static_cast<int>(camera.width * scale + 0.5));
    camera.height = std::max(1, static_cast<int>(camera.height * scale + 0.5));
    camera.fx *= scale, camera.fy *= scale, camera.cx *= scale, camera.cy *= scale;
    return camera;
}

bool isColour(const std::string& text) {
    return text.size() == 7 && text[0] == '#' &&
           text.find_first_not_of("0123456789abcdefABCDEF", 1) == std::string::npos;
}

// The file or folder that --background names; empty where it is a word or a colour.
std::filesystem::path backgroundFile(const RenderOptions& options) {
    const std::string& text = options.background;
    return text == "capture" || text == "none" || isColour(text) ? "" : text;
}

// What is behind the avatar, however it was asked for, and what it takes to know it.
class Behind {
public:
    // chosen: the motion's frames that the shots show; times: in seconds, of each shot in footage.
    Behind(const RenderOptions& options, const std::vector<Shot>& shots,
           const std::vector<size_t>& chosen, const std::vector<double>& times);

    // Null: nothing is.
    std::function<std::vector<float>(size_t)> picture;
    std::optional<Footage> footage;

private:
    std::optional<Capture> capture_;
    std::unique_ptr<FrameCache> frames_;
    std::unique_ptr<BackgroundPlate> plate_;
};

// Pictures of footage by the number of the shot; says what is done to it.
std::function<std::vector<float>(size_t)> shown(Footage& footage, const std::vector<Shot>& shots,
                                                const std::vector<size_t>& chosen,
                                                const std::vector<double>& times) {
    const Camera& first = shots[0].camera;
    if (const std::string note = footage.note(times.back(), first.width, first.height);
        !note.empty())
        fmt::print(stderr, "{}\n", note);
    return [&](size_t i) {
        return footage.at(times[i], chosen[i], shots[i].camera.width, shots[i].camera.height);
    };
}

Behind::Behind(const RenderOptions& options, const std::vector<Shot>& shots,
               const std::vector<size_t>& chosen, const std::vector<double>& times) {
    if (options.background == "none") return;
    if (const std::filesystem::path file = backgroundFile(options); !file.empty()) {
        footage.emplace(file, 3);
        picture = shown(*footage, shots, chosen, times);
        return;
    }
    std::string colour = options.background;
    if (colour == "capture") {
        colour = "#7f7f7f";
        const bool ownCameras = options.camera == "capture" && options.size == 0;
        if (ownCameras && std::filesystem::is_directory(options.motion / "images"))
            capture_ = readCapture(options.motion);
        if (capture_ && !capture_->hasMasks()) {
            fmt::print(stderr,
                       "{}: it has no masks, which tell what is behind the person; the background "
                       "is grey (--background takes another colour)\n",
                       options.motion.string());
            capture_.reset();
        }
    }
    if (!capture_) {
        picture = [&shots, colour](size_t i) { return plainBackground(colour, shots[i].camera); };
        return;
    }
    // The plate is of all frames: more of them show what is behind the person.
    frames_ = std::make_unique<FrameCache>(*capture_);
    plate_ = std::make_unique<BackgroundPlate>(*capture_, *frames_);
    picture = [this, &chosen](size_t i) { return plate_->behind(*frames_->load(chosen[i])); };
}

// The grounds that the shots stand on. A motion's is that of the whole, so that a part of it stands
// where the whole does.
std::vector<Ground> groundsFor(Device& device, const Avatar& avatar, const std::vector<Shot>& shots,
                               const Motion& whole, const std::vector<size_t>& chosen,
                               const RenderOptions& options) {
    BodyPoser poser(device, avatar.body);
    if (options.camera == "turntable") {
        std::vector<Theta> theta;
        std::vector<Trans> trans;
        for (const Shot& shot : shots) theta.push_back(shot.theta), trans.push_back(shot.trans);
        return groundsOf(poser, theta, trans, avatar.betas);
    }
    const std::vector<Ground> all = groundsOf(poser, whole.theta, whole.trans, avatar.betas);
    std::vector<Ground> grounds;
    for (size_t frame : chosen) grounds.push_back(all[frame]);
    return grounds;
}

// ---- sound --------------------------------------------------------------------------------------

// The second of the clip that a capture was made of at which one of its frames was seen: as the
// import noted, or else by the number in the frame's name.
double timeInClip(const Capture& capture, size_t frame, const std::filesystem::path& clip) {
    const std::string& name = capture.frames.at(frame).name;
    int64_t number = 0;
    std::from_chars(name.data(), name.data() + name.size(), number);
    const std::filesystem::path notes = capture.folder / "landmarks.npz";
    std::error_code ignored;
    if (std::filesystem::exists(notes, ignored)) {
        const Npz npz = readNpz(notes);
        if (npz.has("number") && npz.has("time")) {
            const std::vector<double> numbers = npz.at("number").toF64(),
                                      times = npz.at("time").toF64();
            for (size_t i = 0; i < std::min(numbers.size(), times.size()); ++i)
                if (numbers[i] == double(number) && times[i] >= 0) return times[i];
        }
    }
    const double rate = VideoReader(clip).framesPerSecond();
    return rate > 0 ? std::max(double(number), 0.) / rate : 0;
}

// The sound that goes with a film: of the film behind, or else of the clip that the motion was
// seen in, or of a file. begin: the second of footage at which the film begins. keptSpeed: the
// motion goes as fast as it went in its clip.
std::optional<SoundSource> soundOf(const RenderOptions& options, const Behind& behind,
                                   const std::vector<size_t>& chosen, double begin,
                                   bool keptSpeed) {
    if (options.audio == "none") return {};
    if (options.audio != "source") return SoundSource{options.audio, begin};
    const VideoKind* kind = videoKindOf(options.out);
    if (kind == nullptr || !kind->keepsSound()) return {};
    if (behind.footage && behind.footage->isFilm() && hasSound(behind.footage->path()))
        return SoundSource{behind.footage->path(), begin};
    if (!std::filesystem::is_directory(options.motion / "images")) return {};
    const std::filesystem::path clip = clipOf(options.motion);
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(clip, ignored) || !hasSound(clip)) return {};
    if (!keptSpeed) {
        fmt::print(stderr, "{}: its sound is left out, since --fps changes the motion's speed\n",
                   clip.string());
        return {};
    }
    fmt::print(stderr, "{}: its sound goes with the film; --audio none leaves it out\n",
               clip.string());
    return SoundSource{clip, timeInClip(readCapture(options.motion), chosen[0], clip)};
}

}  // namespace

void runRender(const RenderOptions& options) {
    catchInterrupts();
    std::vector<std::filesystem::path> inputs = originsOf(options.motion);
    inputs.insert(inputs.end(), {options.avatar, options.camera, backgroundFile(options),
                                 options.occluder, options.audio, options.retarget.contacts});
    // A film may lie beside pictures, unless it would be taken for one of them.
    const bool beside = isFilm(options.out) && !isPictureName(options.out);
    (beside ? requireFileApart : requireApart)(options.out, inputs);
    Avatar avatar = readAvatar(options.avatar);
    TextureKind texture = textureKind(options.texture);
    requireTexture(avatar, texture, options.avatar);
    if (options.light == "none") avatar.light.clear();
    Motion motion = readMotion(options.motion);
    if (const std::string taken = takenAs(motion); !taken.empty())
        fmt::print(stderr, "{}: {}\n", options.motion.string(), taken);
    std::vector<size_t> chosen = selectFrames(options.frames, motion.size());
    const double rate = motion.fps;
    // Smoothed and retargeted whole, so that a part of a motion moves as it does in the whole.
    const Retargeted retargeted =
        performed(avatar, options.avatar, std::move(motion), options.retarget, options.smooth);
    if (!retargeted.summary.empty())
        fmt::print(stderr, "{}: {}\n", options.motion.string(), retargeted.summary);
    Motion whole = retargeted.motion;
    if (options.camera != "capture" && options.camera != "turntable")
        whole = throughCameras(std::move(whole), options.camera);
    motion = whole.subset(chosen);
    Device device(options.common.deviceOptions());

    std::vector<Shot> shots;
    if (options.camera == "turntable") {
        // The motion goes on, on the spot, while the camera goes round.
        Shot shot = restShot(device, avatar, options.size > 0 ? options.size : 512);
        motion = inCameraSpace(std::move(motion));
        for (size_t i = 0; i < motion.size(); ++i) {
            shot.theta = motion.theta[i];
            shots.push_back(
                turned(shot, static_cast<double>(i) / static_cast<double>(motion.size())));
        }
    } else {
        shots = throughOwnCameras(motion);
    }
    for (Shot& shot : shots) shot.camera = scaled(shot.camera, options.size);

    const double fps = options.fps > 0 ? options.fps : motion.fps > 0 ? motion.fps : 25;
    // Films beside the motion begin with it and go as fast as it does, and --frames are frames of
    // both.
    std::vector<double> times;
    const double step = (motion.fps > 0 ? motion.fps / fps : 1) / (rate > 0 ? rate : 25);
    for (size_t frame : chosen) times.push_back(double(frame) * step);

    Behind behind(options, shots, chosen, times);
    Layers layers{.background = behind.picture,
                  .matchColours = options.matchColours,
                  .samples = options.samples};
    if (options.shadow) layers.grounds = groundsFor(device, avatar, shots, whole, chosen, options);
    std::optional<Footage> occluder;
    if (!options.occluder.empty()) {
        occluder.emplace(options.occluder, 1);
        layers.occluder = shown(*occluder, shots, chosen, times);
    }
    const std::optional<SoundSource> sound =
        soundOf(options, behind, chosen, times[0], std::abs(fps / motion.fps - 1) < .01);
    const double change =
        renderShots(device, avatar, shots, layers, options.out, fps, "render", texture, sound);
    if (options.common.json) {
        nlohmann::ordered_json json{
            {"frames", shots.size()}, {"out", options.out.string()}, {"mean_change", change}};
        if (retargeted.changed) json["retarget"] = retargetJson(retargeted);
        printJson(json);
    } else {
        fmt::print("{} frames in {}; consecutive pictures differ by {:.2f} (8-bit units)\n",
                   shots.size(), options.out.string(), change);
    }
}

namespace {

void declareFlags(CommandFlags& flags, RenderOptions& o) {
    flags.precision();
    flags.path("AVATAR", o.avatar, "Avatar's folder")->required();
    flags
        .path("--motion", o.motion,
              "A capture, a poses.npz, BVH, FBX, glTF, USD, JSON, AMASS or an estimator's poses "
              "(docs/formats.md)")
        ->required();
    flags
        .path("--out", o.out,
              "FILE.mp4, .webm, .mov (ProRes 4444), .webp or .gif, or a folder for PNG pictures")
        ->required();
    flags->add_option("--camera", o.camera, "capture, turntable, or a cameras.npz")
        ->capture_default_str();
    flags
        ->add_option(
            "--background", o.background,
            "capture, none (transparent), a colour as \"#rrggbb\", or a picture, a film or a "
            "folder of pictures, scaled to cover; a film that ends is held")
        ->capture_default_str();
    flags.path("--occluder", o.occluder,
               "What is in front of the avatar, white: a mask, a film or a folder of masks");
    flags->add_flag("--shadow", o.shadow, "A soft shadow on the ground under the body");
    flags->add_flag("--match-colours", o.matchColours,
                    "Bring the avatar's colours towards those behind it, by a little");
    flags
        ->add_option("--audio", o.audio,
                     "Sound of .mp4, .webm and .mov: source (of the film behind, or of the "
                     "motion's clip), none, or a file")
        ->capture_default_str();
    flags.texture(o.texture);
    flags
        ->add_option("--light", o.light,
                     "capture: as the person looks before the camera that recorded her, where "
                     "training learned that light; none: the texture's own colours")
        ->check(CLI::IsMember({"capture", "none"}))
        ->capture_default_str();
    flags
        ->add_option("--smooth", o.smooth,
                     "Smooth the motion: standard deviation in frames of a Gaussian over time, on "
                     "rotations and positions; 0: none")
        ->capture_default_str()
        ->check(CLI::Range(0., 100.));
    flags.retarget(o.retarget);
    flags->add_option("--size", o.size, "Pixels of the picture's longer side; 0: the camera's")
        ->capture_default_str()
        ->check(CLI::Range(0, 8192));
    flags
        ->add_option(
            "--samples", o.samples,
            "Samples per pixel, across and down: more for somebody far away, whose stripes "
            "would shimmer")
        ->capture_default_str()
        ->check(CLI::Range(1, 8));
    flags->add_option("--fps", o.fps, "Frames per second of the film; 0: the motion's")
        ->capture_default_str()
        ->check(CLI::Range(0., 1000.));
    flags.frames(o.frames, "Frames of the motion to draw");
}

void checkFiles(RenderOptions& options) {
    std::error_code ignored;
    const std::filesystem::path file = backgroundFile(options);
    if (!file.empty() && !std::filesystem::exists(file, ignored))
        throwInput(
            "--background: expected capture, none, a colour as #rrggbb, or a picture, a film or a "
            "folder of pictures that is there, found \"{}\"",
            options.background);
    if (!options.occluder.empty() && !std::filesystem::exists(options.occluder, ignored))
        throwInput(
            "--occluder: expected a mask, a film or a folder of masks that is there, found \"{}\"",
            options.occluder.string());
    if (options.matchColours && options.background == "none")
        throwInput("--match-colours: expected something behind to match, found --background none");
    if (options.audio != "source" && options.audio != "none" &&
        !std::filesystem::exists(options.audio, ignored))
        throwInput(
            "--audio: expected source, none, or a file with sound that is there, found \"{}\"",
            options.audio);
}

const Command<RenderOptions> kRender{{
    .name = "render",
    .place = 50,
    .summary = "Put the avatar into the poses of a motion and draw it",
    .example = "doppel render avatar --motion box --camera turntable --background \"#ffffff\" "
               "--out dance.mp4",
    .flags = declareFlags,
    .check = checkFiles,
    .run = runRender,
}};

}  // namespace

}  // namespace doppel
