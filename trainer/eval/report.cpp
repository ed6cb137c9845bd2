#include "trainer/eval/report.h"

#include <fmt/format.h>

#include <algorithm>

#include "engine/files/atomic_file.h"
#include "trainer/avatar/sheet.h"
#include "trainer/data/output_folder.h"

namespace doppel {

namespace {

constexpr int kEnlarged = 4;
constexpr const char* kHeads = "heads";  // a folder: no frame's picture has such a name

Image part(const Image& image, const PixelRect& rect) {
    Image cut(rect.x1 - rect.x0, rect.y1 - rect.y0, 3);
    for (int y = rect.y0; y < rect.y1; ++y)
        std::copy(image.pixel(rect.x0, y), image.pixel(rect.x0, y) + cut.rowBytes(),
                  cut.row(y - rect.y0));
    return resize(cut, kEnlarged * cut.width, kEnlarged * cut.height);
}

// As part of an address: all but letters, digits and -._ in hexadecimal.
std::string address(std::string_view text) {
    std::string result;
    for (char c : text) {
        const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                           (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_';
        result += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<uint8_t>(c));
    }
    return result;
}

std::vector<std::pair<std::string, double>> rowOf(const FrameMetrics& m) {
    std::vector<std::pair<std::string, double>> row{{"iou", m.iou},
                                                    {"psnr_body", m.psnrBody},
                                                    {"psnr_frame", m.psnrFrame},
                                                    {"ssim_body", m.ssimBody},
                                                    {"ssim_frame", m.ssimFrame}};
    if (m.lpips) row.emplace_back("lpips", *m.lpips);
    row.insert(row.end(), m.figures.begin(), m.figures.end());
    return row;
}

}  // namespace

std::string escapedHtml(std::string_view text) {
    std::string result;
    for (char c : text) {
        if (c == '&')
            result += "&amp;";
        else if (c == '<')
            result += "&lt;";
        else if (c == '>')
            result += "&gt;";
        else if (c == '"')
            result += "&quot;";
        else
            result += c;
    }
    return result;
}

std::vector<std::string> reportFiles(const std::vector<std::string>& frames) {
    std::vector<std::string> files{"report.html", kHeads};
    for (const std::string& name : frames) files.push_back(name + ".png");
    return files;
}

void writeReportPictures(const std::filesystem::path& folder, const std::string& name,
                         const Image& frame, const Image& render, const Image& error,
                         const PixelRect& head) {
    writeImage(folder / (name + ".png"), contactSheet({{frame, render, error}}));
    if (head.x0 >= head.x1 || head.y0 >= head.y1) return;
    createFolders(folder / kHeads);
    writeImage(folder / kHeads / (name + ".png"),
               contactSheet({{part(frame, head), part(render, head)}}));
}

void writeReport(const std::filesystem::path& folder, const std::string& title,
                 std::span<const FrameMetrics> frames) {
    std::string html = fmt::format(
        "<!doctype html>\n<meta charset=\"utf-8\">\n<title>{0}</title>\n"
        "<style>body{{font:14px sans-serif;margin:2em}}table{{border-collapse:collapse}}"
        "td,th{{padding:2px 8px;text-align:right}}th{{text-align:left}}"
        "img{{image-rendering:pixelated;vertical-align:top;margin-right:8px}}</style>\n"
        "<h1>{0}</h1>\n",
        escapedHtml(title));
    const FrameMetrics mean = meanMetrics(frames);
    html += "<table>\n";
    for (const auto& [name, value] : rowOf(mean))
        html += fmt::format("<tr><th>{}<td>{:.3f}\n", escapedHtml(name), value);
    html += "</table>\n";
    for (const FrameMetrics& frame : frames) {
        html += fmt::format(
            "<h2>{}</h2>\n<p>frame, render, four times the error; the head in both, "
            "enlarged</p>\n<p><img src=\"{}.png\" alt=\"\">",
            escapedHtml(frame.name), address(frame.name));
        if (std::filesystem::exists(folder / kHeads / (frame.name + ".png")))
            html += fmt::format("<img src=\"{}/{}.png\" alt=\"\">", kHeads, address(frame.name));
        html += "</p>\n<p>";
        for (const auto& [name, value] : rowOf(frame))
            html += fmt::format("{} {:.3f} · ", escapedHtml(name), value);
        html += "</p>\n";
    }
    AtomicFile file(folder / "report.html");
    file.write(html);
    file.commit();
}

}  // namespace doppel
