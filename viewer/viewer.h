// The viewer: an avatar in a window, its joints to be dragged and its camera to be turned.
#pragma once

#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/io/image.h"
#include "trainer/data/frame_cache.h"
#include "trainer/motion/motion.h"
#include "trainer/motion/retarget/retarget.h"
#include "viewer/compare/company.h"
#include "viewer/compare/source_body.h"
#include "viewer/films/film_plan.h"
#include "viewer/films/film_thread.h"
#include "viewer/inspect/inspected.h"
#include "viewer/inspect/sightings.h"
#include "viewer/job.h"
#include "viewer/keys/bindings.h"
#include "viewer/live/live_avatar.h"
#include "viewer/live/making.h"
#include "viewer/live/training_watch.h"
#include "viewer/mix/mixer.h"
#include "viewer/picture/moving_samples.h"
#include "viewer/picture/orbit_camera.h"
#include "viewer/picture/painter.h"
#include "viewer/picture/pane.h"
#include "viewer/picture/pose_pictures.h"
#include "viewer/picture/scene.h"
#include "viewer/pose/ik.h"
#include "viewer/pose/pose_editor.h"
#include "viewer/pose/pose_library.h"
#include "viewer/pose/shape_names.h"
#include "viewer/preferences.h"
#include "viewer/question.h"
#include "viewer/recovery.h"
#include "viewer/settings.h"
#include "viewer/window/file_dialog.h"
#include "viewer/window/window.h"

namespace doppel {

class Viewer {
public:
    // On a plain monitor, where one unit is one pixel; the rest shows the avatar.
    static constexpr double kDividerPick = 6;  // units to each side
    static constexpr int kPanelWidth = 360, kTimelineHeight = 74;

    // InputError for what the options name and is not there or not right; MachineError where no
    // window can be opened. window: in place of one of its own, opened or become as windowOptions()
    // has it. making: one that was begun before; its avatar is opened as soon as there is something
    // to see, as one of this window's.
    explicit Viewer(const ViewerOptions& options, std::unique_ptr<Window> window = {},
                    std::optional<Making> making = {});
    ~Viewer();

    // One turn: events in, picture out; waits for events where there is nothing to do. False once
    // the window is closed, nothing that is edited would be lost, and no glTF file is being
    // written. Mistakes of the user, and files that cannot be written, are said in the
    // window; a device that fails is a MachineError.
    bool frame();
    // Until the window is closed. Where something ends it otherwise what was edited is kept for the
    // next start; where the machine fails, the message says so. each: called before every turn.
    void run(const std::function<void()>& each = {});

    const Window& window() const { return window_; }
    Window& window() { return window_; }
    ViewSettings& settings() { return settings_; }
    OrbitCamera& camera() { return orbit_; }
    PoseEditor& editor() { return *editor_; }
    const std::vector<Pane>& panes() const { return panes_; }
    // Window coordinates; 0 where it is closed.
    int panelWidth() const;
    int timelineHeight() const;
    // Of the last picture, and where a joint is on it: window coordinates, depth in metres.
    glm::dvec3 jointOnScreen(size_t joint) const;
    PosedSkeleton posed() const;
    // Of the shape that is set.
    const Skeleton& skeleton() const;
    std::optional<size_t> selected() const { return selected_; }
    // How far the ring that is dragged has turned its joint, degrees, as it is said at the mouse;
    // empty: none is dragged.
    std::string turnedText() const;
    // Of the highest point above the floor, metres; nothing where there is no floor.
    std::optional<double> height(MeshKind mesh);
    const Preferences& preferences() const { return preferences_; }
    const Bindings& keys() const { return keys_; }
    // The point of the surface that was clicked on last while the panel shows the inspector, and,
    // once they are counted, the training frames that show it.
    const std::optional<Inspected>& inspected() const { return inspected_; }
    const std::optional<Sightings>& sightings() const { return sightings_; }
    // Nothing is being computed, and the picture shows what is set, as fine as it becomes.
    bool settled() const;
    // The latest message; empty: none so far.
    const std::string& message() const;
    // How many of the latest are still shown: five seconds, fifteen of what went wrong.
    size_t visibleMessages() const;
    // What the window asks, with the answers that it offers; empty: nothing.
    std::string question() const { return question_.text(); }
    std::vector<std::string> answers() const { return question_.answers(); }
    // As a click on the answer; CHECKs that it is offered.
    void answer(const std::string& label);
    // Pictures of something else than the one before.
    uint64_t pictureCount() const { return pictures_; }
    // How many refinements the picture is the mean of, of kRefinements; 0: drawn while it moved.
    int refinements() const { return refinements_; }
    // What has computed pictures so far; for tests.
    const Device& device() const { return *device_; }
    int64_t frameCount() const;  // of the timeline
    double timeline() const { return timeline_; }
    // Milliseconds of the latest picture's stages.
    struct Times {
        double pose = 0, draw = 0, show = 0, paint = 0, fps = 0;
    };
    const Times& times() const { return times_; }

    // What is said of a training that goes on: stage, step and time left; losses; the device. The
    // curve is of the sum, in window coordinates, as it is drawn now.
    std::vector<std::string> trainingLines() const;
    const std::vector<glm::vec2>& trainingPlot() const { return trainingPlot_; }

    // What the panel's buttons do; InputError where it cannot be done.
    //
    // What is seen, as a poses.npz. Ctrl+S writes this file again as long as the same is open.
    void savePoses(const std::filesystem::path& path);
    // The file that what is open was saved in, or one with a name that is free; asks before it
    // overwrites what somebody else has written there since.
    void save();
    // A motion, or a take that the viewer saved. Undo brings back what there was.
    void loadMotion(const std::filesystem::path& path, const std::string& frames = {});
    // For another body, unless it was edited since.
    void fitMotionAgain();
    void closeMotion();
    // Whatever a file is: a motion, a pose, a picture. Asks first where that would put away what
    // is not saved.
    void openFile(const std::filesystem::path& path);
    // Another person in the same pose, motion and view. InputError, with nothing changed, where
    // there is no avatar.
    void openAvatar(const std::filesystem::path& folder);
    // Shows another person, or another training's state, with this one and those that there are:
    // in the same pose. InputError likewise.
    void compareWith(const std::filesystem::path& folder);
    void loadPicture(const std::filesystem::path& path);
    // Another avatar, whose clothes, hair, head or shape can be taken. InputError likewise.
    void mixWith(const std::filesystem::path& folder);
    // Gives the avatar that of kMixParts, in the background: see Mixer::chosen.
    void takePart(size_t part, int giver);
    // What is mixed as a new avatar, in the background. InputError where there is something.
    void saveMix(const std::filesystem::path& out);
    const Avatar& avatar() const { return avatar_->avatar; }
    void startFilm(const std::filesystem::path& out, const FilmSettings& settings = {});
    void startFilmAsSet();  // as the panel says
    // One pane's, drawn in the background as a film is.
    void drawPicture(const std::filesystem::path& out, const PictureSettings& settings);
    void startExport(const std::filesystem::path& out);
    void cancelFilm();
    float filmProgress() const;
    // The avatar that is being made of a clip, if any; what is done of it stays.
    const std::optional<Making>& making() const { return making_; }
    void stopMaking();
    // All panes as they are seen.
    void saveScreenshot(const std::filesystem::path& path);
    void savePicture();  // as the panel says
    bool working() const { return film_ || export_ || mixSave_; }

private:
    enum class Drag { None, Click, Orbit, Pan, Dolly, Joint, Ring, Divider, Walk };
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
        uint64_t textures = 0, backdrop = 0, compared = 0;
        size_t frame = 0;  // of a capture
        bool operator==(const Shown&) const = default;
    };

    // A capture's pictures, as long as undo may come back to its motion.
    struct OpenCapture {
        std::weak_ptr<const Motion> motion;
        Capture capture;
        std::unique_ptr<FrameCache> frames;
    };
    // Where a motion came from, to be opened again by another process.
    struct OpenedMotion {
        std::weak_ptr<const Motion> motion;
        std::filesystem::path path;
        std::string frames;
        std::vector<TrainedFrame> trained;  // its frames that the avatar was trained on
        // As it was before it was fitted to the avatar, where that one is; null: a take.
        std::shared_ptr<const Motion> source;
    };
    // Where something was saved, and when the file was written; empty: nowhere yet.
    struct SavedFile {
        std::filesystem::path path;
        std::filesystem::file_time_type time{};
    };
    struct Message {
        std::string text;
        bool wrong = false;
        Clock::time_point since{};
    };

    // viewer.cpp
    void useAvatar(std::shared_ptr<LoadedAvatar> avatar);
    void showTitle();
    void reloadIfChanged();
    void countPictures();
    void advanceTimeline();
    void showTime();
    void step(int frames);
    // The last frame that the timeline shows: without a motion there is room to set keys in.
    int64_t timelineEnd() const;
    void followMotion();
    void play(bool on);
    bool messageVisible(const Message& message) const;
    TextureKind bestTexture() const;
    bool paintsViews(TextureKind kind) const;
    double fps() const;
    static double millisecondsSince(Clock::time_point began) {
        return std::chrono::duration<double, std::milli>(Clock::now() - began).count();
    }
    bool hasKeys() const;
    double lastKey() const;
    const Motion* motion() const { return editor_->motion().get(); }
    const OpenCapture* capture() const;
    const OpenedMotion* openedMotion() const;
    void say(std::string text, bool wrong = false);
    void attempt(const std::function<void()>& action);
    bool interacting() const;
    bool quiet() const;  // nothing is to be drawn but what jobs bring
    void undo();
    void redo();
    // Where undo brings the camera back: a move of it is a step once it rests, or now.
    void noteCamera(bool now = false);
    void undoCamera(bool on);
    void followCamera();  // as undo has left it

    // files.cpp
    Take readForPlaying(const std::filesystem::path& path, const std::string& frames);
    void openPerson(const std::filesystem::path& folder);  // once what is mixed is saved
    void openPicture(const std::filesystem::path& path);
    void openDropped();
    void askToOverwrite(const std::filesystem::path& path);
    void pastePose(const std::filesystem::path& path);
    void openKeysFile(const std::filesystem::path& path);
    void ask(Question question);
    void askToLeave();
    // Does it, once what is not saved is saved or given up.
    void afterSaving(const std::string& what, std::function<void()> then);
    // The same of what is mixed.
    void afterSavingMix(const std::string& what, std::function<void()> then);
    void saveAs(const std::filesystem::path& path);
    // By the desktop's dialog, which goes on beside the window.
    void askForFile(FileDialog::Asks asks, const std::string& title,
                    std::function<void(const std::filesystem::path&)> then,
                    const std::filesystem::path& proposed = "");
    void chooseFile(FileDialog::Asks asks);
    void chooseNewFile();
    void chooseNameToWrite();
    SavedFile savedFile() const;
    // Whether what is not saved is kept, or there is nothing.
    bool keepSession(bool now);
    std::string sessionNow() const;
    void offerRecovery();
    // Whether all of it is here again, and kept.
    bool recover(const std::string& text, const std::string& name);
    bool isFree(const std::filesystem::path& path) const;
    std::filesystem::path freeName(const std::string& stem, const std::string& extension) const;
    // As the panel names what is written, with this ending (".png", or "-frames" of a folder), and
    // with a number where that is taken; `unnamed` where it names only a folder, or nothing.
    std::filesystem::path nameToWrite(const std::string& unnamed, const std::string& ending) const;

    void opened(const std::filesystem::path& file);
    void setLook(Theme theme, double scale);

    // jobs.cpp
    void advanceJobs();
    Motion shownMotion() const;

    // live/making_avatars.cpp
    void askToMake(const std::filesystem::path& clip);
    void advanceMaking();
    void endMaking();
    void askToLeaveMaking();

    // films/filming.cpp
    FilmPlan filmPlan(const std::filesystem::path& out, const FilmSettings& settings);
    void draw(FilmPlan plan);
    void advanceFilm();
    void askToGiveFilmUp();
    void askToLeaveFilm();
    std::optional<PlacedPicture> filmPreview();
    void drawFilmPreview(const PlacedPicture& at) const;
    void drawFilmControls(bool enabled);

    // pictures.cpp
    void layOut();
    ViewTransform view() const;
    Camera cameraOf(const Pane& pane) const;
    // The capture's frames are seen, behind the avatar or otherwise.
    bool showsFrames() const {
        return settings_.backdrop >= Backdrop::Capture && capture() && settings_.captureCamera;
    }
    // Behind the avatar, unless they are seen otherwise.
    void showFrames();
    FrameInFront frameInFront() const;
    Pixels backgroundOf(const Pane& pane);
    bool framesInFront() const;
    void putFrameInFront(size_t pane);
    // Of a pane as the window shows it.
    std::vector<uint32_t> seen(size_t pane) const;
    Pixels behind(const Pane& pane);
    Pixels behind(const Pane& pane, std::optional<int> refinement, std::vector<float>& depths);
    ShadeOptions shadeOptions(const Pane& pane) const;
    Shown wanted() const;
    void updatePictures();
    void drawPanes(std::optional<int> refinement);
    // The pane's picture, where the window wants it.
    void drawPane(size_t i, Scene& scene, MeshKind mesh, const ShadeOptions& shade,
                  const Pixels& background, std::optional<int> refinement,
                  std::vector<float>* depths = nullptr);
    bool refines() const;
    void useTexture(TextureKind kind);
    void updateTextures();

    // keys/
    void handleKeys();
    void perform(Action action, int digit);
    void cancel();
    void stepToKey(bool on);
    void nextLight();
    void beginModalDrag(Drag drag);
    bool typesIntoDrag(const Chord& chord);
    double modalAngle();
    void beginWalk();
    void endWalk(bool stay);
    bool typesIntoWalk(const Chord& chord);
    void advanceWalk();
    // A preset or a file from now on; InputError, with nothing changed, where it is neither.
    void useKeys(const std::string& nameOrFile);
    void chooseKeys(const std::string& nameOrFile);  // for the next starts, too
    void openKeys();
    void drawKeysControls();
    void drawHelp();

    // interaction.cpp
    static int heldModifiers();
    std::optional<Drag> cameraDrag() const;
    bool onHandle() const;
    void turnWheel();
    void handleMouse();
    void beginJointDrag(size_t joint, const std::string& what = "move ");
    void dragJoint();
    void endDrag();
    void dragRing();
    void frameAll();
    void frameSelected();
    void setKey();
    void changeBlend();
    // InputError while one looks through the capture's camera, whose view it is then.
    void requireOwnCamera() const;
    void copyCamera();
    void copyCameraJson();
    void pasteCamera();
    void lookFrom(double yaw, double pitch);
    const Pane* paneAt(double x, double y) const;
    Scene& sceneOf(const Pane& pane);
    Camera viewCameraOf(const Pane& pane, double time) const;
    void setPoses(const Shown& now);
    void chooseCompared();
    void nextSplit();

    // compare/source.cpp
    bool hasSource() const;
    size_t frameNow() const;
    std::vector<uint32_t> sourceFrame(const Pane& pane);
    // As a part of updatePictures().
    void drawSource(size_t pane, std::optional<int> refinement);

    std::vector<std::string> personNames() const;
    std::vector<std::string> paneNames() const;
    std::optional<Company::Row> row();
    void drawOthers(const Pane& pane, std::optional<int> refinement, std::vector<uint32_t>& pixels,
                    std::vector<float>& depths);
    void drawCompanyControls();
    void drawPersonNames(const Pane& pane);
    void followCompared();
    std::optional<double> dividerAt() const;
    bool onDivider(double x) const;
    void dragDivider();
    glm::dvec3 onScreen(const glm::dvec3& world, const Pane& pane) const;
    void leaveCaptureCamera();
    void dollyToMouse(double factor);
    // Joints, rings and bones are drawn, and taken by the mouse.
    bool handles() const { return settings_.joints && !inspecting(); }
    std::optional<size_t> jointAt(double x, double y) const;
    static constexpr int kNoRing = 3;  // the line of sight
    struct RingHit {
        int axis;
        glm::dvec3 direction;  // the axis in the world
        glm::dvec2 tangent;    // pixels per radian
    };
    std::optional<RingHit> ringAt(double x, double y) const;
    std::vector<glm::dvec2> ring(int axis, const Pane& pane) const;
    // The selected joint's, as columns in the world.
    glm::dmat3 ringAxes(const PosedSkeleton& body) const;
    std::set<size_t> pinsOfDrag(const PosedSkeleton& began);
    Pose solvedAboveFloor(std::vector<IkTarget> targets, size_t dragged);
    bool feetStep(std::span<const IkTarget> targets) const;
    // Whether what is done to this joint is done to the one across, which no pin holds.
    bool editsBothSides(size_t joint) const;
    // What an edit of the joint makes of `began`: within limits, on both sides.
    Pose finished(const Pose& pose, const Pose& began, size_t joint) const;
    void drawOverlays();
    // Words on something to read them from.
    void drawLabel(const glm::vec2& at, const std::string& words) const;

    // inspect/inspector.cpp
    static constexpr const char* kInspectTab = "Inspect";
    // A click is for the surface then, and joints keep out of the way.
    bool inspecting() const { return settings_.panel && tab_ == kInspectTab; }
    void toggleInspector();
    void inspectAt(double x, double y);
    void followInspected();
    void seeFrame(size_t frame);
    const TrainedOn* trainedOnCapture();
    void drawInspectTab();
    void drawInspected(const Pane& pane) const;

    // floor.cpp
    void findFloor();
    std::optional<RigidMotion> worldToFloor() { return worldToFloor(timeline_); }
    std::optional<RigidMotion> worldToFloor(double time);
    double floorLine() const { return 1.2 * window_.unit() * window_.scale(); }  // pixels
    void drawHeight(const Pane& pane);

    // live/training_panel.cpp
    void drawTraining();

    // ghosts.cpp
    // Those of the timeline's `time`, the furthest first.
    std::vector<Ghost> ghosts(double time) const;

    // legend.cpp
    void drawLegend();

    // kept.cpp
    void keepView(int digit);
    void seeBookmark(int digit);
    void drawBookmarks();
    void usePosePictures();
    const CanvasImage* pictureOf(const KeptPose& kept);

    // panel.cpp
    void drawPanel();
    void drawTimeline();
    void drawStatus();
    void drawQuestion();
    void drawViewTab();
    void drawPoseTab();
    void drawKeptPoses();
    void drawShapeTab();
    void drawOpenedBefore();
    void drawFilesTab();

    // mix/mixing.cpp
    static constexpr const char* kMixTab = "Mix";
    std::map<std::string, std::string> wornNow() const;
    // As a session has it. InputError where somebody, or a part, is not there.
    void wear(const std::map<std::string, std::string>& worn);
    void beginMix();
    void advanceMix();
    void dress(std::shared_ptr<LoadedAvatar> avatar);
    void drawMixTab();

    ViewerOptions options_;
    LiveAvatar source_;
    TrainingWatch training_{{}};  // in the same folder
    std::vector<glm::vec2> trainingPlot_;
    std::shared_ptr<LoadedAvatar> avatar_;
    Preferences preferences_;
    double uiScale_ = 1;
    std::unique_ptr<Window> ownWindow_;
    Window& window_;
    std::shared_ptr<Device> device_;
    std::unique_ptr<Scene> scene_;
    Company others_{*device_};
    std::unique_ptr<SourceBody> sourceBody_;
    Mixer mixer_;
    std::shared_ptr<LoadedAvatar> unmixed_;  // the avatar without what others give; null: as it is
    bool mixSaved_ = true;                   // what is mixed, or there is nothing
    std::unique_ptr<Painter> painter_;
    std::unique_ptr<PoseEditor> editor_;
    mutable Skeleton skeleton_{};
    std::optional<std::array<ShapeName, BodyModel::kShapes>> shapeNames_;
    mutable std::optional<Betas> skeletonBetas_;  // whose it is
    ViewSettings settings_;
    OrbitCamera orbit_;

    // The pictures as they are shown.
    std::vector<Pane> panes_;
    std::vector<PanePicture> panePictures_;
    std::optional<Shown> shown_;
    uint64_t pictures_ = 0;
    MovingSamples movingSamples_;
    int refinements_ = 0;
    Times times_;
    Clock::time_point lastTouched_{}, lastPicture_{};
    uint64_t picturesCounted_ = 0;
    double pictureEvery_ = 0;  // milliseconds, the mean of those of this movement; 0: no two yet
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
    Pixels background_;            // of a view
    std::vector<uint32_t> frame_;  // the capture's, of the background's size; empty: none is seen
    // What a pane shows of it.
    struct BackgroundPart {
        Pixels of;
        Pane pane;
        Pixels part;
    };
    std::map<int, BackgroundPart> backgroundParts_;  // by the pane's x
    using BackgroundKey = std::array<int64_t, 6>;
    BackgroundKey backgroundKey_{-1, -1, -1, -1, -1, -1};
    // The floor: from the poses' world, y up. Nothing where the motion's feet stand nowhere.
    struct FloorOf {
        Pose pose;
        Betas betas{};
        uint64_t opening = 0;
        bool operator==(const FloorOf&) const = default;
    };
    std::optional<FloorOf> floorOf_;  // that is known
    std::optional<RigidMotion> floor_;
    Proportions proportions_;  // of the body that it was found for
    // What is behind the avatar besides the background, and what that was drawn of.
    struct Behind {
        Pose pose;
        Betas betas{};
        Pane pane;
        Camera camera;
        ViewTransform view;
        BackgroundKey background{};
        std::optional<RigidMotion> floor;
        std::vector<Ghost> ghosts;
        uint64_t others = 0;          // Company::version()
        std::optional<double> apart;  // of a row
        bool operator==(const Behind&) const = default;
    };
    std::map<int, std::pair<Behind, Pixels>> behind_;  // by the pane's x
    std::vector<OpenCapture> captures_;
    const Motion* motionSeen_ = nullptr;  // of the last turn; undo may bring another one
    std::vector<OpenedMotion> motions_;

    // The timeline.
    double timeline_ = 0;  // frames
    bool playing_ = false, loop_ = true;
    std::string cameraNoted_;  // cameraText() of the one that undo knows last
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
    bool dragMoved_ = false;  // further than a click does
    glm::dvec3 dragGoal_{};   // that was solved for last
    RingHit dragRing_{};
    double dragAsked_ = 0,
           dragTurned_ = 0;  // by the ring, radians: by the mouse, and as limits let
    // A drag that a key began.
    struct Modal {
        std::string typed;                // degrees
        std::optional<double> direction;  // of the mouse from the joint, radians
        double turned = 0;                // radians on the picture, clockwise
    };
    std::optional<Modal> modal_;
    // A walk, which a key began as well.
    struct Walk {
        OrbitCamera began;
        bool captureCamera = false;
        Clock::time_point last{};
        bool goes = false;  // a key is held
    };
    std::optional<Walk> walk_;
    Bindings keys_;

    // The panel.
    std::string tab_, tabWanted_;  // that is open; that shall be

    // The inspector.
    std::optional<Inspected> inspected_;
    std::optional<Sightings> sightings_;
    std::unique_ptr<SightingSearch> search_;
    // The capture of the avatar's training, looked for once somebody inspects.
    std::optional<TrainedOn> trainedOn_;
    std::weak_ptr<const LoadedAvatar> trainedOnOf_;
    // What the sightings are of.
    struct Searched {
        SurfacePoint point;
        std::weak_ptr<const Motion> motion;  // that plays; expired: the capture of the training
        std::weak_ptr<const LoadedAvatar> avatar;
    };
    Searched searched_;

    // Long jobs.
    std::unique_ptr<FilmThread> film_;
    bool leaveAfterFilm_ = false;       // the window closes once it has ended
    Image filmPicture_;                 // that was drawn last
    std::vector<uint32_t> filmPixels_;  // of it, as the window shows them
    FilmSettings filmSettings_;         // of the panel
    PictureSettings pictureSettings_;   // likewise
    int filmKind_ = 0;                  // of videoKinds(), and behind them a folder of pictures
    std::unique_ptr<ExportJob> export_;
    std::unique_ptr<ExportJob> mixSave_;
    std::optional<Making> making_;
    bool madeShown_ = false;                        // the avatar that is being made was opened
    std::array<char, 512> pathText_{}, outText_{};  // what is opened; what is written

    std::deque<Message> messages_;  // the latest at the back
    size_t messagesDrawn_ = 0;

    // What is not saved.
    PoseLibrary library_;
    PosePictures posePictures_;
    bool poseDrawn_ = false;                // one of them, in this frame
    std::string poseTaken_;                 // the kept pose that was taken last
    std::optional<std::string> poseNamed_;  // its new name while it is typed
    std::filesystem::path motionFile_;      // that was opened last; empty: none, or it was closed
    std::string motionFrames_;              // of it
    std::deque<std::filesystem::path> dropped_;  // that wait for the answer to a question
    FileDialog dialog_;
    std::function<void(const std::filesystem::path&)> dialogThen_;
    std::map<uint64_t, SavedFile> savedFiles_;  // by PoseEditor::opening(): undo may come back
    QuestionBox question_;
    uint64_t givenUpVersion_ = 0;  // of what is edited, that may be lost with the window
    Recovery recovery_;
    uint64_t keptVersion_ = 0;  // of what is edited, as the session's file has it
    std::map<std::string, std::string> keptWorn_;  // likewise
    Clock::time_point keptAt_{};
    double keptSeconds_ = 0;  // that writing it took
    bool keepingFailed_ = false;
};

}  // namespace doppel
