// The cast that comes with the program: every actor is whole, upright and in the picture.
#include "trainer/motion/synthetic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/commands/demo.h"
#include "trainer/data/body_render.h"

namespace doppel {
namespace {

const std::filesystem::path kFolder = assetFolder() / "actor";

TEST(ActorNames, AreThoseWithMeshAndPicture) {
    test::Folder folder;
    for (const char* name :
         {"b.npz", "b.png", "a.npz", "a.png", "mesh.npz", "picture.png", "x.txt"})
        folder.write(name, std::string("?"));
    EXPECT_EQ(actorNames(folder.path()), (std::vector<std::string>{"a", "b"}));
    EXPECT_TRUE(actorNames(folder / "nowhere").empty());
    const std::vector<std::string> cast = actorNames(kFolder);
    EXPECT_EQ(std::count(cast.begin(), cast.end(), DemoOptions{}.actor), 1);
}

// Whoever's file is named is recorded as those are who come with the program.
TEST(Demo, RecordsAnActorOfAFile) {
    const test::Folder folder;
    for (const char* kind : {".npz", ".png"})
        std::filesystem::copy(kFolder / (std::string("man") + kind),
                              folder / (std::string("me") + kind));
    auto record = [&](const std::string& actor, const char* out) {
        DemoOptions options;
        options.actor = actor;
        options.out = folder / out;
        options.size = 64;
        options.record = true;
        runDemo(options);
        return test::bytesOf(options.out / "capture" / "images" / "0000_turn.png");
    };
    const std::string named = record("man", "a");
    EXPECT_FALSE(named.empty());
    EXPECT_EQ(record((folder / "me.npz").string(), "b"), named);
    EXPECT_NE(record("woman", "c"), named);
    // What is no actor is refused before anything is written.
    folder.write("notes.txt", "no actor");
    folder.write("broken.npz", "no actor");
    for (const auto& [file, said] : {std::pair{"notes.txt", "--actor: expected an actor's name"},
                                     {"broken.npz", "broken.npz: expected an npz"}}) {
        const std::string path = (folder / file).string();
        EXPECT_NE(test::messageOf<InputError>([&] { record(path, "d"); }).find(said),
                  std::string::npos)
            << file;
        EXPECT_FALSE(std::filesystem::exists(folder / "d"));
    }
}

// One vertex of a posed mesh.
glm::dvec3 at(const std::vector<float>& verts, int vertex) {
    const float* v = verts.data() + 3 * static_cast<size_t>(vertex);
    return {v[0], v[1], v[2]};
}

// Background that the picture's border does not reach: between strands or fingers, or a tear.
int holes(const std::vector<uint8_t>& mask, int size) {
    std::vector<uint8_t> reached(mask.size(), 0);
    std::vector<int> todo;
    auto reach = [&](int x, int y) {
        if (x < 0 || y < 0 || x >= size || y >= size) return;
        const auto i = static_cast<size_t>(y * size + x);
        if (mask[i] != 0 || reached[i]) return;
        reached[i] = 1;
        todo.push_back(y * size + x);
    };
    for (int i = 0; i < size; ++i)
        for (int edge : {0, size - 1}) {
            reach(i, edge);
            reach(edge, i);
        }
    while (!todo.empty()) {
        const int x = todo.back() % size, y = todo.back() / size;
        todo.pop_back();
        for (int step : {-1, 1}) {
            reach(x + step, y);
            reach(x, y + step);
        }
    }
    int count = 0;
    for (size_t i = 0; i < mask.size(); ++i) count += mask[i] == 0 && !reached[i];
    return count;
}

class Cast : public ::testing::TestWithParam<std::string> {
protected:
    const Actor actor = readActor(kFolder, GetParam());
};
INSTANTIATE_TEST_SUITE_P(Actors, Cast, ::testing::ValuesIn(actorNames(kFolder)),
                         [](const auto& test) {
                             std::string name = test.param;
                             std::replace(name.begin(), name.end(), '-', '_');
                             return name;
                         });

TEST_P(Cast, IsADressedPerson) {
    EXPECT_GT(actor.body.faceCount, 25000);
    EXPECT_LT(actor.body.faceCount, 45000);
    EXPECT_EQ(actor.textureSize, 1024);
    EXPECT_LT(std::filesystem::file_size(kFolder / (GetParam() + ".npz")), 1000000u);
    EXPECT_LT(std::filesystem::file_size(kFolder / (GetParam() + ".png")), 800000u);
    double low = 0, high = 0;  // metres
    for (int64_t v = 0; v < actor.body.vertexCount; ++v) {
        const double y = at(actor.body.templateVertices, static_cast<int>(v)).y;
        low = std::min(low, y), high = std::max(high, y);
    }
    EXPECT_GT(high - low, 1.4);
    EXPECT_LT(high - low, 2);
}

TEST_P(Cast, StandsWholeInThePicture) {
    constexpr int kSize = 128;
    const Camera camera = syntheticCamera(kSize);
    BodyPoser poser(testDevice(), actor.body);
    MeshDrawer drawer(testDevice(), actor.body);
    for (const MotionFrame& frame : actorSession(4, 0, kActorDistance)) {
        const PosedMesh posed = poser.pose(frame.theta, frame.trans, {});
        const Drawing drawing =
            drawer.draw(posed.verts, camera, actor.texture, actor.textureSize, 2);
        int covered = 0, onBorder = 0, between = 0;
        for (int y = 0; y < kSize; ++y)
            for (int x = 0; x < kSize; ++x) {
                const uint8_t value = drawing.mask[static_cast<size_t>(y * kSize + x)];
                covered += value > 127;
                between += value != 0 && value != 255;
                onBorder += value != 0 && (x == 0 || y == 0 || x == kSize - 1 || y == kSize - 1);
            }
        EXPECT_GT(covered, kSize * kSize / 25);
        EXPECT_LT(covered, kSize * kSize / 4);
        EXPECT_EQ(onBorder, 0);
        EXPECT_LT(between, covered / 2);                       // the rim
        EXPECT_LE(holes(drawing.mask, kSize), covered / 100);  // the ponytail's strands have some
        // Head above pelvis above feet (camera space: y down), and each covered.
        double above = -1;
        for (size_t joint : {joint::kHead, joint::kPelvis, joint::kLeftAnkle}) {
            const auto& p = posed.joints[joint];
            const double x = camera.fx * p[0] / p[2] + camera.cx;
            const double y = camera.fy * p[1] / p[2] + camera.cy;
            EXPECT_GT(y, above + kSize / 10.);
            above = y;
            EXPECT_EQ(drawing.mask[static_cast<size_t>(int(y) * kSize + int(x))], 255);
        }
    }
}

// Cloth between the legs and hair between head and back stretch, and nothing becomes a spike.
TEST_P(Cast, DoesNotTearWhenItMoves) {
    BodyPoser poser(testDevice(), actor.body);
    const PosedMesh rest = poser.pose({}, {}, {});
    std::vector<MotionFrame> session = actorSession(0, 8, kActorDistance);
    for (MotionFrame& frame : session) {
        frame.theta[3 * joint::kHead + 1] += 0.3f;
        const PosedMesh posed = poser.pose(frame.theta, frame.trans, {});
        double longest = 0;
        for (size_t i = 0; i < actor.body.faces.size(); i += 3)
            for (size_t k = 0; k < 3; ++k) {
                const int a = actor.body.faces[i + k], b = actor.body.faces[i + (k + 1) % 3];
                const double grown = glm::distance(at(posed.verts, a), at(posed.verts, b)) -
                                     glm::distance(at(rest.verts, a), at(rest.verts, b));
                longest = std::max(longest, grown);
            }
        EXPECT_LT(longest, 0.1) << frame.motion;  // metres
    }
}

}  // namespace
}  // namespace doppel
