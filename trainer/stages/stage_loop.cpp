#include "trainer/stages/stage_loop.h"

#include <optional>

#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"

namespace doppel {

bool StageLoop::run(const LoopSettings& settings) {
    bool profiles = settings.profileSteps > 0;
    std::map<std::string, std::string> mustAgree = identity;
    mustAgree["seed"] = fmt::format("{}", settings.seed);
    mustAgree["steps"] = fmt::format("{}", steps);
    Checkpoint checkpoint(settings.out / "checkpoints", stage, std::move(mustAgree));
    for (const auto& [name, parameters] : trained) checkpoint.keepTrained(name, *parameters);
    for (const auto& [name, parameters] : statistics) checkpoint.keepStatistics(name, *parameters);

    int64_t first = settings.keeps() && settings.resume ? checkpoint.restore() : 0;
    if (first > steps)
        throwInput("{}: steps_done: expected {} at most, found {}", checkpoint.path().string(),
                   steps, first);
    for (int64_t i = 0; i < first; ++i) draw();

    Progress progress(stage, profiles ? settings.profileSteps : steps);
    if (first > 0)
        progress.note(fmt::format("{}: going on after step {} of {}", stage, first, steps));
    std::optional<LossLog> log;
    if (settings.keeps()) log.emplace(settings.out / "log", stage, columns, first);
    PictureClock pictures(settings.keeps() ? settings.pictureSeconds : 0);
    // Reported: all steps before this one. One more at most is under way.
    int64_t reported = first;
    auto reportUntil = [&](int64_t end, int64_t submitted) {
        for (; reported < end; ++reported) {
            Report given = report(reported, static_cast<int>(submitted - 1 - reported));
            progress.update(reported + 1, given.shown);
            if (log) log->add(reported, given.logged);
            if (settings.afterStep) settings.afterStep(stage, reported + 1);
        }
    };
    for (int64_t i = first; i < steps; ++i) {
        draw();
        submit(i);
        reportUntil(i, i + 1);  // the step before, while the device works on this one
        if (profiles) {
            if (i + 1 < settings.profileSteps) continue;
            reportUntil(i + 1, i + 1);
            profile();
            return false;
        }
        // What is kept or shown is the state after step i, whose losses must be finite.
        bool draws = picture && pictures.due();
        bool saves = settings.keeps() && checkpoint.due(settings.checkpointSeconds);
        if (!draws && !saves && !interrupted() && i + 1 < steps) continue;
        reportUntil(i + 1, i + 1);
        if (draws) picture();
        if (interrupted()) {
            if (!settings.keeps()) throw Interrupted{};
            checkpoint.save(i + 1);
            throw Interrupted{fmt::format("checkpoint {}, from which the same command goes on",
                                          checkpoint.path().string())};
        }
        if (saves) checkpoint.save(i + 1);
    }
    return !profiles;
}

}  // namespace doppel
