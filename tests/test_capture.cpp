#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "trainer/data/capture.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/pictures/crop.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

constexpr int kWidth = 40, kHeight = 30;

Camera smallCamera() { return {60, 62, 19.5, 15.25, kWidth, kHeight}; }

void writePicture(const fs::path& path, int width, int height, int channels, uint8_t fill) {
    fs::create_directories(path.parent_path());
    writeImage(path, Image(width, height, channels, fill));
}

void writeCameras(const fs::path& folder, const std::vector<double>& extrinsic = {}) {
    Npz npz;
    npz.set("intrinsic",
            Array::f64({3, 3}, std::vector<double>{60, 0, 19.5, 0, 62, 15.25, 0, 0, 1}));
    npz.set("height", Array::scalarI64(kHeight));
    npz.set("width", Array::scalarI64(kWidth));
    if (!extrinsic.empty()) npz.set("extrinsic", Array::f64({4, 4}, extrinsic));
    writeNpz(folder / "cameras.npz", npz, false);
}

struct PoseValues {
    std::vector<float> betas = std::vector<float>(10, .5f), orient, body, transl;
    explicit PoseValues(size_t frames) {
        for (size_t f = 0; f < frames; ++f) {
            orient.insert(orient.end(), {3.1f, .1f * float(f), 0});
            for (size_t i = 0; i < 69; ++i) body.push_back(.01f * float(i) - .2f * float(f));
            transl.insert(transl.end(), {.1f * float(f), .2f, 3});
        }
    }
    void write(const fs::path& path) const {
        const auto rows = [](const std::vector<float>& v, size_t n) {
            return int64_t(v.size() / n);
        };
        Npz npz;
        npz.set("betas", Array::f32({10}, betas));
        npz.set("global_orient", Array::f32({rows(orient, 3), 3}, orient));
        npz.set("body_pose", Array::f32({rows(body, 69), 69}, body));
        npz.set("transl", Array::f32({rows(transl, 3), 3}, transl));
        writeNpz(path, npz, false);
    }
};

// Frames f1 .. f<count> as another program would write them: no capture.toml.
void writeForeignCapture(const fs::path& folder, int count) {
    for (int i = 1; i <= count; ++i) {
        const std::string name = fmt::format("f{}.png", i);
        writePicture(folder / "images" / name, kWidth, kHeight, 3, uint8_t(i));
        writePicture(folder / "masks" / name, kWidth, kHeight, 1, i % 2 ? 255 : 0);
    }
    writeCameras(folder);
    PoseValues(size_t(count)).write(folder / "poses.npz");
}

TEST(Capture, ReadsAnotherProgramsFolder) {
    Folder folder;
    writeForeignCapture(folder.path(), 11);
    const Capture capture = readCapture(folder.path());
    ASSERT_EQ(capture.size(), 11u);
    // In the order of the numbers, not of the letters.
    EXPECT_EQ(capture.frames[1].name, "f2");
    EXPECT_EQ(capture.frames[9].name, "f10");
    EXPECT_EQ(capture.fps, 30);
    EXPECT_EQ(capture.name, folder.path().filename().string());
    EXPECT_EQ(capture.frames[3].camera, smallCamera());
    EXPECT_TRUE(capture.hasMasks());
    EXPECT_FLOAT_EQ(capture.theta[2][1], .2f);
    EXPECT_FLOAT_EQ(capture.theta[2][3 + 68], .68f - .4f);
    EXPECT_FLOAT_EQ(capture.trans[10][0], 1.f);

    FrameCache cache(capture);
    const auto picture = cache.load(4);
    EXPECT_EQ(picture->width, kWidth);
    EXPECT_EQ(picture->rgb.at(7), 5);
    EXPECT_EQ(picture->mask.at(11), 255);
    EXPECT_EQ(cache.load(5)->mask.at(11), 0);

    // Who needs no colours decodes none, unless they are there.
    FrameCache masks(capture);
    EXPECT_TRUE(masks.loadMask(4)->rgb.empty());
    EXPECT_EQ(masks.loadMask(4)->mask, picture->mask);
    EXPECT_EQ(masks.load(4)->rgb, picture->rgb);
    EXPECT_EQ(masks.load(4)->mask, picture->mask);
    EXPECT_EQ(cache.loadMask(4), picture);
}

TEST(Capture, FoldsTheExtrinsicIntoThePoses) {
    Folder folder;
    writeForeignCapture(folder.path(), 2);
    // A turn about y by .7, then about x by 3 (near the half turn), and a step.
    const double cy = std::cos(.7), sy = std::sin(.7), cx = std::cos(3.), sx = std::sin(3.);
    const double r[3][3] = {{cy, 0, sy}, {sx * sy, cx, -sx * cy}, {-cx * sy, sx, cx * cy}};
    const double t[3] = {.3, -.1, 4};
    std::vector<double> extrinsic(16, 0.);
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 3; ++j) extrinsic[4 * i + j] = r[i][j];
        extrinsic[4 * i + 3] = t[i];
    }
    extrinsic[15] = 1;
    const Capture world = readCapture(folder.path());
    writeCameras(folder.path(), extrinsic);
    const Capture camera = readCapture(folder.path());

    // A point of the rest pose, moved by the root's rotation as SMPL does it.
    const std::array<double, 3> pelvis{0, -.223, .028}, point{.3, .4, -.2};
    const auto posed = [&](const Capture& c, size_t f) {
        const double x = c.theta[f][0], y = c.theta[f][1], z = c.theta[f][2];
        const double a = std::sqrt(x * x + y * y + z * z);
        const double k[3] = {x / a, y / a, z / a};
        double v[3], result[3], dot = 0;
        for (size_t i = 0; i < 3; ++i) v[i] = point[i] - pelvis[i], dot += k[i] * v[i];
        const double cross[3] = {k[1] * v[2] - k[2] * v[1], k[2] * v[0] - k[0] * v[2],
                                 k[0] * v[1] - k[1] * v[0]};
        for (size_t i = 0; i < 3; ++i) {
            result[i] = v[i] * std::cos(a) + cross[i] * std::sin(a) +
                        k[i] * dot * (1 - std::cos(a)) + pelvis[i] + double(c.trans[f][i]);
        }
        return std::array<double, 3>{result[0], result[1], result[2]};
    };
    for (size_t f = 0; f < 2; ++f) {
        const auto before = posed(world, f), after = posed(camera, f);
        for (size_t i = 0; i < 3; ++i) {
            const double expected =
                r[i][0] * before[0] + r[i][1] * before[1] + r[i][2] * before[2] + t[i];
            EXPECT_NEAR(after[i], expected, 2e-6) << "frame " << f << " axis " << i;
        }
        EXPECT_EQ(camera.theta[f][5], world.theta[f][5]);
    }

    extrinsic[0] = 3;
    writeCameras(folder.path(), extrinsic);
    EXPECT_NE(messageOf<InputError>([&] {
                  readCapture(folder.path());
              }).find("cameras.npz: extrinsic: expected a rotation"),
              std::string::npos);
}

TEST(Capture, WritesWhatItReads) {
    Folder folder;
    writeForeignCapture(folder / "in", 4);
    Capture capture = readCapture(folder / "in");
    capture.name = "a \"name\"";
    capture.fps = 12.5;
    capture.source["kind"] = "test\nlayout";
    capture.sourceBetas = Betas{1, 2, 3};
    capture.keypoints = Keypoints{"lsp19", 19, std::vector<float>(4 * 19 * 3, .25f)};
    capture.keypoints->values[19 * 3 + 1] = 7;
    capture.faces.resize(4);
    capture.faces[3].assign(kFacePoints, {1, 2, .5f});
    const std::vector<size_t> picked{1, 3};
    const Capture written = writeCapture(capture.subset(picked), folder / "new" / "out");
    const Capture read = readCapture(folder / "new" / "out");
    for (const Capture& c : {written, read}) {
        ASSERT_EQ(c.size(), 2u);
        EXPECT_EQ(c.name, "a \"name\"");
        EXPECT_EQ(c.fps, 6.25);  // each second frame, at the same speed
        EXPECT_EQ(c.frames[0].name, "f2");
        EXPECT_EQ(c.frames[1].camera, smallCamera());
        EXPECT_EQ(c.theta[1], capture.theta[3]);
        EXPECT_EQ(c.trans[1], capture.trans[3]);
        EXPECT_EQ(c.betas, capture.betas);
        EXPECT_EQ(c.source.at("kind"), "test\nlayout");
        EXPECT_EQ(*c.sourceBetas, (Betas{1, 2, 3}));
        ASSERT_TRUE(c.keypoints);
        EXPECT_EQ(c.keypoints->values[1], 7);
        ASSERT_EQ(c.faces.size(), 2u);
        EXPECT_TRUE(c.faces[0].empty());
        EXPECT_EQ(c.faces[1], capture.faces[3]);
        EXPECT_TRUE(c.hasMasks());
        EXPECT_EQ(FrameCache(c).load(1)->rgb[0], 4);
    }
    EXPECT_EQ(fs::canonical(written.folder), fs::canonical(folder / "new" / "out"));
    // Relative to where we are, with a slash at the end.
    const fs::path before = fs::current_path();
    fs::current_path(folder.path());
    const Capture here = writeCapture(read, "here/");
    EXPECT_EQ(fs::canonical(here.folder), fs::canonical(folder / "here"));
    fs::current_path(before);
    // Over itself, pictures and all, and nothing beside it.
    writeCapture(read, folder / "new" / "out");
    EXPECT_EQ(readCapture(folder / "new" / "out").size(), 2u);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder / "new"), fs::directory_iterator()), 1);
}

TEST(Capture, WritesPicturesFromMemory) {
    Folder folder;
    Capture capture;
    capture.name = "drawn";
    CaptureWriter writer(folder / "out");
    std::vector<uint8_t> rgb(size_t(kWidth * kHeight * 3), 9), mask(size_t(kWidth * kHeight), 0);
    mask[5] = 1;
    for (const char* name : {"a", "b"}) {
        Frame frame{name, {}, {}, smallCamera()};
        frame.camera.fx += name[0];  // one camera per frame
        capture.frames.push_back(frame);
        capture.theta.push_back({});
        capture.trans.push_back({0, 0, 3});
        writer.addImage(name, kWidth, kHeight, rgb);
        writer.addMask(name, kWidth, kHeight, mask);
    }
    EXPECT_FALSE(fs::exists(folder / "out"));
    const Capture written = writer.commit(capture);
    EXPECT_EQ(written.frames[1].camera.fx, 60 + 'b');
    const auto picture = FrameCache(written).load(0);
    EXPECT_EQ(picture->mask[5], 255);
    EXPECT_EQ(picture->mask[6], 0);
}

TEST(Capture, LeavesNothingHalfWritten) {
    Folder folder;
    writeForeignCapture(folder / "in", 2);
    Capture capture = readCapture(folder / "in");
    {
        CaptureWriter writer(folder / "out");
        writer.copyImage("f1", capture.frames[0].image);
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"in"});

    // A pose that could not be read back: refused, under the name that was asked for.
    capture.theta[1][7] = std::numeric_limits<float>::quiet_NaN();
    EXPECT_EQ(messageOf<InputError>([&] { writeCapture(capture, folder / "out"); }),
              fmt::format("{}: body_pose: expected finite numbers, found nan in frame 1, element 4",
                          (fs::canonical(folder.path()) / "out/poses.npz").string()));
    EXPECT_EQ(folder.names(), std::vector<std::string>{"in"});

    // Somebody's files, and a file.
    fs::create_directories(folder / "theirs");
    folder.write("theirs/notes.txt", "x");
    EXPECT_NE(messageOf<InputError>([&] {
                  writeCapture(capture, folder / "theirs");
              }).find("expected an empty folder or one that Doppel wrote as capture"),
              std::string::npos);
    folder.write("file", "x");
    EXPECT_NE(messageOf<InputError>([&] {
                  writeCapture(capture, folder / "file");
              }).find("expected a folder or nothing, found a file"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  writeCapture(capture, folder / "file" / "out");
              }).find("a file in the way"),
              std::string::npos);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"file", "in", "theirs"}));
}

TEST(Capture, SaysWhereTheSystemRefuses) {
    if (geteuid() == 0) {
        // For root, who may write anywhere: a file system that takes no files.
        if (!fs::is_directory("/proc/self")) GTEST_SKIP() << "no /proc here";
        EXPECT_NE(messageOf<MachineError>([&] {
                      CaptureWriter writer("/proc/self/out");
                  }).find("/out: cannot be written: "),
                  std::string::npos);
        return;
    }
    Folder folder;
    fs::create_directories(folder / "locked");
    chmod((folder / "locked").c_str(), 0555);
    EXPECT_NE(messageOf<MachineError>([&] {
                  CaptureWriter writer(folder / "locked" / "out");
              }).find("cannot be written: Permission denied"),
              std::string::npos);
    chmod((folder / "locked").c_str(), 0755);
}

TEST(Capture, SaysWhatIsWrong) {
    Folder folder;
    const fs::path c = folder / "c";
    // Each case spoils a good capture in one way.
    const auto expect = [&](const std::string& sentence, const auto& spoil) {
        fs::remove_all(c);
        writeForeignCapture(c, 3);
        spoil();
        const std::string found = messageOf<InputError>([&] { readCapture(c); });
        EXPECT_NE(found.find(sentence), std::string::npos) << found;
        EXPECT_EQ(found.find('\n'), std::string::npos) << found;
    };
    expect(
        "c: expected a capture's folder, found nothing; `doppel import` makes a capture of a video",
        [&] { fs::remove_all(c); });
    expect("c/images: expected a capture's pictures, found nothing",
           [&] { fs::remove_all(c / "images"); });
    expect("c/images: expected one picture (.png, .jpg) or more, found none", [&] {
        fs::remove_all(c / "images");
        fs::create_directories(c / "images");
    });
    expect("c/masks: expected a mask for every frame, found none for f2",
           [&] { fs::remove(c / "masks/f2.png"); });
    expect("c/masks/f3.png: expected 40×30 pixels, the size of its frame, found 20×30",
           [&] { writePicture(c / "masks/f3.png", 20, 30, 1, 0); });
    expect("c/images/f1.png: expected 40×30 pixels, the size of cameras.npz, found 41×30",
           [&] { writePicture(c / "images/f1.png", 41, 30, 3, 0); });
    expect("c/images/f2.png", [&] { fs::resize_file(c / "images/f2.png", 20); });
    expect("c/poses.npz: global_orient: expected 3 rows, as many as there are frames, found 2",
           [&] { PoseValues(2).write(c / "poses.npz"); });
    expect("c/poses.npz: body_pose: expected finite numbers, found nan in frame 2, element 1", [&] {
        PoseValues values(3);
        values.body[2 * 69 + 1] = std::nanf("");
        values.write(c / "poses.npz");
    });
    expect("c/poses.npz: transl: expected finite numbers, found inf in frame 0, element 2", [&] {
        PoseValues values(3);
        values.transl[2] = std::numeric_limits<float>::infinity();
        values.write(c / "poses.npz");
    });
    expect("c/poses.npz: body_pose: expected 3 rows, as many as global_orient has, found 4", [&] {
        PoseValues values(3);
        values.body.resize(4 * 69);
        values.write(c / "poses.npz");
    });
    expect("c/poses.npz", [&] { fs::resize_file(c / "poses.npz", 300); });
    expect("c/poses.npz: expected this file of a capture, found none; docs/formats.md",
           [&] { fs::remove(c / "poses.npz"); });
    expect("c/cameras.npz: intrinsic: expected [fx 0 cx; 0 fy cy; 0 0 1]", [&] {
        Npz npz = readNpz(c / "cameras.npz");
        npz.set("intrinsic", Array::f64({3, 3}, std::vector<double>(9, 1.)));
        writeNpz(c / "cameras.npz", npz, false);
    });
    expect("c/cameras.npz: expected this file of a capture, found none; docs/formats.md",
           [&] { fs::remove(c / "cameras.npz"); });
    expect("c/capture.toml: frames: expected each name once, found \"f1\" twice",
           [&] { folder.write("c/capture.toml", "frames = [\"f1\", \"f1\"]"); });
    // What becomes a part of a path.
    for (const char* name : {"../f1", "..", ".", "", "/f1", "a/b", "a\\\\b", ".f1", "a\\nb"}) {
        const std::string quoted = fmt::format("\"{}\"", name);
        expect("c/capture.toml: frames: expected a name without folder",
               [&] { folder.write("c/capture.toml", "frames = [" + quoted + "]"); });
        if (*name == '\0') continue;
        expect("c/capture.toml: actor: expected a name without folder",
               [&] { folder.write("c/capture.toml", "actor = " + quoted); });
        expect("c/capture.toml: motion: expected a name without folder",
               [&] { folder.write("c/capture.toml", "motion = " + quoted); });
    }
    expect("c/capture.toml: motion: expected a name without folder, of 200 bytes at most", [&] {
        folder.write("c/capture.toml", fmt::format("motion = \"{}\"", std::string(201, 'x')));
    });
    expect("c/images: expected a name without folder",
           [&] { writePicture(c / "images/a\nb.png", 40, 30, 3, 0); });
    // Numbers of which nothing is left in single precision.
    expect("c/poses.npz: transl: expected numbers from -1000000 to 1000000, found 1e+30 in frame 1",
           [&] {
               PoseValues values(3);
               values.transl[5] = 1e30f;
               values.write(c / "poses.npz");
           });
    expect("c/poses.npz: body_pose: expected numbers from -10000 to 10000, found -1e+20", [&] {
        PoseValues values(3);
        values.body[7] = -1e20f;
        values.write(c / "poses.npz");
    });
    expect("c/poses.npz: betas: expected numbers from -1000 to 1000, found 1000000000", [&] {
        PoseValues values(3);
        values.betas[1] = 1e9f;
        values.write(c / "poses.npz");
    });
    expect("c/cameras.npz: extrinsic: expected a translation", [&] {
        writeCameras(c, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1e300, 0, 0, 0, 1});
    });
    expect("c/cameras.npz: intrinsic: expected numbers from -10000000 to 10000000, found 1e+300",
           [&] {
               Npz npz = readNpz(c / "cameras.npz");
               npz.set("intrinsic",
                       Array::f64({3, 3}, std::vector<double>{1e300, 0, 0, 0, 1, 0, 0, 0, 1}));
               writeNpz(c / "cameras.npz", npz, false);
           });
    expect("c/capture.toml: line 2: not TOML",
           [&] { folder.write("c/capture.toml", "fps = 25\nname = "); });
    expect("c/capture.toml: fps: expected frames per second, from 0 to 10000, found -1",
           [&] { folder.write("c/capture.toml", "fps = -1"); });
    expect("c/keypoints.npy: expected 3 frames, as images/ has, found 2", [&] {
        writeNpy(c / "keypoints.npy", Array::f32({2, 25, 3}, std::vector<float>(150)));
    });
    expect("c/faces.npy: expected shape [3, 468, 3]", [&] {
        writeNpy(c / "faces.npy", Array::f32({3, 25, 3}, std::vector<float>(225)));
    });
    expect("c/faces.npy: expected pixels from -1e+07 to 1e+07, found 1e+30", [&] {
        std::vector<float> values(3 * kFacePoints * 3);
        values[4] = 1e30f;
        writeNpy(c / "faces.npy", Array::f32({3, kFacePoints, 3}, values));
    });
    expect("c/keypoints.npy: expected confidences from 0 to 2, found -1", [&] {
        std::vector<float> values(225);
        values[2] = -1;
        writeNpy(c / "keypoints.npy", Array::f32({3, 25, 3}, values));
    });
    expect("c/faces.npy", [&] {
        std::vector<float> values(3 * kFacePoints * 3);
        values[5] = NAN;
        writeNpy(c / "faces.npy", Array::f32({3, kFacePoints, 3}, values));
    });
    expect("c/keypoints.npy: expected 25 keypoints (openpose25) or 19 (lsp19)", [&] {
        writeNpy(c / "keypoints.npy", Array::f32({3, 5, 3}, std::vector<float>(45)));
    });
    expect("c/keypoints.npy: expected 25 keypoints for the scheme openpose25, found 19", [&] {
        writeNpy(c / "keypoints.npy", Array::f32({3, 19, 3}, std::vector<float>(171)));
        folder.write("c/capture.toml", "[keypoints]\nscheme = \"openpose25\"");
    });

    fs::remove_all(c);
    writeForeignCapture(c, 2);
    fs::remove_all(c / "masks");
    EXPECT_EQ(messageOf<InputError>([&] { readCapture(c).requireMasks(); }),
              (c / "masks").string() +
                  ": expected a mask for every frame, found none for f1; bring them in with the "
                  "source, or make them from a green screen with `doppel import --key`");
}

TEST(Capture, CutPictureIsAnInputError) {
    Folder folder;
    writeForeignCapture(folder.path(), 1);
    const Capture capture = readCapture(folder.path());
    fs::resize_file(capture.frames[0].image, fs::file_size(capture.frames[0].image) - 30);
    FrameCache cache(capture);
    EXPECT_NE(messageOf<InputError>([&] { cache.load(0); }).find("f1.png"), std::string::npos);
}

TEST(FrameCache, KeepsTheLatestWithinItsBudget) {
    Folder folder;
    writeForeignCapture(folder.path(), 4);
    const Capture capture = readCapture(folder.path());
    FrameCache cache(capture, 2 * kWidth * kHeight * 4);
    const auto first = cache.load(0);
    EXPECT_EQ(cache.load(0), first);
    cache.load(1);
    EXPECT_EQ(cache.load(0), first);  // used again: 1 is the oldest now
    cache.load(2);
    EXPECT_EQ(cache.load(0), first);
    cache.load(3);
    cache.load(1);
    EXPECT_NE(cache.load(0), first);
}

TEST(Motion, ReadsCapturesAndPoses) {
    Folder folder;
    writeForeignCapture(folder / "c", 3);
    folder.write("c/capture.toml", "fps = 25\nname = \"dance\"");
    const Motion motion = readMotion(folder / "c");
    EXPECT_EQ(motion.size(), 3u);
    EXPECT_EQ(motion.fps, 25);
    EXPECT_EQ(motion.name, "dance");
    ASSERT_EQ(motion.cameras.size(), 3u);
    EXPECT_EQ(motion.cameras[2], smallCamera());

    const Motion poses = readMotion(folder / "c/poses.npz");
    EXPECT_EQ(poses.size(), 3u);
    EXPECT_TRUE(poses.cameras.empty());
    EXPECT_EQ(poses.theta[2], motion.theta[2]);
    const std::vector<size_t> last{2};
    EXPECT_EQ(motion.subset(last).trans[0], motion.trans[2]);

    PoseValues(0).write(folder / "none.npz");
    EXPECT_NE(messageOf<InputError>([&] {
                  readMotion(folder / "none.npz");
              }).find("none.npz: global_orient: expected one frame or more, found none"),
              std::string::npos);
    EXPECT_NE(
        messageOf<InputError>([&] { readMotion(folder / "missing.npz"); }).find("found nothing"),
        std::string::npos);
}

// A format that this file adds.
const MotionFormat kStill{{
    .looks = "a still.txt",
    .ending = ".still",
    .recognises = [](const fs::path&, std::string_view begin) { return begin == "stands still"; },
    .read =
        [](const fs::path& path) {
            Motion motion;
            motion.source = path;
            motion.theta.resize(2);
            motion.trans.resize(2);
            return motion;
        },
}};

TEST(Motion, AFormatIsOneDeclaration) {
    Folder folder;
    folder.write("a.STILL", std::string("anything"));
    EXPECT_EQ(readMotion(folder / "a.STILL").size(), 2u);
    folder.write("noted", std::string("stands still"));
    EXPECT_EQ(readMotion(folder / "noted").size(), 2u);
    // By content, whatever the name; what the name says comes first.
    writeForeignCapture(folder / "c.still", 3);
    EXPECT_EQ(readMotion(folder / "c.still").size(), 3u);
    fs::rename(folder / "c.still/poses.npz", folder / "poses.backup");
    EXPECT_EQ(readMotion(folder / "poses.backup").size(), 3u);
    folder.write("dance.txt", std::string("\xef\xbb\xbf HIERARCHY\nROOT"));
    EXPECT_NE(messageOf<InputError>([&] {
                  readMotion(folder / "dance.txt");
              }).find("dance.txt: line 2: expected"),
              std::string::npos);
    folder.write("other.txt", std::string("nothing of the kind"));
    EXPECT_EQ(messageOf<InputError>([&] { readMotion(folder / "other.txt"); }),
              (folder / "other.txt").string() +
                  ": expected a motion: a .bvh, a USD animation as export writes it (.usda), a "
                  "capture's folder, a glTF animation (.glb, .gltf, .vrm, .vrma), a poses.npz, a "
                  "still.txt, an FBX animation (.fbx), other programs' poses (AMASS, 4D-Humans, "
                  "WHAM, GVHMR, ROMP, VIBE, SPIN, EasyMocap) or poses as JSON, as export writes "
                  "them, found another kind of file");
}

TEST(SelectFrames, Ranges) {
    using Indices = std::vector<size_t>;
    EXPECT_EQ(selectFrames("", 3), (Indices{0, 1, 2}));
    EXPECT_EQ(selectFrames("1:3", 5), (Indices{1, 2}));
    EXPECT_EQ(selectFrames(":2", 5), (Indices{0, 1}));
    EXPECT_EQ(selectFrames("3:", 5), (Indices{3, 4}));
    EXPECT_EQ(selectFrames("-2:", 5), (Indices{3, 4}));
    EXPECT_EQ(selectFrames(":-3", 5), (Indices{0, 1}));
    EXPECT_EQ(selectFrames("3::4", 12), (Indices{3, 7, 11}));
    EXPECT_EQ(selectFrames("4,0:2,1", 5), (Indices{0, 1, 4}));
    EXPECT_EQ(selectFrames("-1", 5), (Indices{4}));
    EXPECT_EQ(selectFrames("90:120", 120).size(), 30u);
    for (const char* wrong : {"a", "1:b", "1:2:3:4", ",", "1,", "1 :2", "1.5"}) {
        EXPECT_NE(messageOf<InputError>([&] {
                      selectFrames(wrong, 5, "--frames");
                  }).find("--frames: expected a:b"),
                  std::string::npos)
            << wrong;
    }
    EXPECT_EQ(messageOf<InputError>([&] { selectFrames("2:9", 5); }),
              "--frames: expected frames within 0:5, found \"2:9\"");
    EXPECT_EQ(messageOf<InputError>([&] { selectFrames("7", 5); }),
              "--frames: expected a frame from 0 to 4, found 7");
    EXPECT_EQ(messageOf<InputError>([&] { selectFrames("3:3", 5); }),
              "--frames: expected one frame or more of the 5, found none in \"3:3\"");
    EXPECT_EQ(messageOf<InputError>([&] { selectFrames("0:3:0", 5); }),
              "--frames: expected a step of 1 or more, found 0");
}

TEST(Keypoints, NameTheirJoints) {
    EXPECT_EQ(keypointJoints("openpose25").size(), 25u);
    EXPECT_EQ(keypointJoints("lsp19").size(), 19u);
    EXPECT_EQ(keypointJoints("openpose25")[4], 21);  // right wrist
    EXPECT_EQ(keypointJoints("lsp19")[3], 1);        // left hip
    EXPECT_THROW(keypointJoints("coco"), InputError);
    EXPECT_EQ(keypointFace("openpose25"), (std::array<size_t, 5>{0, 16, 15, 18, 17}));
    EXPECT_EQ(keypointFace("lsp19"), (std::array<size_t, 5>{14, 15, 16, 17, 18}));
    EXPECT_THROW(keypointFace("coco"), InputError);
}

}  // namespace
}  // namespace doppel
