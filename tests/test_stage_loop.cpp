// The loop around training steps: one step stays under way, and nothing is kept of what is not
// finite.
#include "trainer/stages/stage_loop.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <fstream>

#include "engine/io/safetensors.h"
#include "nn/ops/elementwise.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/checkpoint.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// Steps that note what is asked of them.
struct Notes {
    std::vector<std::string> lines;
    StageLoop loop;
    Parameters net;
    int64_t bad = -1;  // the step whose loss is not finite

    explicit Notes(int64_t steps) {
        net.add("w", {2}, {1, 2});
        net.allocate(testDevice());
        loop.stage = "mesh";
        loop.steps = steps;
        loop.columns = {"loss"};
        loop.trained = {{"net", &net}};
        loop.draw = [] { return std::vector<size_t>{7}; };
        loop.frameName = [](size_t frame) { return fmt::format("{:04}.png", frame); };
        loop.submit = [this](int64_t i, const std::vector<size_t>& drawn) {
            EXPECT_EQ(drawn, std::vector<size_t>{7});
            lines.push_back(fmt::format("submit {}", i));
        };
        loop.values = [this](int64_t i, int back) {
            lines.push_back(fmt::format("report {} {}", i, back));
            return std::vector<double>{i == bad ? NAN : double(i)};
        };
    }
};

int64_t stepsDone(const fs::path& out) {
    return std::stoll(
        readSafetensors(out / "checkpoints" / "mesh.safetensors").metadata["steps_done"]);
}

std::vector<std::string> rows(const fs::path& out) {
    std::vector<std::string> lines;
    std::ifstream file(out / "log" / "losses_mesh.csv");
    for (std::string line; std::getline(file, line);) lines.push_back(line);
    return lines;
}

TEST(StageLoop, OneStepStaysUnderWay) {
    Notes notes(3);
    EXPECT_TRUE(notes.loop.run({}));
    EXPECT_EQ(notes.lines, (std::vector<std::string>{"submit 0", "submit 1", "report 0 1",
                                                     "submit 2", "report 1 1", "report 2 0"}));
}

TEST(StageLoop, WaitsBeforeItKeepsAnything) {
    test::Folder folder;
    Notes notes(3);
    EXPECT_TRUE(notes.loop.run({.out = folder / "x", .checkpointSeconds = 1e-9}));
    EXPECT_EQ(notes.lines, (std::vector<std::string>{"submit 0", "report 0 0", "submit 1",
                                                     "report 1 0", "submit 2", "report 2 0"}));
    EXPECT_EQ(rows(folder / "x"), (std::vector<std::string>{"step,loss", "0,0", "1,1", "2,2"}));
}

TEST(StageLoop, KeepsNothingFromALossThatIsNotFinite) {
    test::Folder folder;
    for (double seconds : {0.0, 1e-9}) {
        fs::path out = folder / fmt::format("every {}", seconds);
        Notes notes(6);
        notes.bad = 2;
        try {
            notes.loop.run({.out = out, .checkpointSeconds = seconds});
            ADD_FAILURE() << "a loss was nan";
        } catch (const MachineError& error) {
            EXPECT_NE(
                std::string(error.what())
                    .find("stage mesh: loss \"loss\" became nan at step 3 (frames: 0007.png)"),
                std::string::npos)
                << error.what();
        }
        EXPECT_EQ(rows(out), (std::vector<std::string>{"step,loss", "0,0", "1,1"}));
        EXPECT_FALSE(readStageRecord(out)) << "the stage is at its steps no more";
        if (seconds > 0)
            EXPECT_EQ(stepsDone(out), 2);
        else
            EXPECT_FALSE(fs::exists(out / "checkpoints"));
    }
}

TEST(StageLoop, ALossTermIsLoggedAndNamedUnderItsOwnName) {
    test::Folder folder;
    Graph graph(testDevice());
    Losses losses(graph);
    std::vector<Tensor> inputs;
    for (size_t n = 0; n < 3; ++n)
        for (const char* name : {"a", "b", "c", "d", "e", "f"}) {
            inputs.push_back(graph.input({}));
            losses.term(name, 2, scaleShift(graph, inputs.back(), 1, 0));
        }
    losses.sum();
    graph.compile();
    Notes notes(3);
    notes.loop.follow(graph, losses);
    notes.loop.submit = [&](int64_t i, const std::vector<size_t>&) {
        for (size_t k = 0; k < inputs.size(); ++k)
            graph.write(inputs[k],
                        std::vector<float>{i == notes.bad && k == 9 ? NAN : float(i + 1)});
        graph.submit();
    };
    EXPECT_TRUE(notes.loop.run({.out = folder / "x"}));
    EXPECT_EQ(rows(folder / "x"),
              (std::vector<std::string>{"step,loss,a,b,c,d,e,f", "0,12,1,1,1,1,1,1",
                                        "1,24,2,2,2,2,2,2", "2,36,3,3,3,3,3,3"}));
    notes.bad = 1;
    try {
        notes.loop.run({.out = folder / "y"});
        ADD_FAILURE() << "a loss was nan";
    } catch (const MachineError& error) {
        EXPECT_NE(std::string(error.what()).find("stage mesh: loss \"d\" became nan at step 2"),
                  std::string::npos)
            << error.what();
    }
}

TEST(StageLoop, AStopKeepsTheStepThatWasUnderWay) {
    test::Folder folder;
    Notes notes(6);
    catchInterrupts();
    LoopSettings settings{.out = folder / "x", .checkpointSeconds = 0};
    settings.afterStep = [](const std::string&, int64_t done) {
        if (done == 2) raise(SIGINT);
    };
    EXPECT_THROW(notes.loop.run(settings), Interrupted);
    catchInterrupts();
    signal(SIGINT, SIG_DFL);
    EXPECT_EQ(stepsDone(folder / "x"), 3);
    EXPECT_EQ(notes.lines.back(), "report 2 0");
    EXPECT_EQ(rows(folder / "x").size(), 4u);
    // Going on draws for the steps that were done and starts with the next.
    Notes second(6);
    int64_t draws = 0;
    second.loop.draw = [&] {
        ++draws;
        return std::vector<size_t>{7};
    };
    settings.afterStep = {};
    settings.resume = true;
    EXPECT_TRUE(second.loop.run(settings));
    EXPECT_EQ(second.lines.front(), "submit 3");
    EXPECT_EQ(draws, 6);
    EXPECT_EQ(rows(folder / "x").size(), 7u);
}

}  // namespace
}  // namespace doppel
