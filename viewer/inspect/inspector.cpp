// The panel's inspector: a click on the body tells what is known of that point of its surface.
#include <imgui.h>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

const char* originName(TexelOrigin origin) {
    switch (origin) {
        case kFromFrames:
            return "from frames that show it";
        case kFromOtherSide:
            return "from the body's other side: no frame shows it";
        case kFromNeighbours:
            return "from its neighbours: no frame shows it, nor its mirror image";
        default:
            return "none: it lies between the charts";
    }
}

void addRow(const char* name, const std::string& value) {
    ImGui::TableNextRow();
    ImGui::TableNextColumn();
    hint(name);
    ImGui::TableNextColumn();
    words(value);
}

}  // namespace

void Viewer::toggleInspector() {
    tabWanted_ = inspecting() ? "View" : kInspectTab;
    settings_.panel = true;
}

void Viewer::inspectAt(double x, double y) {
    const Pane* pane = paneAt(x, y);
    if (!pane || pane->other) return;
    const Camera camera = cameraOf(*pane);
    const double scale = window_.scale();
    const glm::dvec3 ray((x * scale - pane->x - camera.cx) / camera.fx,
                         (y * scale - pane->y - camera.cy) / camera.fy, 1);
    const auto hit = nearestHit(scene_->vertices(pane->mesh, view()), avatar_->avatar.body.faces,
                                glm::dvec3(0), ray);
    inspected_ = hit ? inspect(avatar_->avatar, hit->point) : std::nullopt;
}

// Takes the sightings that were found, and looks for those of another point, motion or avatar.
void Viewer::followInspected() {
    const OpenedMotion* opened = openedMotion();
    const bool plays = opened && !opened->trained.empty();
    const TrainedOn* own = inspected_ && !plays ? trainedOnCapture() : nullptr;
    const bool known = inspected_ && (plays || own);
    const std::shared_ptr<const Motion> of = plays ? editor_->motion() : nullptr;
    const bool same = known && searched_.point == inspected_->point &&
                      searched_.motion.lock() == of && searched_.avatar.lock() == avatar_;
    if (!same) {
        search_.reset();
        sightings_.reset();
        searched_ = {};
        if (!known) return;
        searched_ = {inspected_->point, of, avatar_};
        search_ = std::make_unique<SightingSearch>(
            options_.device, std::shared_ptr<const Avatar>(avatar_, &avatar_->avatar),
            plays ? opened->trained : own->frames, plays ? motion()->cameras : own->cameras,
            inspected_->point);
    } else if (search_ && !search_->busy()) {
        const std::unique_ptr<SightingSearch> done = std::move(search_);
        sightings_ = done->take();
        framesToDraw_ = std::max(framesToDraw_, 1);
    }
}

// Null where it is not there any more.
const TrainedOn* Viewer::trainedOnCapture() {
    if (trainedOnOf_.lock() != avatar_) {
        trainedOnOf_ = avatar_;
        trainedOn_ = trainedOn(source_.folder(), avatar_->avatar);
    }
    return trainedOn_ ? &*trainedOn_ : nullptr;
}

// As the frame's own camera saw it, over its picture where that is open. Where another motion plays
// the capture of the training takes its place.
void Viewer::seeFrame(size_t frame) {
    if (searched_.motion.expired() && trainedOn_) {
        const std::filesystem::path capture = trainedOn_->capture;
        afterSaving(
            "Opening the capture of the training puts away what you edited, which is not "
            "saved.",
            [this, capture, frame] {
                loadMotion(capture);
                searched_.motion = editor_->motion();
                seeFrame(frame);
            });
        return;
    }
    play(false);
    timeline_ = static_cast<double>(frame);
    settings_.captureCamera = true;
    showFrames();
}

void Viewer::drawInspectTab() {
    if (!inspected_) {
        hint("Click on the body.");
        return;
    }
    const Inspected& at = *inspected_;
    const int size = avatar_->avatar.textureSize;
    if (ImGui::BeginTable("inspected", 2)) {
        ImGui::TableSetupColumn("what", ImGuiTableColumnFlags_WidthFixed,
                                std::ceil(ImGui::CalcTextSize("first colour").x));
        ImGui::TableSetupColumn("value", ImGuiTableColumnFlags_WidthStretch);
        addRow("vertex", fmt::format("{}", at.vertex));
        addRow("part", partName(at.part));
        addRow("UV", fmt::format("{:.4f}, {:.4f}", at.uv.x, at.uv.y));
        addRow("texel", fmt::format("{}, {} of {} x {}", at.texel.x, at.texel.y, size, size));
        addRow("K(v)", fmt::format("{:.1f} mm", 1e3 * at.bound));
        addRow("first colour",
               at.origin ? originName(*at.origin) : "not known: the avatar has no texels_seen.png");
        if (search_)
            addRow("seen", "counting the frames ...");
        else if (!sightings_)
            addRow(
                "seen",
                "not known: neither what plays nor what lies beside the avatar is the capture that "
                "it was trained on; open that");
        else
            addRow("seen", fmt::format("in {} of {} training frames{}", sightings_->seen,
                                       sightings_->frames,
                                       sightings_->best
                                           ? fmt::format(", largest in frame {}", *sightings_->best)
                                           : std::string()));
        ImGui::EndTable();
    }
    if (sightings_ && sightings_->best &&
        button("see that frame",
               "Goes there, through the capture's camera; opens the capture where that does not "
               "play."))
        attempt([&] { seeFrame(*sightings_->best); });
    hint(
        "Seen: the poses that training found have it in the picture, turned to the camera, with "
        "nothing of the body before it.");
}

// Also where the body hides it, for it is to be found again.
void Viewer::drawInspected(const Pane& pane) const {
    if (!inspected_) return;
    const std::vector<float> verts = scene_->vertices(pane.mesh);
    const glm::dvec3 at =
        onScreen(placeOf(inspected_->point, verts, avatar_->avatar.body.faces), pane);
    if (at.z <= 0) return;
    const ImVec2 centre{static_cast<float>(at.x), static_cast<float>(at.y)};
    const auto unit = static_cast<float>(window_.unit());
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    for (const auto& [colour, thick] :
         {std::pair{IM_COL32(0, 0, 0, 200), 4.f}, {IM_COL32(255, 255, 255, 255), 2.f}}) {
        list.AddCircle(centre, 7 * unit, colour, 0, thick * unit);
        list.AddCircleFilled(centre, .5f * thick * unit, colour);
    }
}

}  // namespace doppel
