// What a batch comes to: command lines of `doppel` that wait for each other.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/commands/batch/manifest.h"

namespace doppel::batch {

struct Job {
    std::string person, step;        // avatar, eval, render, export
    std::vector<std::string> words;  // without the program's name
    std::filesystem::path made;      // is there once it is done
    std::optional<size_t> after;     // the job that has to be done before
    bool restart = false;            // with --restart, this time
    // OUT/jobs/PERSON.STEP: .log is what it said, .json what it printed, .end how it ended.
    std::filesystem::path trace;

    std::filesystem::path log() const { return std::filesystem::path(trace) += ".log"; }
    std::filesystem::path result() const { return std::filesystem::path(trace) += ".json"; }
    std::filesystem::path mark() const { return std::filesystem::path(trace) += ".end"; }
};

// Jobs of a person follow each other; those before come first. flags: of `doppel avatar`, before
// everybody's. InputError, naming the manifest's line, where a command does not take its flags.
std::vector<Job> planOf(const std::vector<Person>& people, const std::filesystem::path& manifest,
                        const std::filesystem::path& out, const std::vector<std::string>& flags);

enum class State { Waiting, Done, Failed, LeftOut, Stopped };  // LeftOut: what it waits for failed

struct Outcome {
    State state = State::Waiting;
    double seconds = 0;
    uint64_t bytes = 0;   // of memory, at most at a time
    bool isNew = false;   // it ran now
    std::string message;  // of one that failed: the last line that it said
};

// How it ended before: done if it was with these very words and what it made is there yet, failed,
// or else waiting.
Outcome outcomeBefore(const Job& job);
void remember(const Job& job, const Outcome& outcome);
void forget(const Job& job);

// OUT/jobs/PERSON.all, there once all jobs of a person are done: for programs that wait for files.
std::filesystem::path allDone(const std::filesystem::path& out, const std::string& person);

}  // namespace doppel::batch
