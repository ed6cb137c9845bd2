// What export writes beside an OBJ or a USD, and whose files it leaves alone.
#include <gtest/gtest.h>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "trainer/avatar/formats/model_files.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;
using test::messageOf;

// One triangle on one joint.
GltfScene triangle() {
    GltfScene scene;
    scene.positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    scene.normals = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    scene.uvs = {0, 0, 1, 0, 0, 1};
    scene.joints.resize(12);
    scene.weights = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    scene.indices = {0, 1, 2};
    scene.skeleton = {{"pelvis", -1, {}}};
    scene.baseColor = Image(2, 2, 3, 128);
    return scene;
}

TEST(Companions, EndingsOfEitherCase) {
    for (const char* name : {"me.obj", "me.OBJ", "me.Obj"})
        EXPECT_EQ(companionsOf(name), (std::vector<fs::path>{"me.mtl", "me.png"})) << name;
    for (const char* name : {"me.usda", "me.USDA"})
        EXPECT_EQ(companionsOf(name), (std::vector<fs::path>{"me.png"})) << name;
    EXPECT_TRUE(companionsOf("me.glb").empty());
    Folder folder;
    writeImage(folder / "me.png", Image(3, 3, 3, 7));
    const std::string holiday = bytesOf(folder / "me.png");
    EXPECT_THROW(writeObj(folder / "me.OBJ", triangle()), InputError);
    EXPECT_THROW(writeUsd(folder / "me.USDA", triangle()), InputError);
    EXPECT_EQ(bytesOf(folder / "me.png"), holiday);
}

TEST(Companions, AreReplacedWhereAnExportWroteThem) {
    Folder folder;
    writeObj(folder / "me.obj", triangle());
    writeObj(folder / "me.obj", triangle());
    // The same texture serves both, and an export that ended early leaves companions alone.
    writeUsd(folder / "me.usda", triangle());
    fs::remove(folder / "me.obj");
    fs::remove(folder / "me.usda");
    writeObj(folder / "me.obj", triangle());
    EXPECT_EQ(imageSoftware(folder / "me.png"), "Doppel");
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"me.mtl", "me.obj", "me.png"}));
}

// A model of the user's own, with companions of the same names.
TEST(Companions, OfOthersAreLeftAlone) {
    const auto expectLeft = [](const char* name, const std::string& content) {
        SCOPED_TRACE(name);
        Folder folder;
        folder.write("me.obj", std::string("o mine\n"));
        folder.write(name, content);
        EXPECT_EQ(messageOf<InputError>([&] { writeObj(folder / "me.obj", triangle()); }),
                  (folder / name).string() +
                      ": expected nothing there, or what an export wrote, since it is written "
                      "beside me.obj, found another file; name another --out");
        EXPECT_EQ(bytesOf(folder / name), content);
        EXPECT_EQ(bytesOf(folder / "me.obj"), "o mine\n");
    };
    Folder folder;
    writeImage(folder / "plain.png", Image(3, 3, 3, 7));
    expectLeft("me.png", bytesOf(folder / "plain.png"));
    expectLeft("me.png", "holiday");
    expectLeft("me.png", "");
    expectLeft("me.mtl", "newmtl mine\n");
    expectLeft("me.mtl", "# Dop");
}

TEST(Companions, UsdNamesWithAts) {
    Folder folder;
    writeUsd(folder / "me@home.usda", triangle());
    EXPECT_NE(bytesOf(folder / "me@home.usda").find("inputs:file = @@@./me@home.png@@@\n"),
              std::string::npos);
    writeUsd(folder / "me@@@@home.usda", triangle());
    EXPECT_NE(bytesOf(folder / "me@@@@home.usda").find("= @@@./me\\@@@@home.png@@@\n"),
              std::string::npos);
    writeUsd(folder / "me.usda", triangle());
    EXPECT_NE(bytesOf(folder / "me.usda").find("inputs:file = @./me.png@\n"), std::string::npos);
}

}  // namespace
}  // namespace doppel
