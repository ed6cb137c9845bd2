// The program as a user meets it when something is wrong with the input: one line, the exit status
// that says whose fault it is, and no file that was not there before.
#include "tests/refusals.h"

namespace doppel {
namespace {

using namespace test;

// ---- the input is wrong -------------------------------------------------------------------------

TEST_F(Refusals, NothingIsWrongWithTheUnspoiled) {
    // Otherwise the cases below would prove little.
    for (const auto& words :
         {import(at("results/c")), fit(at("results/f")), train(at("results/a"), "fit,mesh,texture"),
          render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p"))}) {
        Outcome outcome = doppel(words);
        EXPECT_EQ(outcome.status, 0) << words[0] << "\n" << outcome.err;
    }
    EXPECT_TRUE(fs::exists(*this / "results/a/texture.png"));
    EXPECT_FALSE(fs::exists(*this / "results/a/checkpoints"));
}

TEST_F(Refusals, MasksMissingOrOfAnotherSize) {
    fs::path mask = *this / "capture/masks/f1.png", segmentation = *this / "source/segmentations";
    writeImage(mask, Image(kSize / 2, kSize, 1));
    writeImage(segmentation / "f1.png", Image(kSize / 2, kSize, 1));
    const char* size = "f1.png: expected 64×64 pixels, the size of its frame, found 32×64";
    refuses(import(at("results/c")), size, 2);
    refuses(fit(at("results/f")), size, 2);
    refuses(train(at("results/a"), "fit,mesh"), size, 2);
    refuses(eval(at("results/p")), size, 2);
    fs::remove(mask);
    fs::remove(segmentation / "f1.png");
    refuses(import(at("results/c")), "expected a mask for every picture, found none for f1", 2);
    refuses(fit(at("results/f")), "expected a mask for every frame, found none for f1", 2);
    refuses(train(at("results/a"), "mesh"), "expected a mask for every frame, found none", 2);
    fs::remove_all(*this / "capture/masks");
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "mesh"), eval(at("results/p"))})
        refuses(words, "found none for f0; bring them in with the source, or make them", 2);
    // A render needs masks for the background of its capture only, and says what it does without.
    const Outcome outcome = doppel(render(at("results/r")));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("it has no masks"), std::string::npos) << outcome.err;
}

TEST_F(Refusals, CodeInAPickle) {
    fs::path mark = *this / "hacked";
    std::string code = fmt::format("cos\nsystem\n(S'touch {}'\ntR.", mark.string());
    write(*this / "source/smpl_pose/f1.png_body.pkl", code);
    refuses(import(at("results/c")), "f1.png_body.pkl: refers to code (os.system)", 2);
    write(*this / "body.pkl", code);
    std::vector<std::string> words = fit(at("results/f"));
    words.insert(words.end(), {"--body", at("body.pkl")});
    refuses(words, "body.pkl: refers to code (os.system)", 2);
    EXPECT_FALSE(fs::exists(mark));
}

TEST_F(Refusals, PosesThatAreNotNumbers) {
    Npz poses = readNpz(*this / "capture/poses.npz");
    std::vector<float> body(69 * kFrames);
    body[69 + 4] = std::nanf("");
    poses.set("body_pose", Array::f32({kFrames, 69}, body));
    writeNpz(*this / "capture/poses.npz", poses, false);
    Theta theta{};
    theta[7] = std::nanf("");
    write(*this / "source/smpl_pose/f2.png_body.pkl", posePickle(theta, {0, 0, 3}));
    const char* sentence = "poses.npz: body_pose: expected finite numbers, found nan in frame 1";
    refuses(import(at("results/c")), "f2.png_body.pkl: pose: expected finite numbers, found nan",
            2);
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), render(at("results/r")),
          exporting(at("results/a.glb")), eval(at("results/p"))})
        refuses(words, sentence, 2);
}

TEST_F(Refusals, NoFrames) {
    for (const char* folder : {"source/images", "capture/images"})
        for (const auto& entry : fs::directory_iterator(*this / folder)) fs::remove(entry);
    refuses(import(at("results/c")), "expected one picture (.jpg, .png) or more, found none", 2);
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), eval(at("results/p"))})
        refuses(words, "capture", 2);
    // A motion without a pose.
    Npz poses;
    poses.set("global_orient", Array::f32({0, 3}, std::vector<float>()));
    poses.set("body_pose", Array::f32({0, 69}, std::vector<float>()));
    poses.set("transl", Array::f32({0, 3}, std::vector<float>()));
    writeNpz(*this / "none.npz", poses, false);
    for (auto words : {render(at("results/r")), exporting(at("results/a.glb"))}) {
        for (std::string& word : words)
            if (word == at("capture")) word = at("none.npz");
        refuses(words, "none.npz: global_orient: expected", 2);
    }
}

TEST_F(Refusals, FramesThatAreNotThere) {
    for (auto words :
         {import(at("results/c")), fit(at("results/f")), train(at("results/a"), "fit"),
          render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p"))}) {
        words.insert(words.end(), {"--frames", "2:9"});
        refuses(words, "--frames", 2);
    }
}

// What makes an avatar of what somebody has in its place, or where one lies.
TEST_F(Refusals, AClipInAnAvatarsPlace) {
    const auto with = [&](std::vector<std::string> words, const char* name) {
        for (std::string& word : words)
            if (word == at("avatar")) word = at(name);
        return words;
    };
    write(*this / "clip.mp4", "a film");
    fs::create_directory(*this / "person");
    fs::create_directory_symlink(*this / "avatar", *this / "person/avatar");
    for (const auto& words : {render(at("results/r")), exporting(at("results/a.glb"))}) {
        refuses(with(words, "clip.mp4"),
                "found none; `doppel avatar` makes one of a video or of pictures", 2);
        refuses(with(words, "person"), "found none; there is one in ", 2);
    }
}

TEST_F(Refusals, FilesCutShort) {
    // What each file is needed for.
    struct Cut {
        const char* file;
        std::vector<std::vector<std::string>> commands;
    };
    auto all = [&] {
        return std::vector<std::vector<std::string>>{fit(at("results/f")),
                                                     train(at("results/a"), "fit,mesh")};
    };
    auto shown = [&] {
        return std::vector<std::vector<std::string>>{
            render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p")),
            train(at("avatar"), "texture")};
    };
    std::vector<std::vector<std::string>> captures = all();
    captures.push_back(eval(at("results/p")));
    captures.push_back(render(at("results/r")));
    for (const Cut& cutting : {
             Cut{"source/images/f1.png", {import(at("results/c"))}},
             Cut{"source/segmentations/f1.png", {import(at("results/c"))}},
             Cut{"source/smpl_pose/f1.png_body.pkl", {import(at("results/c"))}},
             Cut{"capture/images/f1.png", captures},
             Cut{"capture/masks/f1.png", captures},
             Cut{"capture/poses.npz", captures},
             Cut{"capture/cameras.npz", captures},
             Cut{"avatar/avatar.toml", shown()},
             Cut{"avatar/body.npz", shown()},
             Cut{"avatar/mesh_net.safetensors", shown()},
             Cut{"avatar/texture_net.safetensors", shown()},
             Cut{"avatar/texture.png", shown()},
         }) {
        fs::path file = *this / cutting.file;
        std::string bytes = bytesOf(file);
        cut(file);
        for (const auto& words : cutting.commands)
            refuses(words, fs::path(cutting.file).filename().string() + ": ", 2, false);
        write(file, bytes);
    }
}

// What is left is a file that can be read, and its missing numbers would be the paper's.
TEST_F(Refusals, AnAvatarCutAtALinesEnd) {
    const fs::path file = *this / "avatar/avatar.toml";
    std::string bytes = bytesOf(file);
    for (int lines : {6, 30}) {  // a section without entries may be the last
        for (int i = 0; i < lines; ++i) bytes.resize(bytes.rfind('\n', bytes.size() - 2) + 1);
        write(file, bytes);
        for (const auto& words : {render(at("results/r")), train(at("avatar"), "texture")})
            refuses(words, "avatar.toml: expected ", 2);
    }
}

TEST_F(Refusals, PosesBeyondAllBounds) {
    Npz poses = readNpz(*this / "capture/poses.npz");
    std::vector<float> transl = poses.at("transl").toF32();
    transl[5] = 1e30f;
    poses.set("transl", Array::f32({kFrames, 3}, transl));
    writeNpz(*this / "capture/poses.npz", poses, false);
    write(*this / "source/smpl_pose/f2.png_body.pkl", posePickle(Theta{}, {0, 0, 1e30f}));
    const char* sentence =
        "poses.npz: transl: expected numbers from -1000000 to 1000000, found "
        "1e+30 in frame 1";
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), render(at("results/r")),
          exporting(at("results/a.glb")), eval(at("results/p"))})
        refuses(words, sentence, 2);
    refuses(import(at("results/c")), "1e+30", 2, false);
}

TEST_F(Refusals, NetworksThatAreNotNumbers) {
    Safetensors net = readSafetensors(*this / "avatar/texture_net.safetensors");
    net.tensors.begin()->second.values[0] = std::nanf("");
    writeSafetensors(*this / "avatar/texture_net.safetensors", net);
    const std::string sentence = "texture_net.safetensors: " + net.tensors.begin()->first +
                                 ": expected finite numbers, found nan in element 0";
    for (const auto& words : {render(at("results/r")), exporting(at("results/a.glb")),
                              eval(at("results/p")), train(at("avatar"), "refine")})
        refuses(words, sentence, 2);
}

TEST_F(Refusals, NamesThatLeadElsewhere) {
    for (const char* name : {"../../elsewhere", "/tmp/elsewhere", ".."})
        for (const char* key : {"motion", "actor"}) {
            write(*this / "capture/capture.toml", fmt::format("{} = \"{}\"\n", key, name));
            fs::create_directories(*this / "all/actor");
            fs::create_directory_symlink(*this / "capture", *this / "all/actor/motion");
            refuses({"eval", at("avatar"), at("all"), "--pictures", at("results/p")},
                    fmt::format("capture.toml: {}: expected a name without folder", key), 2);
            fs::remove_all(*this / "all");
        }
}

// Most commands meet no picture, and the library for them is slow to load.
TEST_F(Refusals, TheLibraryOfPicturesIsLoadedWithTheFirstPicture) {
    const auto loads = [](std::vector<std::string> words) {
        const std::vector<std::string> before{"env", "LD_DEBUG=files", program().string()};
        words.insert(words.begin(), before.begin(), before.end());
        const Outcome outcome = start(words);
        EXPECT_EQ(outcome.status, 0) << outcome.sentence();
        return outcome.err.find("libOpenImageIO.so") != std::string::npos;
    };
    EXPECT_FALSE(loads({"render", "--help"}));
    EXPECT_TRUE(loads(render(at("drawn"))));

    // A program that was copied without its module.
    fs::create_directory(*this / "alone");
    fs::copy_file(program(), *this / "alone/doppel");
    std::vector<std::string> words{
        "env", "DOPPEL_ASSETS=" + (test::sourceFolder() / "assets").string(), at("alone/doppel")};
    for (const std::string& word : render(at("other"))) words.push_back(word);
    const Outcome outcome = start(words);
    EXPECT_EQ(outcome.status, 1) << outcome.err;
    EXPECT_NE(outcome.sentence().find("doppel-pictures.so cannot be loaded ("), std::string::npos)
        << outcome.err;
}

}  // namespace
}  // namespace doppel
