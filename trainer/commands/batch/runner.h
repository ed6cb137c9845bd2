// Runs a plan's jobs as processes, as many at once as there is room for.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "trainer/commands/batch/plan.h"

namespace doppel::batch {

// One outcome per job. program: what the words are given to. devices: for --device, one for each
// job that may run at a time; an empty text leaves the choice to the job. A second job waits until
// memory is free for the largest that was seen. changed(): after each job. A signal is passed on to
// the jobs under way, which keep what they have, and no other starts; they are told as well where
// this process is killed.
std::vector<Outcome> runJobs(const std::string& program, std::span<const Job> jobs,
                             const std::vector<std::string>& devices,
                             const std::function<void(std::span<const Outcome>)>& changed);

}  // namespace doppel::batch
