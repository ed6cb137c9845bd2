// The viewer: an avatar in a window, its joints to be dragged and its camera to be turned.
#pragma once

#include <chrono>
#include <filesystem>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/io/image.h"
#include "trainer/data/frame_cache.h"
#include "trainer/motion/motion.h"
#include "viewer/ik.h"
#include "viewer/live_avatar.h"
#include "viewer/orbit_camera.h"
#include "viewer/painter.h"
#include "viewer/pose_editor.h"
#include "viewer/scene.h"
#include "viewer/window.h"

namespace doppel {

// What a viewer begins with.
struct ViewerOptions {
    DeviceOptions device;  // that computes the pictures
    std::filesystem::path avatar;
    std::filesystem::path motion;    // a capture, poses.npz or .bvh; may be empty
    std::filesystem::path pose;      // a pose's JSON to begin with; may be empty
    std::string frames;              // of the motion: selectFrames; empty: all
    int width = 1280, height = 800;  // of the window
};

// What is compared side by side: to the left what is named first.
enum class Split { None, Meshes, Textures };  // body and refined; coarse and refined

enum class Backdrop { Colour, Picture, Capture };

// What the panel sets.
struct ViewSettings {
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    uint32_t paint = kPaintTexture;
    bool wireframe = false, atlas = false;
    bool lit = false;
    double lightYaw = -0.6, lightPitch = 0.6, ambient = 0.35;  // radians, as seen from the camera
    Split split = Split::None;
    Backdrop backdrop = Backdrop::Colour;
    std::array<float, 3> colour{0.20f, 0.22f, 0.25f};
    bool captureCamera = false;
    bool joints = true, limits = true;
    bool panel = true, help = false;
    bool figures = true;  // of speed, in the corner
    bool operator==(const ViewSettings&) const = default;
};

// A part of the window that shows the avatar; framebuffer pixels.
struct Pane {
    int x = 0, y = 0, width = 0, height = 0;
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    bool operator==(const Pane&) const = default;
};

class Viewer {
public:
    // Window coordinates; the rest shows the avatar.
    static constexpr int kPanelWidth = 330, kTimelineHeight = 74;

    // InputError for what the options name and is not there or not right; MachineError where no
    // window can be opened.
    explicit Viewer(const ViewerOptions& options);
    ~Viewer();

    // One turn: events in, picture out; waits for events where there is nothing to do. False once
    // the window is closed. Mistakes of the user, and files that cannot be written, are said in the
    // window; a device that fails is a MachineError.
    bool frame();
    // Until the window is closed. Where the machine fails the pose is saved, and the message says
    // where. each: called before every turn.
    void run(const std::function<void()>& each = {});

    const Window& window() const { return window_; }
    Window& window() { return window_; }
    ViewSettings& settings() { return settings_; }
    OrbitCamera& camera() { return orbit_; }
    PoseEditor& editor() { return *editor_; }
    const std::vector<Pane>& panes() const { return panes_; }
    // Of the last picture, and where a joint is on it: window coordinates, depth in metres.
    glm::dvec3 jointOnScreen(size_t joint) const;
    PosedSkeleton posed() const;
    // Of the shape that is set.
    const Skeleton& skeleton() const;
    std::optional<size_t> selected() const { return selected_; }
    // Nothing is being computed, and the picture shows what is set, as fine as it becomes.
    bool settled() const;
    const std::string& message() const { return message_; }
    // Pictures of something else than the one before.
    uint64_t pictureCount() const { return pictures_; }
    // How many refinements the picture is the mean of, of kRefinements; 0: drawn while it moved.
    int refinements() const { return refinements_; }
    // What has computed pictures so far; for tests.
    const Device& device() const { return device_; }
    int64_t frameCount() const;  // of the timeline
    double timeline() const { return timeline_; }
    // Milliseconds of the latest picture's stages.
    struct Times {
        double pose = 0, draw = 0, show = 0, paint = 0, fps = 0;
    };
    const Times& times() const { return times_; }

    // What the panel's buttons do; InputError where it cannot be done.
    void savePoses(const std::filesystem::path& path);
    void loadMotion(const std::filesystem::path& path, const std::string& frames = {});
    void loadPicture(const std::filesystem::path& path);
    void startFilm(const std::filesystem::path& out, int size);
    void startExport(const std::filesystem::path& out);
    void cancelFilm();
    float filmProgress() const;
    void saveScreenshot(const std::filesystem::path& path);
    bool working() const { return film_ != nullptr || export_ != nullptr; }

private:
    enum class Drag { None, Orbit, Pan, Dolly, Joint, Ring };
    using Clock = std::chrono::steady_clock;

    // What pictures show.
    struct Shown {
        Pose pose;
        Betas betas{};
        ViewSettings settings;
        glm::dmat3 rotation{0};
        glm::dvec3 translation{};
        Camera camera{};
        std::vector<Pane> panes;
        uint64_t textures = 0, backdrop = 0;
        bool operator==(const Shown&) const = default;
    };

    // viewer.cpp
    void useAvatar(std::shared_ptr<LoadedAvatar> avatar);
    void reloadIfChanged();
    void advanceTimeline();
    void showTime();
    bool messageVisible() const;
    TextureKind bestTexture() const;
    bool paintsViews(TextureKind kind) const;
    void advanceJobs();
    void advanceFilm();
    void openDropped(const std::filesystem::path& path);
    double fps() const;
    bool hasKeys() const;
    double lastKey() const;
    void pastePose(const std::filesystem::path& path);
    void say(std::string text, bool wrong = false);
    void attempt(const std::function<void()>& action);
    bool interacting() const;
    Motion shownMotion() const;
    std::filesystem::path freeName(const std::string& stem, const std::string& extension) const;

    // pictures.cpp
    void layOut();
    ViewTransform view() const;
    Camera cameraOf(const Pane& pane) const;
    std::span<const uint32_t> backgroundOf(const Pane& pane);
    ShadeOptions shadeOptions(const Pane& pane) const;
    Shown wanted() const;
    void updatePictures();
    bool refines() const;
    void useTexture(TextureKind kind);
    void updateTextures();

    // interaction.cpp
    void handleKeys();
    void handleMouse();
    void beginJointDrag(size_t joint);
    void dragJoint();
    void dragRing();
    void frameAll();
    void lookFrom(double yaw, double pitch);
    const Pane* paneAt(double x, double y) const;
    glm::dvec3 onScreen(const glm::dvec3& world, const Pane& pane) const;
    void leaveCaptureCamera();
    std::optional<size_t> jointAt(double x, double y) const;
    struct RingHit {
        int axis;
        glm::dvec2 tangent;  // pixels per radian
    };
    std::optional<RingHit> ringAt(double x, double y) const;
    std::vector<glm::dvec2> ring(int axis, const Pane& pane) const;
    void drawOverlays();

    // panel.cpp
    void drawPanel();
    void drawTimeline();
    void drawHelp();
    void drawStatus();
    void drawViewTab();
    void drawPoseTab();
    void drawShapeTab();
    void drawFilesTab();

    ViewerOptions options_;
    LiveAvatar source_;
    std::shared_ptr<LoadedAvatar> avatar_;
    Window window_;
    Device device_;
    std::unique_ptr<Scene> scene_;
    std::unique_ptr<Painter> painter_;
    std::unique_ptr<PoseEditor> editor_;
    mutable Skeleton skeleton_{};
    mutable std::optional<Betas> skeletonBetas_;  // whose it is
    ViewSettings settings_;
    OrbitCamera orbit_;

    // The pictures as they are shown.
    std::vector<Pane> panes_;
    std::vector<std::vector<uint32_t>> pixels_;  // per pane
    std::optional<Shown> shown_;
    uint64_t pictures_ = 0;
    int refinements_ = 0;
    Times times_;
    Clock::time_point lastTouched_{}, lastFrame_{};
    int framesToDraw_ = 3;
    bool drawable_ = true;  // the window has a size

    // Textures as they were painted last.
    std::map<TextureKind, std::vector<float>> textures_;
    std::pair<TextureKind, uint64_t> sceneTexture_{};  // and its version, as the scene has it
    uint64_t textureVersion_ = 1, viewVersion_ = 1;
    std::map<TextureKind, uint64_t> painted_;  // the view each was painted for
    double paintSeconds_ = 1;

    // Backgrounds.
    Image backdropPicture_;
    uint64_t backdropVersion_ = 1;
    std::vector<uint32_t> background_;
    std::array<int64_t, 5> backgroundKey_{-1, -1, -1, -1, -1};
    std::optional<Capture> capture_;
    std::unique_ptr<FrameCache> captureFrames_;

    // The timeline.
    std::optional<Motion> motion_;
    double timeline_ = 0, shownTime_ = -1;  // frames
    bool playing_ = false, loop_ = true;
    double speed_ = 1;
    Clock::time_point lastTick_{};

    // Mouse.
    Drag drag_ = Drag::None;
    glm::dvec2 mouse_{}, dragStart_{};
    Pane dragPane_;
    std::optional<size_t> hovered_, selected_;
    std::set<size_t> pins_;
    Pose dragBegan_;
    glm::dvec3 dragPoint_{};
    RingHit dragRing_{};

    // Long jobs.
    struct FilmJob;
    struct ExportJob;
    std::unique_ptr<FilmJob> film_;
    std::unique_ptr<ExportJob> export_;
    std::array<char, 512> pathText_{};

    std::string message_;
    bool messageIsWrong_ = false, messageDrawn_ = false;
    Clock::time_point messageSince_{};
};

}  // namespace doppel
