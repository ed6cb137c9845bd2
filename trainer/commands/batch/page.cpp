#include "trainer/commands/batch/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "engine/files/atomic_file.h"
#include "trainer/data/progress.h"
#include "trainer/eval/report.h"

namespace doppel::batch {
namespace fs = std::filesystem;
using nlohmann::json;

namespace {

struct Figure {
    const char *name, *text;
    int digits;
};
constexpr std::array<Figure, 4> kFigures{{{"iou", "IoU {}", 3},
                                          {"psnr_body", "body {} dB", 1},
                                          {"psnr_interior", "interior {} dB", 1},
                                          {"psnr_head", "head {} dB", 1}}};

// Of what `doppel eval --json` printed; empty where there is none.
std::string figureOf(const json& printed, const char* name, int digits) {
    if (!printed.is_object() || !printed.contains(name) || !printed[name].is_number()) return {};
    return fmt::format("{:.{}f}", printed[name].get<double>(), digits);
}

const char* wordOf(State state) {
    switch (state) {
        case State::Waiting:
            return "waiting";
        case State::Done:
            return "done";
        case State::Failed:
            return "failed";
        case State::LeftOut:
            return "left out";
        case State::Stopped:
            return "stopped";
    }
    return "";
}

json printedBy(const Job& job) {
    std::error_code ignored;
    if (!fs::is_regular_file(job.result(), ignored)) return {};
    const std::vector<uint8_t> bytes = readWholeFile(job.result(), uint64_t{64} << 20);
    return json::parse(bytes.begin(), bytes.end(), nullptr, false);
}

void write(const fs::path& path, const std::string& text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
}

}  // namespace

void writeSummary(const fs::path& out, std::span<const Person> people, std::span<const Job> jobs,
                  std::span<const Outcome> outcomes) {
    std::string csv = "name,state,seconds,memory_mib";
    for (const Figure& figure : kFigures) csv += fmt::format(",{}", figure.name);
    csv += "\n";
    std::string cards;
    size_t done = 0, next = 0;
    for (const Person& person : people) {
        State state = State::Done;
        double seconds = 0;
        uint64_t bytes = 0;
        json figures;
        std::string lines;
        for (; next < jobs.size() && jobs[next].person == person.name; ++next) {
            const Job& job = jobs[next];
            const Outcome& outcome = outcomes[next];
            if (state == State::Done) state = outcome.state;
            seconds += outcome.seconds;
            bytes = std::max(bytes, outcome.bytes);
            if (job.step == "eval" && outcome.state == State::Done) figures = printedBy(job);
            lines += fmt::format("<a href=\"jobs/{}.{}.log\">{}</a>: {}{}<br>\n", person.name,
                                 job.step, job.step, wordOf(outcome.state),
                                 outcome.state == State::Done
                                     ? fmt::format(", {}", clockText(outcome.seconds))
                                     : fmt::format(" {}", escapedHtml(outcome.message)));
        }
        done += state == State::Done;
        csv += fmt::format("{},{},{:.1f},{}", person.name, wordOf(state), seconds, bytes >> 20);
        std::string numbers;
        for (const Figure& figure : kFigures) {
            csv += "," + figureOf(figures, figure.name, 3);
            const std::string value = figureOf(figures, figure.name, figure.digits);
            if (!value.empty())
                numbers +=
                    (numbers.empty() ? "" : " · ") + fmt::format(fmt::runtime(figure.text), value);
        }
        csv += "\n";
        std::error_code ignored;
        auto link = [&](const char* file, const char* text) {
            return fs::exists(out / person.name / file, ignored)
                       ? fmt::format("<a href=\"{}/{}\">{}</a> ", person.name, file, text)
                       : std::string();
        };
        std::string model;
        if (!person.format.empty())
            model = link(("avatar." + person.format).c_str(), person.format.c_str());
        const bool seen = fs::exists(out / person.name / "avatar" / "preview.png", ignored);
        cards += fmt::format(
            "<div class=\"{}\"><h2>{}</h2>{}<p>{}</p><p>{}{}</p><p>{}{}{}</p></div>\n",
            state == State::Done ? "done" : "open", person.name,
            seen ? fmt::format("<img src=\"{}/avatar/preview.png\" alt=\"\" loading=\"lazy\">",
                               person.name)
                 : std::string("<p>no picture yet</p>"),
            numbers, lines, escapedHtml(person.input.filename().string()),
            link("capture/overlay.jpg", "poses"), link("motion.mp4", "film"), model);
    }
    write(out / "summary.csv", csv);
    write(out / "index.html",
          fmt::format("<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\">\n"
                      "<title>{0} of {1} people</title>\n<style>body{{font:15px sans-serif;margin:"
                      "2em;background:#f4f4f4}}main{{display:flex;flex-wrap:wrap;gap:1em}}div{{"
                      "background:#fff;padding:1em;width:20em;border-top:4px solid #2a7}}div.open{{"
                      "border-color:#c33}}img{{width:100%}}h2{{margin:0 0 .5em}}p{{margin:.5em 0}}"
                      "</style>\n<h1>{0} of {1} people are done</h1>\n"
                      "<p><a href=\"summary.csv\">summary.csv</a></p>\n<main>\n{2}</main></html>\n",
                      done, people.size(), cards));
}

}  // namespace doppel::batch
