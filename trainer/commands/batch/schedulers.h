// A batch as other programs run it: each person's jobs are one task of theirs, which is
// `doppel batch … --only PERSON`, so that what is done, what waits and what goes on is told in one
// place. A task that is killed and started again goes on.
#pragma once

#include <span>
#include <string>

#include "trainer/commands/batch/manifest.h"

namespace doppel::batch {

struct Call {
    std::string program;  // absolute, as are the paths
    std::filesystem::path manifest, out;
};

// For `sbatch FILE`: an array with a task for each person, which Slurm starts again where a node
// goes down.
std::string slurmScript(const Call& call, std::span<const Person> people);

// For `snakemake --snakefile FILE --cores N`: a rule with a file for each person.
std::string snakefile(const Call& call, std::span<const Person> people);

}  // namespace doppel::batch
