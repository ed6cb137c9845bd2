#include "trainer/stage_loop.h"

#include <optional>

#include "trainer/checkpoint.h"
#include "trainer/networks.h"

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
    for (int64_t i = first; i < steps; ++i) {
        draw();
        Report report = step(i);
        progress.update(i + 1, report.shown);
        if (profiles) {
            if (i + 1 < settings.profileSteps) continue;
            profile();
            return false;
        }
        if (log) log->add(i, report.logged);
        if (picture && pictures.due()) picture();
        if (settings.afterStep) settings.afterStep(stage, i + 1);
        if (interrupted()) {
            if (!settings.keeps()) throw Interrupted{};
            checkpoint.save(i + 1);
            throw Interrupted{fmt::format("checkpoint {}, from which the same command goes on",
                                          checkpoint.path().string())};
        }
        if (settings.keeps()) checkpoint.saveIfDue(i + 1, settings.checkpointSeconds);
    }
    return !profiles;
}

}  // namespace doppel
