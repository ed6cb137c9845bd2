// The avatar with what others wear, in the window.
#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

class MixTest : public ViewerTest {
protected:
    // Blue all over, and larger.
    fs::path blue() {
        Avatar avatar = plainAvatar();
        for (size_t i = 0; i < avatar.texture.size(); ++i)
            avatar.texture[i] = i % 3 == 2 ? .9f : .1f;
        avatar.betas[0] += 2;
        writeAvatar(*folder_ / "blue", avatar);
        return *folder_ / "blue";
    }
    Viewer& openPlain() {
        writeAvatar(*folder_ / "plain", plainAvatar());
        ViewerOptions options;
        options.avatar = *folder_ / "plain";
        Viewer& viewer = open(options);
        viewer.settings().joints = false;
        return viewer;
    }
    static size_t partNamed(std::string_view name) {
        return size_t(std::ranges::find(kMixParts, name, &MixPart::name) - kMixParts.begin());
    }
    void work() {
        for (int i = 0; i < 500 && viewer_->working(); ++i) viewer_->frame();
        ASSERT_FALSE(viewer_->working());
    }
};

TEST_F(MixTest, WhatAnotherWearsIsTakenShownAndSaved) {
    Viewer& viewer = openPlain();
    const Image before = picture();
    const Pose pose = viewer.editor().pose();
    viewer.mixWith(blue());
    viewer.takePart(partNamed("top"), 1);
    settle();
    const Avatar plain = readAvatar(*folder_ / "plain"), other = readAvatar(*folder_ / "blue");
    const Mix expected = mixAvatars({.base = &plain, .top = &other});
    EXPECT_EQ(viewer.avatar().texture, expected.avatar.texture);
    EXPECT_GT(difference(picture(), before), .005);
    EXPECT_EQ(viewer.editor().pose(), pose) << "pose and view stay";

    viewer.takePart(partNamed("shape"), 1);
    settle();
    EXPECT_EQ(viewer.avatar().betas, other.betas);
    EXPECT_EQ(viewer.editor().betas(), other.betas);

    const fs::path out = *folder_ / "mixed";
    viewer.saveMix(out);
    work();
    EXPECT_NE(viewer.message().find("avatar in"), std::string::npos) << viewer.message();
    const Avatar saved = readAvatar(out);
    EXPECT_EQ(saved.betas, other.betas);
    EXPECT_EQ(saved.provenance.at("top"), (*folder_ / "blue").string());
    EXPECT_TRUE(fs::exists(out / "preview.png"));
    EXPECT_NE(messageOf<InputError>([&] { viewer.saveMix(out); }).find("expected a new folder"),
              std::string::npos);

    // Undressed it is what it was.
    viewer.takePart(partNamed("top"), 0);
    viewer.takePart(partNamed("shape"), 0);
    settle();
    EXPECT_EQ(viewer.avatar().texture, plain.texture);
    for (int i = 0; i < 100 && viewer.visibleMessages() > 0; ++i) turn(1);
    settle();
    EXPECT_LT(difference(picture(), before), .02);
    EXPECT_NE(messageOf<InputError>([&] { viewer.saveMix(*folder_ / "none"); }).find("nothing"),
              std::string::npos);
}

// What is mixed and not saved outlives its window, as edits do.
TEST_F(MixTest, WhatIsMixedComesBack) {
    writeAvatar(*folder_ / "plain", plainAvatar());
    ViewerOptions options;
    options.avatar = *folder_ / "plain";
    options.state = *folder_ / "state";
    const auto sessions = [&] {
        size_t count = 0;
        for (const auto& entry : fs::directory_iterator(options.state / "sessions"))
            count += entry.path().extension() == ".json";
        return count;
    };
    open(options);
    viewer_->mixWith(blue());
    viewer_->takePart(partNamed("top"), 1);
    settle();
    const std::vector<float> mixed = viewer_->avatar().texture;
    viewer_.reset();  // without a question asked, as where an error ends it

    open(options);
    EXPECT_NE(viewer_->question().find("saved: what it wears of others."), std::string::npos)
        << viewer_->question();
    viewer_->answer("Bring it back");
    settle();
    EXPECT_EQ(viewer_->avatar().texture, mixed);
    EXPECT_FALSE(viewer_->editor().modified()) << "no pose was edited";
    viewer_->saveMix(*folder_ / "dressed");
    work();
    turn();
    EXPECT_EQ(sessions(), 0u) << "what is saved needs no keeping";

    // Whoever gave it may be gone; then it waits.
    viewer_->takePart(partNamed("bottom"), 1);
    settle();
    viewer_.reset();
    fs::rename(*folder_ / "blue", *folder_ / "away");
    open(options);
    viewer_->answer("Bring it back");
    settle();
    EXPECT_NE(viewer_->message().find("not what was taken of others"), std::string::npos)
        << viewer_->message();
    EXPECT_EQ(viewer_->avatar().texture, readAvatar(*folder_ / "plain").texture);
    EXPECT_EQ(sessions(), 1u);
    viewer_.reset();
    fs::rename(*folder_ / "away", *folder_ / "blue");
    open(options);
    EXPECT_NE(viewer_->question(), "");
    viewer_->answer("Throw it away");
    settle();
    EXPECT_EQ(sessions(), 0u);
}

TEST_F(MixTest, ThePanelChoosesWhoGivesWhat) {
    Viewer& viewer = openPlain();
    viewer.settings().panel = true;
    settle();
    clickItem("Mix");
    EXPECT_EQ(viewer.panelWidth() > 0, true);
    itemAt("nobody yet: name or choose an avatar, or drop its folder");
    // An avatar that comes while this is open gives something, and is not opened.
    viewer.openFile(blue());
    settle();
    clickItem("bottom");
    clickItem("blue");
    EXPECT_NE(viewer.avatar().texture, readAvatar(*folder_ / "plain").texture);
    itemAt("save as a new avatar");
    clickItem("as it was");
    EXPECT_EQ(viewer.avatar().texture, readAvatar(*folder_ / "plain").texture);
}

TEST_F(MixTest, ThePanelNamesTheNewAvatar) {
    writeAvatar(*folder_ / "plain", plainAvatar());
    ViewerOptions options;
    options.avatar = *folder_ / "plain";
    options.width = 900, options.height = 750;
    Viewer& viewer = open(options);
    viewer.mixWith(blue());
    viewer.takePart(partNamed("top"), 1);
    viewer.settings().panel = true;
    settle();
    clickItem("Files");
    clickItem("name");
    type((*folder_ / "anna").string());
    for (const char* out : {"anna-mixed", "anna-mixed-1"}) {
        clickItem("Mix");
        clickItem("save as a new avatar");
        work();
        EXPECT_TRUE(fs::exists(*folder_ / out / "avatar.toml")) << viewer.message();
    }
}

TEST_F(MixTest, WhatIsNotSavedIsAskedAbout) {
    Viewer& viewer = openPlain();
    viewer.mixWith(blue());
    viewer.takePart(partNamed("top"), 1);
    settle();
    const auto mixed = viewer.avatar().texture;
    viewer.openFile(*folder_ / "plain");
    settle();
    ASSERT_FALSE(viewer.question().empty());
    EXPECT_EQ(viewer.avatar().texture, mixed);
    viewer.answer("Cancel");
    EXPECT_EQ(viewer.avatar().texture, mixed);
    // Saved, it may be put away.
    viewer.saveMix(*folder_ / "kept");
    work();
    viewer.openFile(*folder_ / "plain");
    EXPECT_TRUE(viewer.question().empty());
    EXPECT_EQ(viewer.avatar().texture, readAvatar(*folder_ / "plain").texture);
    EXPECT_EQ(readAvatar(*folder_ / "kept").provenance.at("top"), (*folder_ / "blue").string());

    viewer.mixWith(*folder_ / "blue");
    viewer.takePart(partNamed("shape"), 1);
    settle();
    viewer.openFile(*folder_ / "plain");
    viewer.answer("Do not save");
    EXPECT_EQ(viewer.avatar().texture, readAvatar(*folder_ / "plain").texture);
    EXPECT_EQ(viewer.editor().betas()[0], readAvatar(*folder_ / "plain").betas[0]);

    // A base without a texture cannot be dressed.
    Avatar bare = plainAvatar();
    bare.texture.clear();
    bare.textureSize = 0;
    writeAvatar(*folder_ / "bare", bare);
    viewer.openFile(*folder_ / "bare");
    EXPECT_NE(messageOf<InputError>([&] {
                  viewer.takePart(partNamed("top"), 1);
              }).find("bare: expected an avatar with a texture"),
              std::string::npos);
}

TEST_F(MixTest, WhoHasNoTextureGivesNothing) {
    Viewer& viewer = openPlain();
    Avatar other = plainAvatar();
    const fs::path folder = *folder_ / "untextured";
    other.texture.clear();
    other.textureSize = 0;
    writeAvatar(folder, other);
    EXPECT_NE(messageOf<InputError>([&] { viewer.mixWith(folder); }).find("with a texture"),
              std::string::npos);
    EXPECT_EQ(viewer.avatar().texture, readAvatar(*folder_ / "plain").texture);
}

}  // namespace
}  // namespace doppel::test
