// `doppel batch`: many avatars, on one machine or by a scheduler.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "engine/device.h"
#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/commands/batch/page.h"
#include "trainer/commands/batch/schedulers.h"
#include "trainer/commands/command.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"

namespace doppel::batch {
namespace fs = std::filesystem;

namespace {

struct BatchOptions {
    CommonOptions common;
    fs::path manifest, out, slurm, snakemake;
    std::vector<std::string> only;
    int jobs = 0;
    bool dryRun = false, restart = false;
};

// One job for each GPU, or for the CPU where there is none; with --jobs so many, on the GPUs by
// turns.
std::vector<std::string> devicesFor(const BatchOptions& options) {
    std::vector<std::string> devices;
    if (options.common.device.empty())
        for (const DeviceInfo& info : Device::list())
            if (info.refusals.empty() && !info.kernelPath.onCpu)
                devices.push_back(fmt::format("{}", info.index));
    if (devices.empty()) devices.push_back(options.common.device);
    if (options.jobs == 0) return devices;
    std::vector<std::string> each;
    for (int i = 0; i < options.jobs; ++i)
        each.push_back(devices[static_cast<size_t>(i) % devices.size()]);
    return each;
}

void requireFree(const fs::path& path) {
    std::error_code ignored;
    if (fs::exists(path, ignored))
        throwInput(
            "{}: expected a name that is free, found a file; take it away, or choose another",
            path.string());
}

void writeScript(const fs::path& path, const std::string& text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
    fmt::print("{}\n", path.string());
}

void runBatch(const BatchOptions& options) {
    std::vector<Person> people = readManifest(options.manifest);
    const fs::path out = fs::absolute(options.out).lexically_normal();
    for (const std::string& name : options.only)
        if (std::ranges::count(people, name, &Person::name) == 0)
            throwInput("--only: expected a person of {}, found \"{}\"", options.manifest.string(),
                       name);
    std::vector<fs::path> inputs{options.manifest};
    for (const Person& person : people) inputs.insert(inputs.end(), {person.input, person.motion});
    requireApart(out, inputs);
    std::vector<std::string> flags;
    if (options.common.seed != CommonOptions().seed)
        flags = {"--seed", fmt::format("{}", options.common.seed)};
    const std::vector<Job> all = planOf(people, options.manifest, out, flags);
    const Call call{fs::read_symlink("/proc/self/exe").string(),
                    fs::absolute(options.manifest).lexically_normal(), out};
    const auto claim = [&] {
        std::vector<std::string> names{"jobs", "summary.csv", "index.html"};
        for (const Person& person : people) names.push_back(person.name);
        claimFiles(out, "batch", names);
    };
    if (const bool slurm = !options.slurm.empty(), snakemake = !options.snakemake.empty();
        slurm || snakemake) {
        requireFree(options.slurm);
        requireFree(options.snakemake);
        claim();  // before the scheduler makes folders in it, which would be a stranger's
        if (slurm) writeScript(options.slurm, slurmScript(call, people));
        if (snakemake) writeScript(options.snakemake, snakefile(call, people));
        return;
    }
    std::vector<Job> jobs;  // those of the people who are asked for
    std::vector<size_t> places;
    for (size_t i = 0; i < all.size(); ++i) {
        if (!options.only.empty() && std::ranges::count(options.only, all[i].person) == 0) continue;
        jobs.push_back(all[i]);
        if (jobs.back().after)
            jobs.back().after =
                static_cast<size_t>(std::ranges::find(places, *jobs.back().after) - places.begin());
        places.push_back(i);
    }
    if (options.dryRun) {
        for (const Job& job : jobs) {
            fmt::print("{} {}:{}", job.person, job.step,
                       outcomeBefore(job).state == State::Done ? " done:" : "");
            for (const std::string& word : job.words) fmt::print(" {}", word);
            fmt::print("\n");
        }
        return;
    }

    catchInterrupts();
    claim();
    createFolders(out / "jobs");
    if (options.restart)
        for (Job& job : jobs) {
            forget(job);
            job.restart = job.step == "avatar";
        }
    // The page tells of everybody, also of those whom others have in hand.
    auto summary = [&](std::span<const Outcome> outcomes) {
        std::vector<Outcome> whole(all.size());
        for (size_t i = 0; i < all.size(); ++i) whole[i] = outcomeBefore(all[i]);
        for (size_t k = 0; k < places.size(); ++k) whole[places[k]] = outcomes[k];
        writeSummary(out, people, all, whole);
    };
    const std::vector<Outcome> outcomes = runJobs(call.program, jobs, devicesFor(options), summary);
    summary(outcomes);
    for (const Person& person : people) {
        bool asked = false, done = true;
        for (size_t k = 0; k < jobs.size(); ++k) {
            if (jobs[k].person != person.name) continue;
            asked = true;
            done &= outcomes[k].state == State::Done;
        }
        if (!asked || !done) continue;
        AtomicFile file(allDone(out, person.name));
        file.commit();
    }
    const auto count = [&](State state) {
        return std::ranges::count(outcomes, state, &Outcome::state);
    };
    if (options.common.json)
        printJson({{"jobs", jobs.size()},
                   {"done", count(State::Done)},
                   {"new", std::ranges::count(outcomes, true, &Outcome::isNew)},
                   {"failed", count(State::Failed)},
                   {"page", (out / "index.html").string()}});
    else
        fmt::print("{} of {} jobs are done; {}\n", count(State::Done), jobs.size(),
                   (out / "index.html").string());
    if (interrupted()) throw Interrupted{"what is done, and the checkpoints of what is not"};
    if (const auto failed = count(State::Failed); failed > 0)
        throwInput(
            "{} of {} jobs failed, and {} wait for them; {} says which and why, and the "
            "same command tries them again",
            failed, jobs.size(), count(State::LeftOut), (out / "index.html").string());
}

void declareFlags(CommandFlags& flags, BatchOptions& o) {
    flags.path("MANIFEST", o.manifest, "TOML file of people, as below, or a table of them, .csv")
        ->required();
    flags.path("--out", o.out, "Folder for all of them, with summary.csv and index.html")
        ->required();
    flags
        ->add_option("--jobs", o.jobs,
                     "So many at a time, while memory is free; 0: one for each GPU, or one where "
                     "there is none")
        ->check(CLI::Range(0, 1024))
        ->capture_default_str();
    flags->add_option("--only", o.only, "These people, and not all")->type_name("NAME");
    flags.path("--slurm", o.slurm,
               "Write a script for Slurm's sbatch, an array of people, and run nothing");
    flags.path("--snakemake", o.snakemake, "Write a Snakefile, and run nothing");
    flags->add_flag("--restart", o.restart, "Start these people over, also what is finished");
    flags->add_flag("--dry-run", o.dryRun, "Print what would be run, and stop");
}

const Command<BatchOptions> kBatch{{
    .name = "batch",
    .place = 25,
    .summary = "Many people, one avatar each, on one machine or by Slurm or Snakemake",
    .description =
        "Runs `doppel avatar` and `doppel eval` for each person of a manifest, and `render` and\n"
        "`export` where it asks for them. What is done stays, what was stopped or failed goes on "
        "when\n"
        "the same command is given again; who fails stops nobody else. The manifest is TOML:\n\n"
        "  flags = [\"--preset\", \"small\"]    # of `doppel avatar`, for everybody\n\n"
        "  [[person]]\n"
        "  name = \"anna\"                    # her folder\n"
        "  input = \"clips/anna.mp4\"         # a clip, a folder of pictures, or a capture\n"
        "  flags = [\"--every\", \"3\"]         # her own; these three may be left out\n"
        "  motion = \"dance.bvh\"             # films her in it\n"
        "  export = \"glb\"",
    .example = "doppel batch people.toml --out people",
    .flags = declareFlags,
    .run = runBatch,
}};

}  // namespace

}  // namespace doppel::batch
