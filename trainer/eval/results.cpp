#include "trainer/eval/results.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Folders deeper than this are not looked into.
constexpr int kDepth = 2;

bool isCapture(const fs::path& folder) {
    return fs::exists(folder / "poses.npz") && fs::is_directory(folder / "images");
}

// Without "..", and without a slash at the end.
fs::path plainPath(const fs::path& folder) {
    const fs::path absolute = fs::absolute(folder).lexically_normal();
    return absolute.has_filename() ? absolute : absolute.parent_path();
}

std::string ownName(const fs::path& folder) { return plainPath(folder).filename().string(); }

void collect(const fs::path& folder, const std::string& parent, int depth,
             std::vector<CollectionEntry>& entries) {
    if (isCapture(folder)) {
        const Capture capture = readCapture(folder);
        entries.push_back({folder, capture.actor.empty() ? parent : capture.actor,
                           capture.motion.empty() ? ownName(folder) : capture.motion});
        return;
    }
    if (depth == kDepth) return;
    std::vector<fs::path> inside;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder))
        if (entry.is_directory() && !entry.path().filename().string().starts_with('.'))
            inside.push_back(entry.path());
    std::ranges::sort(inside, [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.filename().string(), b.filename().string());
    });
    for (const fs::path& path : inside) collect(path, ownName(folder), depth + 1, entries);
}

// "Shake_Hands" and "shake hands" are the same motion.
std::string plainName(const std::string& name) {
    std::string result;
    for (char c : name)
        result += c == '_' || c == '-'
                      ? ' '
                      : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return result;
}

std::optional<PaperFigures> lookUp(const std::map<std::string, PaperFigures>& table,
                                   const std::string& name) {
    const auto found = table.find(plainName(name));
    if (found == table.end()) return std::nullopt;
    return found->second;
}

// A column of the tables: its name, our figure, the paper's.
struct Column {
    const char* name;
    int digits;
    std::optional<double> (*ours)(const Figures&);
    double (*paper)(const PaperFigures&);  // null: the paper has none
};

const std::vector<Column>& columns() {
    using F = const Figures&;
    using P = const PaperFigures&;
    static const std::vector<Column> all{
        {"SSIM", 3, [](F f) { return std::optional(f.ssim); }, [](P p) { return p.ssim; }},
        {"LPIPS", 3, [](F f) { return f.lpips; }, [](P p) { return p.lpips; }},
        {"MSE", 2, [](F f) { return std::optional(f.mse); }, [](P p) { return p.mse; }},
        {"FVD", 2, [](F f) { return f.fvd; }, [](P p) { return p.fvd; }},
        {"PSNR", 2, [](F f) { return std::optional(f.psnr); }, nullptr},
        {"IoU", 3, [](F f) { return std::optional(f.iou); }, nullptr},
    };
    return all;
}

std::string number(std::optional<double> value, int digits) {
    return value ? fmt::format("{:.{}f}", *value, digits) : "–";
}

std::string csvText(const std::string& text) {
    if (text.find_first_of(",\"\n") == std::string::npos) return text;
    std::string quoted = "\"";
    for (char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
    return quoted + "\"";
}

std::string markdownText(const std::string& text) {
    std::string result;
    for (char c : text) result += c == '|' ? "\\|" : std::string(1, c);
    return result;
}

}  // namespace

std::vector<CollectionEntry> findCaptures(const fs::path& folder) {
    if (!fs::is_directory(folder))
        throwInput(
            "{}: expected a capture or a folder of captures, found {}; `doppel import` makes a "
            "capture of a video or of pictures, and docs/formats.md has its files",
            folder.string(), fs::exists(folder) ? "a file" : "nothing");
    std::vector<CollectionEntry> entries;
    const std::string parent = ownName(plainPath(folder).parent_path());
    collect(folder, parent, 0, entries);
    if (entries.empty())
        throwInput(
            "{}: expected a capture, or captures as {}/ACTOR/MOTION, found none (a capture "
            "has images/ and poses.npz, see docs/formats.md)",
            folder.string(), folder.string());
    return entries;
}

std::string whoseFrames(const std::map<std::string, std::string>& provenance,
                        const Capture& capture, size_t seen) {
    if (seen > 0) {
        return fmt::format(
            "the avatar was trained on {} of these {} frames: their figures say how well it learnt "
            "them, not how well it draws others",
            seen, capture.size());
    }
    const auto of = [&](const char* key) {
        const auto at = provenance.find(key);
        return at == provenance.end() ? std::string() : at->second;
    };
    const std::string actor = of("actor"), name = of("capture");
    if (!actor.empty() && !capture.actor.empty()) {
        if (actor == capture.actor) return {};
        return fmt::format("the avatar is of {}, the capture of {}: the figures compare two people",
                           actor, capture.actor);
    }
    if (name.empty() || name == capture.name) return {};
    return fmt::format(
        "the avatar was learnt from \"{}\", and this is \"{}\": if it shows somebody else, the "
        "figures compare two people",
        name, capture.name);
}

fs::path avatarOf(const fs::path& folder, const std::string& actor) {
    if (fs::exists(folder / "avatar.toml")) return folder;
    if (fs::exists(folder / actor / "avatar.toml")) return folder / actor;
    throwInput("{}: expected an avatar, or one in {}, found neither", folder.string(),
               (folder / actor).string());
}

// Gomes et al., WACV 2022, table 1, rows "Ours".
std::optional<PaperFigures> paperMotion(const std::string& name) {
    static const std::map<std::string, PaperFigures> table{
        {"jump", {.884, .127, 231.20, 1114.43}},
        {"walk", {.890, .097, 153.23, 233.81}},
        {"spinning", {.860, .130, 278.75, 1019.83}},
        {"shake hands", {.865, .130, 254.38, 542.24}},
        {"cone", {.885, .124, 218.76, 614.88}},
        {"fusion dance", {.824, .206, 418.58, 746.22}},
        {"pull down", {.866, .132, 286.02, 1010.24}},
        {"box", {.873, .127, 237.42, 874.69}},
    };
    return lookUp(table, name);
}

std::optional<PaperFigures> paperActor(const std::string& name) {
    static const std::map<std::string, PaperFigures> table{
        {"s1", {.876, .136, 247.10, 881.49}},
        {"s2", {.908, .124, 236.49, 697.68}},
        {"s3", {.852, .134, 276.17, 718.21}},
        {"s4", {.838, .143, 279.42, 551.06}},
    };
    return lookUp(table, name);
}

// Table 2.
std::optional<PaperFigures> paperAblation(const std::string& name) {
    static const std::map<std::string, PaperFigures> table{
        {"no refine", {.869, .136, 262.39, 795.15}},
        {"no clamp", {.866, .142, 288.04, 829.60}},
        {"complete", {.868, .134, 259.79, 769.54}},
    };
    return lookUp(table, name);
}

Figures figuresOf(std::span<const EvaluatedCapture* const> captures) {
    CHECK(!captures.empty(), "figures are of one capture or more");
    Figures figures;
    figures.captures = captures.size();
    const double n = static_cast<double>(captures.size());
    std::vector<std::vector<double>> real, rendered;
    bool allLpips = true;
    double lpips = 0;
    for (const EvaluatedCapture* capture : captures) {
        const Evaluation& e = capture->evaluation;
        const FrameMetrics mean = meanMetrics(e.frames);
        figures.frames += e.frames.size();
        figures.ssim += mean.ssimFrame / n;
        figures.mse += mean.mseFrame / n;
        figures.psnr += mean.psnrFrame / n;
        figures.iou += mean.iou / n;
        figures.ssimBody += mean.ssimBody / n;
        figures.psnrBody += mean.psnrBody / n;
        figures.change += e.change / n;
        figures.changeOfFrames += e.changeOfFrames / n;
        figures.changeHeldStill = std::max(figures.changeHeldStill, e.changeHeldStill);
        allLpips = allLpips && mean.lpips.has_value();
        lpips += mean.lpips.value_or(0) / n;
        real.insert(real.end(), e.realClips.begin(), e.realClips.end());
        rendered.insert(rendered.end(), e.renderedClips.begin(), e.renderedClips.end());
    }
    if (allLpips) figures.lpips = lpips;
    figures.fvd = videoDistance(real, rendered);
    return figures;
}

std::vector<ResultRow> groupResults(const std::vector<EvaluatedCapture>& captures) {
    using Group = std::pair<std::string, std::vector<const EvaluatedCapture*>>;
    std::vector<Group> motions, actors;  // in the order of their first captures
    std::vector<const EvaluatedCapture*> all;
    auto put = [](std::vector<Group>& groups, const std::string& name,
                  const EvaluatedCapture* capture) {
        auto same = [&](const Group& group) { return plainName(group.first) == plainName(name); };
        auto found = std::ranges::find_if(groups, same);
        if (found == groups.end()) found = groups.insert(groups.end(), {name, {}});
        found->second.push_back(capture);
    };
    for (const EvaluatedCapture& capture : captures) {
        put(motions, capture.entry.motion, &capture);
        put(actors, capture.entry.actor, &capture);
        all.push_back(&capture);
    }
    std::vector<ResultRow> rows;
    for (const auto& [name, group] : motions)
        rows.push_back({"motion", name, figuresOf(group), paperMotion(name)});
    for (const auto& [name, group] : actors)
        rows.push_back({"actor", name, figuresOf(group), paperActor(name)});
    rows.push_back({"average", "average", figuresOf(all), paperAblation("complete")});
    for (const EvaluatedCapture* capture : all)
        rows.push_back({"capture", capture->entry.actor + "/" + capture->entry.motion,
                        figuresOf(std::span(&capture, 1)), std::nullopt});
    return rows;
}

std::string resultsMarkdown(const std::vector<ResultRow>& rows,
                            const std::vector<std::string>& remarks) {
    std::string text;
    std::string kind;
    for (const ResultRow& row : rows) {
        if (row.kind != kind) {
            kind = row.kind;
            if (!text.empty()) text += "\n";
            text += "| " + kind + " | captures | frames |";
            std::string rule = "|---|---|---|";
            for (const Column& column : columns()) {
                text += fmt::format(" {} |", column.name);
                rule += "---|";
                if (!column.paper || kind == "capture") continue;
                text += " paper |";
                rule += "---|";
            }
            text += "\n" + rule + "\n";
        }
        text += fmt::format("| {} | {} | {} |", markdownText(row.name), row.figures.captures,
                            row.figures.frames);
        for (const Column& column : columns()) {
            text += fmt::format(" {} |", number(column.ours(row.figures), column.digits));
            if (!column.paper || kind == "capture") continue;
            std::optional<double> paper;
            if (row.paper) paper = column.paper(*row.paper);
            text += fmt::format(" {} |", number(paper, column.digits));
        }
        text += "\n";
    }
    for (size_t i = 0; i < remarks.size(); ++i)
        text += (i == 0 ? "\n- " : "- ") + remarks[i] + "\n";
    return text;
}

std::string resultsCsv(const std::vector<ResultRow>& rows) {
    std::string text =
        "kind,name,captures,frames,ssim,lpips,mse,fvd,psnr,iou,ssim_body,psnr_body,change,"
        "change_of_frames,change_held_still,paper_ssim,paper_lpips,paper_mse,paper_fvd\n";
    auto value = [](std::optional<double> v) { return v ? fmt::format("{}", *v) : std::string(); };
    for (const ResultRow& row : rows) {
        const Figures& f = row.figures;
        text += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", row.kind,
                            csvText(row.name), f.captures, f.frames, f.ssim, value(f.lpips), f.mse,
                            value(f.fvd), f.psnr, f.iou, f.ssimBody, f.psnrBody, f.change,
                            f.changeOfFrames, f.changeHeldStill);
        if (row.paper)
            text += fmt::format(",{},{},{},{}\n", row.paper->ssim, row.paper->lpips, row.paper->mse,
                                row.paper->fvd);
        else
            text += ",,,,\n";
    }
    return text;
}

std::string resultsJson(const std::vector<ResultRow>& rows, const Settings& settings,
                        const std::vector<std::string>& remarks) {
    using Json = nlohmann::ordered_json;
    auto orNull = [](std::optional<double> v) { return v ? Json(*v) : Json(); };
    Json json{{"rows", Json::array()}};
    for (const ResultRow& row : rows) {
        const Figures& f = row.figures;
        Json entry{{"kind", row.kind},
                   {"name", row.name},
                   {"captures", f.captures},
                   {"frames", f.frames},
                   {"ssim", f.ssim},
                   {"lpips", orNull(f.lpips)},
                   {"mse", f.mse},
                   {"fvd", orNull(f.fvd)},
                   {"psnr", f.psnr},
                   {"iou", f.iou},
                   {"ssim_body", f.ssimBody},
                   {"psnr_body", f.psnrBody},
                   {"change", f.change},
                   {"change_of_frames", f.changeOfFrames},
                   {"change_held_still", f.changeHeldStill}};
        if (row.paper)
            entry["paper"] = {{"ssim", row.paper->ssim},
                              {"lpips", row.paper->lpips},
                              {"mse", row.paper->mse},
                              {"fvd", row.paper->fvd}};
        json["rows"].push_back(std::move(entry));
    }
    Json& all = json["settings"] = Json::object();
    for (const auto& [name, value] : settings) all[name] = value;
    json["remarks"] = remarks;
    return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

void claimResults(const fs::path& folder, const std::string& name) {
    claimFiles(folder, "eval", {name + ".json", name + ".csv", name + ".md"});
}

void writeResults(const fs::path& folder, const std::string& name,
                  const std::vector<ResultRow>& rows, const Settings& settings,
                  const std::vector<std::string>& remarks) {
    claimResults(folder, name);
    auto write = [&](const char* extension, const std::string& text) {
        AtomicFile file(folder / (name + extension));
        file.write(text);
        file.commit();
    };
    write(".json", resultsJson(rows, settings, remarks) + "\n");
    write(".csv", resultsCsv(rows));
    write(".md", resultsMarkdown(rows, remarks));
}

}  // namespace doppel
