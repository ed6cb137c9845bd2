// The library as another program meets it: found by CMake in an installed prefix, it reads an
// avatar and draws it (docs/example).
#include "tests/refusals.h"

namespace doppel {
namespace {

using namespace test;

class Library : public Refusals {};

TEST_F(Library, AnotherProgramFindsItAndDrawsAnAvatar) {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "a library with AddressSanitizer asks the programs that take it to have it";
#endif
    const fs::path prefix = *this / "prefix", build = *this / "example";
    const auto run = [](const std::vector<std::string>& words) {
        const Outcome outcome = start(words);
        EXPECT_EQ(outcome.status, 0) << words[1] << "\n" << outcome.out << outcome.err;
        return outcome.out;
    };
    run({"cmake", "--install", program().parent_path().string(), "--component", "development",
         "--prefix", prefix.string()});
    run({"cmake", "-S", test::sourceFolder() / "docs/example", "-B", build.string(),
         "-DCMAKE_PREFIX_PATH=" + prefix.string(), "-DCMAKE_BUILD_TYPE=Debug"});
    run({"cmake", "--build", build.string()});
    const fs::path picture = *this / "wave.png";
    run({(build / "wave").string(), at("avatar"), picture.string()});
    const Image drawn = readImage(picture, 3);
    EXPECT_EQ(drawn.width, 256);
    // Somebody is there, with the right arm, which is on the picture's left, above the head's
    // height.
    size_t covered = 0, raised = 0;
    for (int y = 0; y < drawn.height; ++y)
        for (int x = 0; x < drawn.width; ++x) {
            const uint8_t* pixel = drawn.pixel(x, y);
            const bool there = pixel[0] + pixel[1] + pixel[2] > 0;
            covered += there;
            raised += there && y < drawn.height / 4 && x < drawn.width * 2 / 5;
        }
    EXPECT_GT(covered, 2000u);
    EXPECT_GT(raised, 20u);
    if (const char* keep = std::getenv("DOPPEL_KEEP_SCREENS"))
        fs::copy_file(picture, fs::path(keep) / "wave.png", fs::copy_options::overwrite_existing);
}

}  // namespace
}  // namespace doppel
