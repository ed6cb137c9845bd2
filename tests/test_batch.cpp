// Many people's avatars: what is done stays, who fails stops nobody, and killed runs go on; on this
// machine, by Slurm and by Snakemake.
#include <gmock/gmock.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/refusals.h"
#include "trainer/data/output_folder.h"

namespace doppel::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Batch : public Refusals {
protected:
    // Flags of `avatar` with which it takes a second or two, as TOML.
    static std::string flags(const std::vector<std::pair<std::string, std::string>>& others = {}) {
        nlohmann::json words{"--preset", "ci"};
        auto set = [&](const std::string& name, const std::string& value) {
            words.push_back("--set");
            words.push_back(name + "=" + value);
        };
        for (const auto& numbers : {kNumbers, kMore, others})
            for (const auto& [name, value] : numbers) set(name, value);
        return words.dump();
    }
    void manifest(const std::string& people) const {
        write(*this / "people.toml", "flags = " + flags() + "\n" + people);
    }
    static std::string person(const std::string& name, const std::string& more = "") {
        return fmt::format("\n[[person]]\nname = \"{}\"\ninput = \"capture\"\n{}\n", name, more);
    }
    Outcome batch(std::vector<std::string> more = {},
                  const std::function<void(pid_t)>& meanwhile = {}) const {
        more.insert(more.begin(), {"batch", at("people.toml"), "--out", at("people")});
        return doppel(more, nullptr, meanwhile);
    }
    std::string text(const char* name) const { return bytesOf(*this / name); }
    void refusesManifest(const std::string& manifest, const std::string& sentence) const {
        write(*this / "people.toml", manifest);
        refuses({"batch", at("people.toml"), "--out", at("people")}, sentence, 2, false);
    }
    static inline const std::vector<std::pair<std::string, std::string>> kMore{
        {"shape.size", "64"},     {"shape.steps", "2"},
        {"texels.size", "64"},    {"texels.steps", "2"},
        {"refine.steps", "1"},    {"refine.width", "2"},
        {"refine.size", "64"},    {"refine.discriminatorWidth", "2"},
        {"refine.faceSize", "16"}};
};

TEST_F(Batch, WhoFailsStopsNobodyAndWhatIsDoneStays) {
    write(*this / "no.mp4", "not a film");
    manifest(person("anna", "export = \"glb\"\nmotion = \"capture\"") +
             "\n[[person]]\nname = \"bob\"\ninput = \"no.mp4\"\n" + person("Cy_3"));
    Outcome first = batch({"--json"});
    EXPECT_EQ(first.status, 2) << first.err;
    EXPECT_THAT(first.sentence(), HasSubstr("1 of 8 jobs failed, and 1 wait for them"));
    EXPECT_THAT(first.err, HasSubstr("no.mp4: expected a video"));
    const nlohmann::json printed = nlohmann::json::parse(first.out);
    EXPECT_EQ(printed["done"], 6);
    EXPECT_EQ(printed["new"], 7);
    for (const char* name :
         {"people/anna/avatar/avatar.toml", "people/anna/avatar.glb", "people/anna/motion.mp4",
          "people/Cy_3/avatar/avatar.toml", "people/jobs/anna.all", "people/jobs/Cy_3.all"})
        EXPECT_TRUE(fs::exists(*this / name)) << name;
    EXPECT_FALSE(fs::exists(*this / "people/jobs/bob.all"));
    const std::string table = text("people/summary.csv"), page = text("people/index.html");
    EXPECT_THAT(table, HasSubstr("name,state,seconds,memory_mib,iou,psnr_body"));
    EXPECT_THAT(table, HasSubstr("\nanna,done,"));
    EXPECT_THAT(table, HasSubstr("\nbob,failed,"));
    EXPECT_THAT(page, HasSubstr("2 of 3 people are done"));
    EXPECT_THAT(page, HasSubstr("anna/avatar/preview.png"));
    EXPECT_THAT(page, HasSubstr("expected a video"));

    // Whoever names the person's folder for the avatar's is told where that is.
    EXPECT_THAT(doppel({"export", at("people/anna"), "--out", at("results/a.glb")}).sentence(),
                HasSubstr("there is one in " + at("people/anna/avatar")));

    // Again: what is done is not touched.
    const auto avatar = bytesOf(*this / "people/anna/avatar/avatar.toml");
    const auto written = fs::last_write_time(*this / "people/anna/avatar/avatar.toml");
    EXPECT_EQ(nlohmann::json::parse(batch({"--json"}).out)["new"], 1) << "bob alone";
    EXPECT_EQ(fs::last_write_time(*this / "people/anna/avatar/avatar.toml"), written);

    // One asked for: the page tells of the others all the same. What was deleted is made again.
    fs::remove(*this / "people/anna/motion.mp4");
    Outcome only = batch({"--json", "--only", "anna"});
    EXPECT_EQ(only.status, 0) << only.err;
    EXPECT_EQ(nlohmann::json::parse(only.out)["new"], 1);
    EXPECT_TRUE(fs::exists(*this / "people/anna/motion.mp4"));
    EXPECT_THAT(text("people/summary.csv"), HasSubstr("\nbob,failed,"));

    // Other flags: refused for what is there, unless it is to be replaced.
    manifest(person("anna", "flags = [\"--frames\", \"0:2\"]"));
    EXPECT_THAT(batch().err, HasSubstr("--restart starts over"));
    Outcome anew = batch({"--json", "--restart"});
    EXPECT_EQ(anew.status, 0) << anew.err;
    EXPECT_NE(bytesOf(*this / "people/anna/avatar/avatar.toml"), avatar);
    EXPECT_EQ(nlohmann::json::parse(batch({"--json"}).out)["new"], 0);
}

TEST_F(Batch, ATableOfPeopleIsAManifest) {
    auto planned = [&](const std::string& table) {
        write(*this / "people.csv", table);
        return doppel({"batch", at("people.csv"), "--out", at("people"), "--dry-run"});
    };
    const Outcome two = planned(
        "\xef\xbb\xbfname,input,export,flags\r\nanna,capture,glb,--preset small  --every 3\r\n\r\n"
        "bob,\"capture\",,\r\n");
    EXPECT_EQ(two.status, 0) << two.err;
    EXPECT_THAT(two.out, AllOf(HasSubstr("anna avatar: "), HasSubstr("--preset small --every 3"),
                               HasSubstr("anna export: "), HasSubstr("bob avatar: ")));
    EXPECT_EQ(two.out.find("bob export"), std::string::npos);
    auto refusesTable = [&](const std::string& table, const std::string& sentence) {
        const Outcome run = planned(table);
        EXPECT_EQ(run.status, 2) << table;
        EXPECT_THAT(run.err, HasSubstr(sentence));
    };
    refusesTable("", "expected a line for each person");
    refusesTable("name,input\n", "expected a line for each person");
    refusesTable("name,colour\na,b\n",
                 "line 1: expected a head of export, flags, input, motion, name");
    refusesTable("name,name\n", "each once, found name");
    refusesTable("name,input\nanna\n", "line 2: expected 2 cells, as the head has, found 1");
    refusesTable("name,input\n\nanna,\"capture\n", "line 3: a quotation has no end");
    refusesTable("name,input\nanna,capture\nanna,capture\n",
                 "line 3: name: expected another than line 2's");
    refusesTable("name,input\nan\"na\",no\\where\x01\n", "line 2: name: expected up to 64");
    refusesTable("name,input\n,capture\n", "line 2: name: expected up to 64");
    refusesTable("name,input\nanna,\n", "input: expected a clip or folder");
}

// However it ends, jobs end with it, and the next run goes on; the avatar is the one of a run that
// nobody stopped.
TEST_F(Batch, StoppedAndKilledRunsGoOn) {
    auto people = [&](const char* folder) {
        write(*this / "people.toml",
              fmt::format("flags = {}\n{}", flags({{"texels.steps", "60"}}), person("anna")));
        return std::vector<std::string>{"batch", at("people.toml"), "--out", at(folder)};
    };
    const Outcome whole = doppel(people("whole"));
    ASSERT_EQ(whole.status, 0) << whole.err;
    for (int signal : {SIGTERM, SIGINT, SIGKILL}) {
        const Outcome stopped = doppel(people("people"), nullptr, [&](pid_t child) {
            for (int i = 0; i < 600; ++i) {
                if (fs::exists(*this / "people/jobs/anna.avatar.log") &&
                    text("people/jobs/anna.avatar.log").find("texels") != std::string::npos)
                    break;
                std::this_thread::sleep_for(std::chrono::milliseconds(50));
            }
            kill(child, signal);
        });
        EXPECT_EQ(stopped.status, signal == SIGKILL   ? 1000 + SIGKILL
                                  : signal == SIGTERM ? 143
                                                      : 130)
            << stopped.err;
        EXPECT_FALSE(fs::exists(*this / "people/jobs/anna.all"));
        // The job has its folder until it has kept what it has.
        for (int i = 0; i < 200; ++i) {
            try {
                FolderLock free(*this / "people/anna");
                break;
            } catch (const InputError&) {
                std::this_thread::sleep_for(std::chrono::milliseconds(50));
                EXPECT_LT(i, 199) << "a job lives on";
            }
        }
        write(*this / "people/jobs/anna.avatar.log", "");
    }
    const Outcome last = doppel(people("people"));
    EXPECT_EQ(last.status, 0) << last.err;
    EXPECT_EQ(bytesOf(*this / "people/anna/avatar/texture.png"),
              bytesOf(*this / "whole/anna/avatar/texture.png"));
}

TEST_F(Batch, SlipsAreFoundBeforeAnythingRuns) {
    refusesManifest("people = 3", "line 1: expected one of flags, person, found people");
    refusesManifest("", "expected a table [[person]] for each person, found none");
    refusesManifest("[[person", "not TOML");
    refusesManifest("person = 3", "expected a table [[person]]");
    refusesManifest("person = [3]", "person: expected tables");
    refusesManifest(person("../up"), "name: expected up to 64 letters");
    refusesManifest(person("jobs"), "name: expected another than jobs");
    refusesManifest(person("a") + person("A"), "name: expected another than line 2's");
    refusesManifest(person("a", "flags = \"--every 3\""), "flags: expected a list");
    refusesManifest(person("a", "flags = [3]"), "flags: expected texts");
    refusesManifest(person("a", "flags = [\"--evry\", \"3\"]"),
                    "a: doppel avatar: The following arguments were not expected: 3 --evry");
    refusesManifest(person("a", "flags = [\"--out\", \"elsewhere\"]"), "a: ");
    refusesManifest(person("a", "flags = [\"--help\"]"), "expected none that print help");
    refusesManifest(person("a", "export = \"fbx\""), "export: expected glb, vrm, usda or obj");
    refusesManifest(person("a", "motion = \"none.bvh\""), "motion: expected a file");
    refusesManifest(person("a", "input = 3"), "not TOML");
    refusesManifest("[[person]]\nname = \"a\"", "input: expected a clip or folder, found none");
    refusesManifest("[[person]]\nname = \"a\"\ninput = \"capture\\u0000\"",
                    "input: expected a text");
    // All at once, each with its line.
    write(*this / "people.toml", person("a b") + person("b", "color = 1"));
    EXPECT_THAT(batch().err, AllOf(HasSubstr("line 2: name"), HasSubstr("line 10: expected one")));
    write(*this / "people.toml", person("a"));
    refuses({"batch", at("people.toml"), "--out", at("people"), "--only", "b"},
            "--only: expected a person of", 2);
    refuses({"batch", at("people.toml"), "--out", at("capture")}, "", 2);
    refuses({"batch", at("people.toml"), "--out", at("people"), "--slurm", at("people.toml")},
            "expected a name that is free", 2);
    EXPECT_FALSE(fs::exists(*this / "people"));
    Outcome planned = batch({"--dry-run", "--seed", "7"});
    EXPECT_EQ(planned.status, 0) << planned.err;
    EXPECT_THAT(planned.out, HasSubstr("a avatar: avatar "));
    EXPECT_THAT(planned.out, HasSubstr("--seed 7"));
    EXPECT_FALSE(fs::exists(*this / "people"));
}

bool has(const std::string& program) {
    return start({"sh", "-c", "PATH=$PATH:/usr/sbin command -v " + program}).status == 0;
}

// In folders whose names are of no use in a shell or in Python.
TEST_F(Batch, SnakemakeRunsIt) {
    if (!has("snakemake")) GTEST_SKIP() << "snakemake is not installed here";
    const fs::path odd = *this / "it's {odd} \"$(here)\"";
    fs::create_directory(odd);
    fs::rename(*this / "capture", odd / "capture");
    write(odd / "people.toml", "flags = " + flags() + person("anna") + person("bob"));
    const std::string people = (odd / "people.toml").string(), out = (odd / "out").string(),
                      file = (odd / "Snakefile").string();
    ASSERT_EQ(doppel({"batch", people, "--out", out, "--snakemake", file}).status, 0);
    // It keeps books of its own in the folder that it is started in.
    const std::vector<std::string> words{
        "sh", "-c", "cd \"$1\" && exec snakemake --snakefile Snakefile --cores 1", "sh",
        odd.string()};
    const Outcome run = start(words);
    EXPECT_EQ(run.status, 0) << run.err;
    EXPECT_THAT(bytesOf(odd / "out/summary.csv"), HasSubstr("\nbob,done,"));
    EXPECT_THAT(start(words).err, HasSubstr("Nothing to be done"));
}

// Eight tasks on two nodes; the script kills one of them (scripts/slurm-example).
TEST_F(Batch, SlurmRunsItAndANodeDies) {
    for (const char* name : {"slurmctld", "slurmd", "sbatch", "munged"})
        if (!has(name)) GTEST_SKIP() << name << " is not installed here";
    const Outcome run = start({"env", "FLAGS=" + flags({{"texels.steps", "40"}}), "ACTORS=4",
                               "SIZE=64", "PROGRAM=" + program().string(), "SLURM_PORT=26817",
                               sourceFolder().string() + "/scripts/slurm-example", at("results")});
    EXPECT_EQ(run.status, 0) << run.out << run.err;
    EXPECT_THAT(run.out, HasSubstr("node n1 dies, and with it task "));
    EXPECT_THAT(run.err, Not(HasSubstr("Usage:"))) << "a program was called with wrong words";
    const std::string table = text("results/people/summary.csv");
    for (int i = 0; i < 4; ++i)
        EXPECT_THAT(table, HasSubstr(fmt::format("\nperson-{},done,", i))) << run.out;
}

// What a shell and Slurm make of the script is tried above; here that nothing of a name is run.
TEST_F(Batch, TheSlurmScriptQuotesNames) {
    const fs::path odd = *this / "it's $(touch bad) `touch bad`";
    fs::create_directory(odd);
    write(odd / "people.toml", fmt::format("[[person]]\nname = \"a\"\ninput = \"../capture\"\n"));
    const std::string file = at("array.sh");
    ASSERT_EQ(doppel({"batch", (odd / "people.toml").string(), "--out", (odd / "o").string(),
                      "--slurm", file})
                  .status,
              0);
    EXPECT_THAT(bytesOf(file), HasSubstr("#SBATCH --array=0-0\n"));
    // `doppel` replaced by a program that prints its words.
    const Outcome run = start({"sh", "-c",
                               "cd \"$1\" && sed \"s|^exec '[^']*'|exec printf '%s\\\\n'|\" "
                               "array.sh > try.sh && SLURM_ARRAY_TASK_ID=0 bash try.sh",
                               "sh", folder_->path().string()});
    EXPECT_EQ(run.status, 0) << run.err;
    EXPECT_THAT(run.out, HasSubstr("batch\n" + (odd / "people.toml").string() + "\n--out\n" +
                                   (odd / "o").string() + "\n--only\na\n"));
    EXPECT_FALSE(fs::exists(*this / "bad"));
}

}  // namespace
}  // namespace doppel::test
