// An evaluation to look at: report.html with every frame's figures, the pictures side by side and
// the head enlarged.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/image.h"
#include "trainer/eval/metrics.h"
#include "trainer/eval/picture_figures.h"

namespace doppel {

// As text of a page: &, <, > and " are written as HTML's entities.
std::string escapedHtml(std::string_view text);

// The names of the files of a report on these frames: what a folder is asked for before.
std::vector<std::string> reportFiles(const std::vector<std::string>& frames);

// Writes NAME.png, frame, render and error side by side, and heads/NAME.png, the head's part of
// frame and render four times enlarged (where the rectangle has pixels).
void writeReportPictures(const std::filesystem::path& folder, const std::string& name,
                         const Image& frame, const Image& render, const Image& error,
                         const PixelRect& head);

// Writes report.html over those pictures. It refers to nothing outside its folder.
void writeReport(const std::filesystem::path& folder, const std::string& title,
                 std::span<const FrameMetrics> frames);

}  // namespace doppel
