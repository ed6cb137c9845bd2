// What a batch has come to, to look at: summary.csv and index.html in its folder.
#pragma once

#include <span>

#include "trainer/commands/batch/runner.h"

namespace doppel::batch {

// index.html refers to the people's folders beside it and to nothing else.
void writeSummary(const std::filesystem::path& out, std::span<const Person> people,
                  std::span<const Job> jobs, std::span<const Outcome> outcomes);

}  // namespace doppel::batch
