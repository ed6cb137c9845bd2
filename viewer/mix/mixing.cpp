// The panel's "Mix": the avatar with the clothes, hair or head of others.
#include <GLFW/glfw3.h>

#include "engine/error.h"
#include "trainer/avatar/rendering.h"
#include "trainer/data/output_folder.h"
#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {
namespace fs = std::filesystem;

void Viewer::mixWith(const fs::path& folder) {
    mixer_.add(folder);
    opened(folder);
    if (mixer_.mixes()) beginMix();
    say(fmt::format("what {} wears can be taken in \"{}\"", folder.filename().string(), kMixTab));
}

void Viewer::takePart(size_t part, int giver) {
    mixer_.chosen.at(part) = giver;
    beginMix();
}

// That is not saved, by the names of parts.
std::map<std::string, std::string> Viewer::wornNow() const {
    std::map<std::string, std::string> worn;
    for (size_t part = 0; !mixSaved_ && part < kMixParts.size(); ++part)
        if (const int giver = mixer_.chosen[part]; giver > 0)
            worn[kMixParts[part].name] =
                absolutePath(mixer_.givers()[static_cast<size_t>(giver - 1)].folder);
    return worn;
}

void Viewer::wear(const std::map<std::string, std::string>& worn) {
    if (worn.empty()) return;
    Mixer::Choice chosen{};
    for (const auto& [name, folder] : worn) {
        const auto part = std::ranges::find(kMixParts, name, &MixPart::name);
        if (part == kMixParts.end()) throwInput("there is no part \"{}\" to be taken", name);
        const auto isIt = [&](const Mixer::Giver& giver) {
            return absolutePath(giver.folder) == folder;
        };
        if (std::ranges::none_of(mixer_.givers(), isIt)) mixer_.add(folder);
        chosen[static_cast<size_t>(part - kMixParts.begin())] =
            static_cast<int>(std::ranges::find_if(mixer_.givers(), isIt) -
                             mixer_.givers().begin()) +
            1;
    }
    mixer_.chosen = chosen;
    beginMix();
    mixSaved_ = false;  // nor is it while it is mixed
}

void Viewer::beginMix() {
    if (!mixer_.mixes()) {
        mixSaved_ = true;
        if (unmixed_) dress(std::exchange(unmixed_, nullptr));
        return;
    }
    if (!unmixed_ && !avatar_->textured) {
        mixer_.chosen = {};
        throwInput("{}: expected an avatar with a texture, which can be dressed, found none",
                   source_.folder().string());
    }
    if (!unmixed_) unmixed_ = avatar_;
    mixer_.begin(unmixed_, source_.folder());
}

void Viewer::dress(std::shared_ptr<LoadedAvatar> avatar) {
    const bool moves = avatar->avatar.betas != avatar_->avatar.betas;
    useAvatar(std::move(avatar));
    editor_->setOpenedBetas(avatar_->avatar.betas);
    settings_.texture = bestTexture();
    if (moves) fitMotionAgain();
}

void Viewer::advanceMix() {
    std::optional<Mixer::Mixed> mixed;
    try {
        mixed = mixer_.take();
    } catch (const InputError&) {
        // Nobody is dressed by halves.
        mixer_.chosen = {};
        beginMix();
        throw;
    }
    // It may have been undressed meanwhile.
    if (!mixed || !mixer_.mixes()) return;
    mixSaved_ = false;
    dress(std::move(mixed->avatar));
    if (!mixed->capsWorn)
        say("hair and loose cloth that hang free are left out: the texture has no room");
}

void Viewer::saveMix(const fs::path& out) {
    if (!unmixed_) throwInput("nothing is mixed that could be saved");
    if (mixSave_) throwInput("an avatar is being written already");
    std::error_code ignored;
    if (fs::exists(fs::symlink_status(out, ignored)))
        throwInput("{}: expected a new folder, found that there is one", out.string());
    mixSave_ = std::make_unique<ExportJob>();
    mixSave_->out = out;
    mixSaved_ = true;
    mixSave_->done = std::async(std::launch::async, [device = options_.device, loaded = avatar_,
                                                     betas = editor_->betas(), out] {
        OutputFolder folder(out, kAvatarKind);
        Avatar avatar = loaded->avatar;
        avatar.betas = betas;  // as it is shown
        writeAvatar(folder.folder(), avatar);
        Device drawing(device);
        writePreview(drawing, avatar, folder.folder() / "preview.png");
        folder.commit();
        glfwPostEmptyEvent();
    });
}

void Viewer::drawMixTab() {
    hint("This avatar with the clothes, hair or head of others that have the same body model.");
    const bool entered = pathField("Another avatar's folder; Enter takes from it.", pathText_,
                                   window_.keys()),
               named = pathText_[0] != 0;
    if ((button("take from", "The avatar in the folder of this name.", named) || entered) && named)
        attempt([&] { mixWith(typedPath(pathText_)); });
    beside("choose...");
    if (button("choose...",
               "Chooses another avatar; one that is dropped while this is open is one as well."))
        attempt([&] {
            askForFile(FileDialog::Asks::Folder, "Take from the avatar in",
                       [this](const fs::path& path) { mixWith(path); });
        });
    if (mixer_.givers().empty())
        return hint("nobody yet: name or choose an avatar, or drop its folder");
    std::vector<fs::path> folders;
    for (const Mixer::Giver& giver : mixer_.givers()) folders.push_back(giver.folder);
    const std::vector<std::string> names = namesOf(folders);
    std::vector<Choice> givers{{"its own", 0, "As the avatar was opened."}};
    for (size_t i = 0; i < names.size(); ++i)
        givers.push_back({names[i].c_str(), static_cast<int>(i) + 1, folders[i].native()});
    for (size_t p = 0; p < kMixParts.size(); ++p) {
        int giver = mixer_.chosen[p];
        if (choose(kMixParts[p].name, std::string(kMixParts[p].text) + ".", givers.data(),
                   givers.size(), giver))
            attempt([&] { takePart(p, giver); });
    }
    if (mixer_.busy()) hint("mixing ...");
    if (!unmixed_) return;
    if (button("as it was", "The avatar with nothing of others.")) {
        mixer_.chosen = {};
        attempt([&] { beginMix(); });
    }
    beside("save as a new avatar");
    if (button("save as a new avatar",
               "Writes mixed-1, or the next free number, into the folder that the viewer was "
               "started in, or NAME-mixed as \"Files\" names what is written.",
               unmixed_ && !mixer_.busy() && !mixSave_))
        attempt([&] { saveMix(nameToWrite("mixed", "-mixed")); });
    if (mixSave_) hint("writing the avatar ...");
}

}  // namespace doppel
