#include "trainer/commands/batch/plan.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/commands/cli.h"

namespace doppel::batch {
namespace fs = std::filesystem;
using nlohmann::json;

std::vector<Job> planOf(const std::vector<Person>& people, const fs::path& manifest,
                        const fs::path& out, const std::vector<std::string>& flags) {
    std::vector<Job> jobs;
    std::string wrong;
    for (const Person& person : people) {
        const fs::path folder = out / person.name, avatar = folder / "avatar";
        auto add = [&](const char* step, std::vector<std::string> words, fs::path made,
                       std::optional<size_t> after) {
            // The flags are read here once, so that a slip is known before hours of others' work.
            std::ostringstream said, complaint;
            if (runCommandLine(words, said, complaint, [](const ParsedCommand&) {}) != 0)
                wrong += fmt::format("{}{}: line {}: {}: {}", wrong.empty() ? "" : "\n",
                                     manifest.string(), person.line, person.name, complaint.str());
            else if (!said.str().empty())
                wrong += fmt::format("{}{}: line {}: {}: flags: expected none that print help",
                                     wrong.empty() ? "" : "\n", manifest.string(), person.line,
                                     person.name);
            while (!wrong.empty() && wrong.back() == '\n') wrong.pop_back();
            Job job{.person = person.name,
                    .step = step,
                    .words = std::move(words),
                    .made = std::move(made),
                    .after = after,
                    .trace = out / "jobs" / fmt::format("{}.{}", person.name, step)};
            if (job.made.empty()) job.made = job.result();
            jobs.push_back(std::move(job));
            return jobs.size() - 1;
        };
        // Before theirs, so that a flag which is given twice is refused.
        std::vector<std::string> words{"avatar", person.input.string(), "--out", folder.string(),
                                       "--json"};
        words.insert(words.end(), flags.begin(), flags.end());
        words.insert(words.end(), person.flags.begin(), person.flags.end());
        const size_t learned = add("avatar", std::move(words), avatar / "avatar.toml", {});
        add("eval", {"eval", avatar.string(), (folder / "capture").string(), "--json"}, {},
            learned);
        if (!person.motion.empty()) {
            const fs::path film = folder / "motion.mp4";
            add("render",
                {"render", avatar.string(), "--motion", person.motion.string(), "--camera",
                 "turntable", "--background", "#9aa4ad", "--size", "720", "--json", "--out",
                 film.string()},
                film, learned);
        }
        if (!person.format.empty()) {
            const fs::path file = folder / ("avatar." + person.format);
            add("export", {"export", avatar.string(), "--json", "--out", file.string()}, file,
                learned);
        }
    }
    if (!wrong.empty()) throwInput("{}", wrong);
    return jobs;
}

Outcome outcomeBefore(const Job& job) {
    std::error_code ignored;
    if (!fs::is_regular_file(job.mark(), ignored)) return {};
    const std::vector<uint8_t> bytes = readWholeFile(job.mark(), uint64_t{1} << 20);
    const json mark = json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (!mark.is_object() || mark.value("words", json()) != json(job.words)) return {};
    const json seconds = mark.value("seconds", json()), memory = mark.value("bytes", json()),
               failed = mark.value("failed", json());
    Outcome outcome{.state = failed.is_string() ? State::Failed : State::Done,
                    .message = failed.is_string() ? failed.get<std::string>() : std::string()};
    if (outcome.state == State::Done && !fs::exists(job.made, ignored)) return {};
    if (seconds.is_number()) outcome.seconds = seconds;
    if (memory.is_number_unsigned()) outcome.bytes = memory;
    return outcome;
}

void remember(const Job& job, const Outcome& outcome) {
    json mark{{"words", job.words}, {"seconds", outcome.seconds}, {"bytes", outcome.bytes}};
    if (outcome.state == State::Failed) mark["failed"] = outcome.message;
    AtomicFile file(job.mark());
    file.write(mark.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
    file.commit();
}

void forget(const Job& job) { fs::remove(job.mark()); }

fs::path allDone(const fs::path& out, const std::string& person) {
    return out / "jobs" / (person + ".all");
}

}  // namespace doppel::batch
