#include "trainer/commands/batch/schedulers.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "trainer/commands/batch/plan.h"

namespace doppel::batch {

namespace {

// As one word of a shell, whatever is in it.
std::string shellWord(std::string_view text) {
    std::string word = "'";
    for (char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return word + "'";
}

// A string of Python's, whose rules for these are JSON's.
std::string pythonText(const std::string& text) {
    return nlohmann::json(text).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

std::string commandOf(const Call& call) {
    return fmt::format("{} batch {} --out {}", shellWord(call.program),
                       shellWord(call.manifest.string()), shellWord(call.out.string()));
}

}  // namespace

std::string slurmScript(const Call& call, std::span<const Person> people) {
    std::string names;
    for (const Person& person : people) names += fmt::format(" {}", person.name);
    // What the script itself says is said to a shell; the lines for Slurm are none.
    return fmt::format(
        "#!/bin/bash\n"
        "# {0} people, a task for each. Give it what a node has, for example:\n"
        "#     sbatch --gres=gpu:1 --cpus-per-task=4 --mem=16G FILE\n"
        "# Once it has run, the page is index.html in the batch's folder. Given again, the script\n"
        "# does what is not done yet.\n"
        "#SBATCH --job-name=doppel\n"
        "#SBATCH --array=0-{1}\n"
        "#SBATCH --requeue\n"
        "#SBATCH --open-mode=append\n"
        "#SBATCH --output=doppel-%A.log\n"
        "people=({2} )\n"
        "exec {3} --only \"${{people[$SLURM_ARRAY_TASK_ID]}}\"\n",
        people.size(), people.size() - 1, names, commandOf(call));
}

std::string snakefile(const Call& call, std::span<const Person> people) {
    nlohmann::json names = nlohmann::json::array();
    for (const Person& person : people) names.push_back(person.name);
    // Snakemake's own braces in a command are doubled; the person's name is what it fills in.
    std::string command = commandOf(call);
    for (size_t at = 0; (at = command.find_first_of("{}", at)) != std::string::npos; at += 2)
        command.insert(at, 1, command[at]);
    return fmt::format(
        "# {0} people, a file for each:\n"
        "#     snakemake --snakefile FILE --cores 4\n"
        "workdir: {1}\n"
        "PEOPLE = {2}\n"
        "\n"
        "rule all:\n"
        "    input: [f\"jobs/{{person}}.all\" for person in PEOPLE]\n"
        "\n"
        "rule person:\n"
        "    output: \"jobs/{{person}}.all\"\n"
        "    wildcard_constraints: person=\"[A-Za-z0-9_-]+\"\n"
        "    shell: {3} + \" --only {{wildcards.person}}\"\n",
        people.size(), pythonText(call.out.string()), names.dump(), pythonText(command));
}

}  // namespace doppel::batch
