// Figures of many evaluated captures, grouped by motion and by actor as the paper's tables do, and
// beside the paper's own.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "trainer/eval/evaluate.h"

namespace doppel {

// ---- captures -----------------------------------------------------------------------------------

// A collection of captures on disk: folders, one or two deep, that hold captures,
// FOLDER/ACTOR/MOTION. Who is seen doing what is said by actor and motion in capture.toml, else by
// the folders' names; of FOLDER/NAME the motion is NAME and the actor FOLDER's own name.
struct CollectionEntry {
    std::filesystem::path folder;
    std::string actor, motion;
};

// In the order of their names. A folder that is a capture itself is a collection of one. InputError
// where there is none.
std::vector<CollectionEntry> findCaptures(const std::filesystem::path& folder);

// The avatar that shows an actor: the folder itself where it is one, else FOLDER/ACTOR. InputError
// where there is none.
std::filesystem::path avatarOf(const std::filesystem::path& folder, const std::string& actor);

// ---- figures ------------------------------------------------------------------------------------

struct PaperFigures {
    double ssim, lpips, mse, fvd;
};
// Of the complete model; names as in the paper's table 1 ("shake hands"), with spaces, hyphens and
// underscores alike and in any case. Nothing for other names.
std::optional<PaperFigures> paperMotion(const std::string& name);
std::optional<PaperFigures> paperActor(const std::string& name);
// Table 2: "complete", "no-refine", "no-clamp". Nothing for other names.
std::optional<PaperFigures> paperAblation(const std::string& name);

struct Figures {
    size_t captures = 0, frames = 0;
    double ssim = 0, mse = 0, psnr = 0, iou = 0;  // over whole frames; IoU of silhouettes
    double ssimBody = 0, psnrBody = 0;            // over the masks
    std::optional<double> lpips, fvd;
    double change = 0, changeOfFrames = 0, changeHeldStill = 0;  // see Evaluation
};

struct EvaluatedCapture {
    CollectionEntry entry;
    Evaluation evaluation;
};

// Means over the captures of each one's mean over its frames; FVD of all their clips together; the
// greatest changeHeldStill.
Figures figuresOf(std::span<const EvaluatedCapture* const> captures);

struct ResultRow {
    std::string kind;  // "capture", "motion", "actor", "average", "variant"
    std::string name;
    Figures figures;
    std::optional<PaperFigures> paper;
};

// One row per motion, one per actor, the average, one per capture.
std::vector<ResultRow> groupResults(const std::vector<EvaluatedCapture>& captures);

using Settings = std::vector<std::pair<std::string, std::string>>;

// A table per kind of rows, ours beside the paper's, then what was left out and why.
std::string resultsMarkdown(const std::vector<ResultRow>& rows,
                            const std::vector<std::string>& remarks);
// One line per row.
std::string resultsCsv(const std::vector<ResultRow>& rows);
std::string resultsJson(const std::vector<ResultRow>& rows, const Settings& settings,
                        const std::vector<std::string>& remarks);
// Whether the figures of these frames, of which `seen` were trained on, mean what they seem to: a
// sentence where training saw some of them, or where the avatar, by what its provenance says of its
// capture, may be somebody else's. Empty: they do.
std::string whoseFrames(const std::map<std::string, std::string>& provenance,
                        const Capture& capture, size_t seen);

// NAME.json, NAME.csv and NAME.md.
// InputError, before any work, where writeResults would replace somebody else's files.
void claimResults(const std::filesystem::path& folder, const std::string& name);
void writeResults(const std::filesystem::path& folder, const std::string& name,
                  const std::vector<ResultRow>& rows, const Settings& settings,
                  const std::vector<std::string>& remarks);

}  // namespace doppel
