// An avatar that version 0.1 has written, before surfaces, texels, caps, hands and light were
// learned: tests/data/avatar_0.1, trained by few steps, with two poses and how it was drawn in
// them.
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "engine/io/image.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/cli.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
const fs::path kAvatar = test::sourceFolder() / "tests/data/avatar_0.1";

void run(std::vector<std::string> command) {
    std::ostringstream out, err;
    ASSERT_EQ(runCommandLine(command, out, err), 0) << err.str();
}

TEST(OldAvatar, LooksAsItDid) {
    test::Folder folder;
    const std::string drawn = (folder / "drawn").string();
    run({"render", kAvatar.string(), "--motion", (kAvatar / "poses.npz").string(), "--camera",
         (kAvatar / "cameras.npz").string(), "--size", "192", "--background", "#8090a0",
         "--retarget", "off", "--out", drawn});
    for (int frame : {0, 1}) {
        const Image now = readImage(fs::path(drawn) / fmt::format("{:04}.png", frame), 3);
        const Image then = readImage(kAvatar / fmt::format("drawn_{}.png", frame), 3);
        ASSERT_EQ(now.data.size(), then.data.size());
        double difference = 0;
        for (size_t i = 0; i < now.data.size(); ++i)
            difference += std::abs(int{now.data[i]} - int{then.data[i]});
        EXPECT_LT(difference / double(now.data.size()), .05) << frame;  // of 255
    }
}

TEST(OldAvatar, ComesBackFromDiskAndGoesOut) {
    test::Folder folder;
    const Avatar avatar = readAvatar(kAvatar);
    EXPECT_TRUE(avatar.light.empty());
    EXPECT_TRUE(avatar.texels.empty());
    writeAvatar(folder / "again", avatar);
    const Avatar again = readAvatar(folder / "again");
    EXPECT_EQ(again.texture, avatar.texture);
    ASSERT_EQ(again.meshNet.size(), avatar.meshNet.size());
    for (const auto& [name, tensor] : avatar.meshNet)
        EXPECT_EQ(again.meshNet.at(name).values, tensor.values) << name;
    EXPECT_EQ(again.body.templateVertices, avatar.body.templateVertices);
    const fs::path glb = folder / "avatar.glb";
    run({"export", kAvatar.string(), "--out", glb.string()});
    EXPECT_GT(fs::file_size(glb), 100000u);
}

}  // namespace
}  // namespace doppel
