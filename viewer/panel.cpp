// The panel on the right.
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

std::string shown(std::string_view snakeCase) {
    std::string name(snakeCase);
    std::ranges::replace(name, '_', ' ');
    return name;
}

// A slider's drag is one gesture.
bool beginsGesture(PoseEditor& editor, std::string_view name) {
    if (ImGui::IsItemActivated()) editor.beginGesture(name);
    return ImGui::IsItemActivated();
}

template <typename Value>
int number(Value value) {
    return static_cast<int>(value);
}

}  // namespace

void Viewer::drawPanel() {
    if (!settings_.panel) return;
    ImVec2 size = ImGui::GetIO().DisplaySize;
    const auto width = static_cast<float>(panelWidth()),
               below = static_cast<float>(timelineHeight());
    ImGui::SetNextWindowPos({size.x - width, 0});
    ImGui::SetNextWindowSize({width, size.y - below});
    ImGui::Begin("panel", nullptr, kFixed);
    // Labels stand to the right of what they name.
    ImGui::PushItemWidth(-ImGui::CalcTextSize("field of view  ").x);
    if (ImGui::BeginTabBar("tabs")) {
        const auto drawTab = [&](const char* label, const char* does, void (Viewer::*content)()) {
            const bool show = tabWanted_ == label;
            if (show) tabWanted_.clear();
            if (!tab(label, does, show)) return;
            tab_ = label;
            (this->*content)();
            ImGui::EndTabItem();
        };
        drawTab("View", "What is shown, from where, and in which light.", &Viewer::drawViewTab);
        drawTab("Pose", "How drags go, poses that are kept, and each joint.", &Viewer::drawPoseTab);
        drawTab("Shape", "The body: height, girth and more.", &Viewer::drawShapeTab);
        drawTab(kInspectTab, "What is known of a point of the body that is clicked on.",
                &Viewer::drawInspectTab);
        drawTab(kMixTab, "Clothes, hair or head of other avatars on this one.",
                &Viewer::drawMixTab);
        drawTab("Files", "What is opened, saved, filmed and said.", &Viewer::drawFilesTab);
        ImGui::EndTabBar();
    }
    ImGui::PopItemWidth();
    ImGui::End();
}

void Viewer::drawViewTab() {
    const Avatar& avatar = avatar_->avatar;
    int mesh = number(settings_.mesh);
    if (scene_->hasRefinedMesh()) {
        constexpr Choice kMeshes[] = {
            {"body", static_cast<int>(MeshKind::Body), "As skinning leaves it."},
            {"refined by the network", static_cast<int>(MeshKind::Refined),
             "With what the mesh network adds for this pose."}};
        choose("mesh", "The body as skinning leaves it, or as the mesh network refines it.",
               kMeshes, mesh);
        settings_.mesh = static_cast<MeshKind>(mesh);
    } else {
        hint("mesh: body (stage mesh is not trained)");
    }
    auto paint = number(settings_.paint);
    constexpr Choice kPaints[] = {
        {"texture", kPaintTexture, "The person's colours."},
        {"none (clay)", kPaintClay, "Its form alone."},
        {"normals", kPaintNormals, "Which way the surface faces, as colours."},
        {"visibility map", kPaintVisibility, "What the texture networks see of this view."},
        {"UV checker", kPaintChecker, "How large texels are, and where the atlas has seams."},
        {"part labels", kPaintParts, "The body's parts, which clothes and bounds go by."},
        {"clamp bounds", kPaintClamps, "K(v): how far the mesh network may move it."}};
    choose("surface", "What the surface is painted with.", kPaints, paint);
    settings_.paint = static_cast<uint32_t>(paint);
    auto texture = number(settings_.texture);
    constexpr int kCoarse = static_cast<int>(TextureKind::Coarse),
                  kRefined = static_cast<int>(TextureKind::Refined),
                  kBaked = static_cast<int>(TextureKind::Baked);
    constexpr std::string_view kCoarseDoes = "As the first network paints it.",
                               kRefinedDoes = "As the second network paints this very view.";
    if (avatar.refineNet.empty()) {
        hint(avatar_->textured ? "texture: coarse (stage refine is not trained)"
                               : "texture: none yet");
    } else if (avatar.bakedTexture.empty()) {
        constexpr Choice kTextures[] = {{"coarse", kCoarse, kCoarseDoes},
                                        {"refined for the view", kRefined, kRefinedDoes}};
        choose("texture", "Which of the avatar's textures is shown.", kTextures, texture);
    } else {
        constexpr Choice kTextures[] = {
            {"coarse", kCoarse, kCoarseDoes},
            {"refined for the view", kRefined, kRefinedDoes},
            {"refined, baked", kBaked, "One of many views, as exports take it."}};
        choose("texture", "Which of the avatar's textures is shown.", kTextures, texture);
    }
    settings_.texture = static_cast<TextureKind>(texture);
    auto split = number(settings_.split);
    constexpr Choice kSplits[] = {
        {"off", static_cast<int>(Split::None), "The avatar alone."},
        {"body | refined mesh", static_cast<int>(Split::Meshes),
         "What the mesh network adds to the body."},
        {"coarse | refined", static_cast<int>(Split::Textures),
         "What the second texture network adds to the first."},
        {"source | avatar", static_cast<int>(Split::Source),
         "The motion on the body that it comes from, and on this one."},
        {"this avatar | others", static_cast<int>(Split::Avatars), "Each in a picture of its own."},
        {"all in one scene", static_cast<int>(Split::Together), "They stand side by side."}};
    choose("compare",
           keys_.tip("Two meshes, two textures, what the motion comes from, or avatars",
                     Action::Compare),
           kSplits, split);
    const bool people = split >= static_cast<int>(Split::Avatars), asks = people && others_.empty();
    if (split == static_cast<int>(Split::Source) && !hasSource()) {
        say("nothing plays whose source is known: open a capture or a motion");
        split = number(settings_.split);
    }
    if (!asks) settings_.split = static_cast<Split>(split);
    if (asks) attempt([&] { chooseCompared(); });
    const bool two = settings_.split != Split::Avatars || others_.size() == 1;
    if (settings_.split != Split::None && settings_.split != Split::Together && two)
        checkbox("in one picture", "Divided by a line that can be dragged; else side by side.",
                 settings_.divided);
    if (settings_.split >= Split::Avatars) drawCompanyControls();
    checkbox("wireframe", keys_.tip("The edges of the mesh's faces", Action::Wireframe),
             settings_.wireframe);
    beside("atlas in the corner");
    checkbox("atlas in the corner", "The texture itself, as it lies in UV space.", settings_.atlas);
    checkbox("joints", keys_.tip("The skeleton, whose joints can be dragged", Action::Joints),
             settings_.joints);
    beside("figures");
    checkbox("figures", "How long pictures take, in the corner.", settings_.figures);
    if (training_.stage()) {
        beside("training");
        checkbox("training", "How far the training is that goes on in this folder, in the corner.",
                 settings_.training);
    }
    beside("floor");
    checkbox(
        "floor",
        keys_.tip("A grid where the feet stand, the contact shadow and a scale", Action::Floor),
        settings_.floor);
    if (settings_.floor) {
        findFloor();
        if (!floor_) hint("no floor: the feet of this motion stand nowhere");
    }
    if (frameCount() > 1) {
        slider("ghosts", "How many frames before (orange) and after (blue) are seen as ghosts.",
               settings_.ghosts, 0, 5, "%d to each side");
        if (settings_.ghosts > 0)
            slider("ghost spacing", "How far ghosts are from each other.", settings_.ghostSpacing,
                   1, 30, "%d frames");
    }

    ImGui::Separator();
    auto light = number(settings_.light);
    constexpr Choice kLights[] = {
        {"the capture's", kLightCapture, "That training has learned from the frames."},
        {"flat", kLightFlat, "The texture as it is."},
        {"a lamp", kLightLamp, "One of yours."}};
    choose(
        "light",
        keys_.tip("As before the camera that recorded the person, none, or a lamp", Action::Light),
        kLights, light);
    settings_.light = static_cast<uint32_t>(light);
    if (settings_.light == kLightLamp) {
        slider("from the side", "Where the lamp stands, radians around the body.",
               settings_.lampYaw, -std::numbers::pi, std::numbers::pi, "%.2f");
        slider("from above", "How high the lamp stands, radians.", settings_.lampPitch, -1.57, 1.57,
               "%.2f");
        slider("ambient", "Light from everywhere, the rest comes from the side.", settings_.ambient,
               0, 1, "%.2f");
    } else if (settings_.light == kLightCapture && avatar.light.empty()) {
        hint("flat: training has learned no light");
    }

    ImGui::Separator();
    auto backdrop = number(settings_.backdrop);
    constexpr Choice kBackdrops[] = {
        {"colour", static_cast<int>(Backdrop::Colour), "One of yours."},
        {"picture (drop one)", static_cast<int>(Backdrop::Picture), "The last that was dropped."},
        {"capture's frames", static_cast<int>(Backdrop::Capture),
         "What the camera saw, behind the avatar."},
        {"frames in front", static_cast<int>(Backdrop::Overlay),
         "What the camera saw, over the avatar, to see through."},
        {"difference from frames", static_cast<int>(Backdrop::Difference),
         "How far the avatar is from what the camera saw."}};
    if (choose("background",
               "What is behind the avatar; the capture's frames also in front of it, or how far it "
               "is from them.",
               kBackdrops, backdrop) &&
        backdrop > static_cast<int>(Backdrop::Capture) && capture())
        settings_.captureCamera = true;
    settings_.backdrop = static_cast<Backdrop>(backdrop);
    if (settings_.backdrop == Backdrop::Colour) {
        ImGui::ColorEdit3("colour", settings_.colour.data(), ImGuiColorEditFlags_NoInputs);
        noteItem("colour");
        tip("The background's colour.");
    }
    if (settings_.backdrop == Backdrop::Overlay)
        slider("opacity", "Of the frame: 0 shows the avatar alone, 1 the frame alone.",
               settings_.frameOpacity, 0, 1, "%.2f");
    if (settings_.backdrop == Backdrop::Difference) {
        slider("times", "How much larger the difference is shown than it is.",
               settings_.differenceTimes, 1, 8, "%d");
        if (showsFrames() && capture()->capture.hasMasks())
            hint("brightest: the person, where the avatar is not");
    }
    if (settings_.backdrop >= Backdrop::Capture && !showsFrames())
        hint(capture() ? "seen with the capture's camera only" : "no capture is loaded");

    ImGui::Separator();
    if (button("frame all", keys_.tip("Sees all of the body", Action::FrameAll))) frameAll();
    beside("front");
    if (button("front", keys_.tip("From the front", Action::Front))) lookFrom(0, 0);
    beside("side");
    if (button("side", keys_.tip("From its left", Action::Left))) lookFrom(std::numbers::pi / 2, 0);
    beside("top");
    if (button("top", keys_.tip("From above", Action::Top))) lookFrom(orbit_.yaw, 1.55);
    checkbox("orthographic", keys_.tip("Without perspective", Action::Orthographic),
             orbit_.orthographic);
    if (motion() && !motion()->cameras.empty()) {
        beside("capture's camera");
        checkbox("capture's camera",
                 keys_.tip("As the camera saw each frame", Action::CaptureCamera),
                 settings_.captureCamera);
    }
    double degrees = orbit_.fieldOfView * kDegrees;
    if (!settings_.captureCamera &&
        slider("field of view", "How much of the height the camera sees, degrees.", degrees, 5, 100,
               "%.0f deg"))
        orbit_.fieldOfView = degrees / kDegrees;
    if (button("copy camera", keys_.tip("As --camera takes it", Action::CopyCamera)))
        attempt([&] { copyCamera(); });
    beside("copy as JSON");
    if (button(
            "copy as JSON",
            "The camera for other programs: the text of --camera, the size, and OpenCV's matrices; "
            "\"paste camera\" takes it, too."))
        attempt([&] { copyCameraJson(); });
    beside("paste camera");
    if (button("paste camera", keys_.tip("A camera that was copied", Action::PasteCamera)))
        attempt([&] { pasteCamera(); });
    drawBookmarks();

    ImGui::Separator();
    auto theme = number(settings_.theme);
    constexpr Choice kThemes[] = {{"dark", static_cast<int>(Theme::Dark)},
                                  {"light", static_cast<int>(Theme::Light)}};
    if (choose("theme", "The interface's colours.", kThemes, theme))
        setLook(static_cast<Theme>(theme), uiScale_);
    if (button("smaller", keys_.tip("Smaller letters", Action::Smaller)))
        setLook(settings_.theme, uiScale_ / 1.1);
    beside("larger");
    if (button("larger", keys_.tip("Larger letters", Action::Larger)))
        setLook(settings_.theme, uiScale_ * 1.1);
    beside("keys...");
    if (button("keys...", keys_.tip("Lists the keys, and chooses others", Action::Help)))
        settings_.help = true;
}

void Viewer::drawPoseTab() {
    PoseEditor& editor = *editor_;
    const auto named = [](const char* does, std::string_view step) {
        return step.empty() ? std::string(does) : fmt::format("{}: {}", does, shown(step));
    };
    if (button("undo",
               keys_.tip(named("Takes the last edit back", editor.undoName()), Action::Undo),
               editor.canUndo()))
        undo();
    beside("redo");
    if (button("redo", keys_.tip(named("Makes it again", editor.redoName()), Action::Redo),
               editor.canRedo()))
        redo();
    beside("mirror");
    if (button("mirror", keys_.tip("Exchanges left and right", Action::Mirror))) editor.mirror();
    beside("reset all");
    if (button("reset all", keys_.tip("The pose as it was", Action::ResetPose))) editor.resetPose();
    if (button("copy", keys_.tip("The pose as JSON", Action::CopyPose))) {
        window_.setClipboard(editor.copy());
        say("pose copied");
    }
    beside("paste");
    if (button("paste", keys_.tip("A pose that was copied", Action::PastePose)))
        attempt([&] { editor.paste(window_.clipboard()); });
    drawKeptPoses();
    if (button("left to right", "The left side's pose, mirrored, on the right."))
        editor.copySide(true);
    beside("right to left");
    if (button("right to left", "The right side's pose, mirrored, on the left."))
        editor.copySide(false);
    checkbox("both sides", "What is done to one side is done to the other, unless a pin holds it.",
             settings_.symmetric);
    beside("joint limits");
    checkbox("joint limits", "Keeps joints within human ranges.", settings_.limits);
    beside("balance over pins");
    checkbox("balance over pins", "Keeps the body over its pinned feet while it is dragged.",
             settings_.balance);
    beside("feet hold to the floor");
    checkbox("feet hold to the floor",
             "Feet that stand on the floor stay there while the body or a hand is dragged.",
             settings_.holdFeet);
    if (settings_.holdFeet) {
        beside("feet step");
        checkbox("feet step",
                 "A foot on the floor follows what is pulled further than the body reaches, "
                 "unless it is pinned.",
                 settings_.steps);
    }
    beside("nothing below the floor");
    checkbox("nothing below the floor", "What is dragged stops at the floor.",
             settings_.aboveFloor);
    if (settings_.holdFeet || settings_.aboveFloor) {
        findFloor();
        if (!floor_) hint("no floor: the feet of this motion stand nowhere");
    }
    constexpr Choice kAxes[] = {
        {"the joint's own", static_cast<int>(RingAxes::Own), "They turn with it."},
        {"its parent's", static_cast<int>(RingAxes::Parents),
         "They turn with the bone before; of the pelvis, the capture's space."},
        {"the view's", static_cast<int>(RingAxes::Views), "Right, down and into the picture."}};
    auto axes = number(settings_.ringAxes);
    choose("rings about", "The axes that the rings turn about.", kAxes, axes);
    settings_.ringAxes = static_cast<RingAxes>(axes);
    if (checkbox("rings by 5 degrees", "Turns by steps; Ctrl, held, does the other.",
                 preferences_.snap))
        writePreferences(options_.state, preferences_);
    const bool single = ImGui::CollapsingHeader("drags turn one bone (FK)");
    noteItem("drags turn one bone (FK)");
    tip("Of which limbs a drag turns the bone above alone; else the whole limb follows (IK).");
    if (single) {
        constexpr std::array<const char*, kLimbs> kNames{"left arm", "right arm", "left leg",
                                                         "right leg"};
        for (size_t limb = 0; limb < kLimbs; ++limb) {
            if (limb % 2 == 1) beside(kNames[limb]);
            checkbox(kNames[limb], "A drag turns the bone above the joint alone.",
                     settings_.fk[limb]);
        }
    }

    ImGui::Separator();
    hint("degrees about the joint's own axes");
    // In a low window the panel scrolls, and not a list of one line.
    ImGui::BeginChild("joints", {0, std::max(ImGui::GetContentRegionAvail().y,
                                             8 * ImGui::GetTextLineHeightWithSpacing())});
    std::optional<Limb> limbNow;
    for (size_t j : jointsByLimb()) {
        // Trunk and head first, then limb by limb.
        if (const std::optional<Limb> limb = limbOfTree(j); limb != limbNow) {
            limbNow = limb;
            ImGui::Separator();
        }
        ImGui::PushID(number(j));
        bool open = selected_ == j;
        std::string name = shown(jointName(j)) + (pins_.contains(j) ? "  [pinned]" : "");
        if (ImGui::Selectable(name.c_str(), open))
            selected_ = open ? std::nullopt : std::optional<size_t>(j);
        noteRow(shown(jointName(j)));
        tip("Selects the joint and shows its angles.");
        if (open) {
            Pose pose = editor.pose();
            glm::dvec3 degrees = pose.rotation[j] * kDegrees;
            bool changed = false, ended = false;
            const char* labels[] = {"x", "y", "z"};
            for (int axis = 0; axis < 3; ++axis) {
                changed |= slider(labels[axis],
                                  "How far the joint is turned, degrees. Ctrl + click types.",
                                  degrees[axis], -180, 180, "%.1f");
                if (beginsGesture(editor, jointName(j))) play(false);
                ended |= ImGui::IsItemDeactivated();
            }
            if (changed) {
                Pose edited = pose;
                edited.rotation[j] = degrees / kDegrees;
                editor.setPose(finished(edited, pose, j));
            }
            if (ended) editor.endGesture();
            if (button("reset", keys_.tip("This joint as it was", Action::ResetJoint)))
                editor.resetJoint(j, editsBothSides(j));
            if (j != joint::kPelvis) {
                beside("pinned");
                bool pinned = pins_.contains(j);
                if (checkbox("pinned",
                             keys_.tip("Stays where it is while others are dragged", Action::Pin),
                             pinned)) {
                    if (pinned)
                        pins_.insert(j);
                    else
                        pins_.erase(j);
                }
            }
        }
        ImGui::PopID();
    }
    ImGui::EndChild();
}

void Viewer::drawShapeTab() {
    PoseEditor& editor = *editor_;
    words(
        "Shape coefficients of the body, in standard deviations. The networks were "
        "trained on this person's own.");
    if (!shapeNames_) shapeNames_ = shapeNames(avatar_->avatar.body);
    Betas betas = editor.betas();
    bool changed = false, ended = false;
    for (size_t k = 0; k < betas.size(); ++k) {
        double beta = double{betas[k]};
        hint((*shapeNames_)[k].name);
        if (slider(fmt::format("beta {}", k).c_str(),
                   "One more on the mean shape: " + (*shapeNames_)[k].effect + ".", beta, -4, 4,
                   "%.2f")) {
            betas[k] = static_cast<float>(beta);
            changed = true;
        }
        if (beginsGesture(editor, "shape")) play(false);
        ended |= ImGui::IsItemDeactivated();
    }
    if (changed) editor.setBetas(betas);
    if (ended) editor.endGesture();
    if (button("this person's own", "The shape that the avatar was made with."))
        editor.resetBetas();
}

// All but the avatar that is open.
void Viewer::drawOpenedBefore() {
    std::error_code ignored;
    const std::string now = std::filesystem::weakly_canonical(source_.folder(), ignored).string();
    const auto isOther = [&](const std::string& path) { return path != now; };
    if (std::ranges::none_of(preferences_.recent, isOther)) return;
    const bool open = ImGui::CollapsingHeader("opened before");
    noteItem("opened before");
    tip("The files that were opened last.");
    if (!open) return;
    std::string chosen;
    for (size_t i = 0; i < preferences_.recent.size(); ++i) {
        const std::filesystem::path path = preferences_.recent[i];
        if (!isOther(path.string())) continue;
        ImGui::PushID(number(i));
        std::string name = path.filename().string();
        if (name.empty()) name = path.parent_path().filename().string();
        if (ImGui::Selectable(name.c_str())) chosen = path.string();
        noteRow(name);
        tip(path.string());
        ImGui::PopID();
    }
    if (!chosen.empty()) attempt([&] { openFile(chosen); });
}

void Viewer::drawFilesTab() {
    words("Drop an avatar, a capture, a clip, a motion, a pose or a picture here, or name it:");
    const bool entered = pathField("A file or folder; Enter opens it.", pathText_, window_.keys());
    const bool named = pathText_[0] != 0;
    if ((button("open", "The avatar, motion, pose or picture of this name.", named) || entered) &&
        named)
        attempt([&] { openFile(typedPath(pathText_)); });
    beside("save poses as");
    if (button("save poses as", "Saves what is edited under this name.", named))
        attempt([&] { saveAs(typedPath(pathText_)); });
    const bool asks = FileDialog::isThere();
    const char* none = asks ? "" : " It needs zenity or kdialog, which are not installed.";
    if (button("choose a file", keys_.tip("A motion, a pose or a picture", Action::Open) + none,
               asks))
        attempt([&] { chooseFile(FileDialog::Asks::File); });
    beside("choose a folder");
    if (button("choose a folder",
               keys_.tip("An avatar, a capture or poses", Action::OpenFolder) + none, asks))
        attempt([&] { chooseFile(FileDialog::Asks::Folder); });
    if (button("choose where to save", keys_.tip("Poses, .npz", Action::SaveAs) + none, asks))
        attempt([&] { chooseNewFile(); });
    if (making_) {
        words(fmt::format("An avatar is being made of {}: {}", making_->clip().filename().string(),
                          making_->brief()));
        if (button("stop making it", "What is done stays; the clip, dropped again, goes on.",
                   !making_->stops()))
            stopMaking();
    }
    if (motion()) {
        words(fmt::format("motion: {}, {} frames at {:.4g} fps", motion()->name, motion()->size(),
                          motion()->fps));
        if (button("close motion", "Leaves the pose that is shown."))
            attempt([&] {
                afterSaving("Closing the motion puts away what you edited, which is not saved.",
                            [this] { closeMotion(); });
            });
    }
    drawOpenedBefore();

    ImGui::Separator();
    words("Written into the folder that the viewer was started in, or as you name it here:");
    const ImGuiStyle& style = ImGui::GetStyle();
    ImGui::PushItemWidth(
        -(ImGui::CalcTextSize("choose a name").x + 2 * style.FramePadding.x + style.ItemSpacing.x));
    ImGui::InputTextWithHint("##name", "doppel", outText_.data(), outText_.size());
    noteItem("name");
    tip("Of films, pictures, glTF and poses, without an ending; a path or a folder, too. Where a "
        "name is taken it gets a number.");
    ImGui::PopItemWidth();
    ImGui::SameLine();
    if (button("choose a name", "A name and a folder, in the desktop's dialog." + std::string(none),
               asks))
        attempt([&] { chooseNameToWrite(); });
    drawFilmControls(!film_);
    const bool free = !export_;
    if (button("glTF, .glb", "Avatar and motion for other programs.", free))
        attempt([&] { startExport(nameToWrite("doppel", ".glb")); });
    beside("poses, .npz");
    if (button("poses, .npz", keys_.tip("The motion with what was edited", Action::Save)))
        attempt([&] { save(); });
    if (export_) hint("writing glTF ...");
    if (const SavedFile file = savedFile(); !file.path.empty())
        hint(keys_.keyOf(Action::Save) + " saves in " + file.path.filename().string());

    ImGui::Separator();
    const bool history = ImGui::CollapsingHeader("messages");
    noteItem("messages");
    tip("What was said so far, the latest first.");
    if (history)
        for (auto message = messages_.rbegin(); message != messages_.rend(); ++message)
            message->wrong ? words(message->text) : hint(message->text);
}

}  // namespace doppel
