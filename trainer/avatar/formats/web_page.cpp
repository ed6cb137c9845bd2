#include "trainer/avatar/formats/web_page.h"

#include <fmt/format.h>

#include <cstdint>
#include <cstdlib>
#include <span>
#include <string_view>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/share.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// A module and the addresses by which it imports others. The folder has files beside each other
// and the page has none, so that each address becomes another in both.
struct Module {
    const char* file;
    const char* name;                  // by which the page knows it
    std::vector<const char*> imports;  // as the source has them
};

const std::vector<Module>& modules() {
    static const std::vector<Module> all = {
        {"three.module.min.js", "three", {}},
        {"BufferGeometryUtils.js", "three-geometry", {"three"}},
        {"GLTFLoader.js", "three-gltf", {"three", "../utils/BufferGeometryUtils.js"}},
        {"OrbitControls.js", "three-orbit", {"three"}},
        {"doppel-avatar.js",
         "doppel-avatar",
         {"./three/three.module.min.js", "./three/GLTFLoader.js", "./three/OrbitControls.js"}},
    };
    return all;
}

bool isOurs(const Module& module) { return module.name == std::string_view("doppel-avatar"); }

// The module that an address means: "three", or the file at its end.
const Module& imported(std::string_view address) {
    for (const Module& module : modules())
        if (address == module.name || address.ends_with(std::string("/") + module.file))
            return module;
    CHECK(false, "{} must be one of the page's modules", address);
    std::abort();
}

fs::path webFolder() {
    const char* folder = std::getenv("DOPPEL_WEB");
    return folder && *folder ? folder : fetchedFolder("web");
}

constexpr const char* kLicence = "LICENSE";

std::string readText(const fs::path& file) {
    constexpr uint64_t kMost = 16 << 20;
    const std::vector<uint8_t> bytes = readWholeFile(file, kMost);
    return {bytes.begin(), bytes.end()};
}

std::string readThree(const char* name) {
    const fs::path file = webFolder() / name;
    std::error_code error;
    if (!fs::exists(file, error))
        throwInput("{}: expected a file of three.js, found nothing; {}", file.string(),
                   fetchAdvice("web", "DOPPEL_WEB"));
    return readText(file);
}

std::string readOwn(const char* name) {
    const fs::path file = assetFolder() / "pages" / name;
    std::error_code error;
    if (!fs::exists(file, error))
        throwInput(
            "{}: expected a source of the page, found nothing; DOPPEL_ASSETS has to be the assets "
            "that came with this program",
            file.string());
    return readText(file);
}

std::string sourceOf(const Module& module) {
    return isOurs(module) ? readOwn(module.file) : readThree(module.file);
}

void replaceAll(std::string& text, std::string_view old, std::string_view now) {
    for (size_t at = text.find(old); at != std::string::npos; at = text.find(old, at + now.size()))
        text.replace(at, old.size(), now);
}

// A module's source with each import's address put through `place`.
template <typename Place>
std::string withImports(const Module& module, const Place& place) {
    std::string text = sourceOf(module);
    for (const char* address : module.imports) {
        const std::string old = fmt::format("from '{}'", address);
        if (text.find(old) == std::string::npos)
            throwInput(
                "{}: expected an import {}, found none; remove build/web and run scripts/setup "
                "--web",
                module.file, old);
        replaceAll(text, old, fmt::format("from '{}'", place(imported(address))));
    }
    return text;
}

std::string base64(std::span<const uint8_t> bytes) {
    constexpr std::string_view kDigits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    text.reserve(bytes.size() / 3 * 4 + 4);
    for (size_t i = 0; i < bytes.size(); i += 3) {
        const size_t count = std::min<size_t>(3, bytes.size() - i);
        uint32_t group = 0;
        for (size_t k = 0; k < 3; ++k) group = group << 8 | (k < count ? bytes[i + k] : 0u);
        for (size_t k = 0; k < 4; ++k)
            text += k <= count ? kDigits[group >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}
std::string base64(std::string_view text) {
    return base64(std::span(reinterpret_cast<const uint8_t*>(text.data()), text.size()));
}

std::string escaped(std::string text) {
    replaceAll(text, "&", "&amp;");
    replaceAll(text, "<", "&lt;");
    replaceAll(text, "\"", "&quot;");
    return text;
}

void write(const fs::path& path, std::string_view text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
}

struct Page {
    std::string title, scripts, source, data;
};

std::string filled(std::string text, const Page& page) {
    // The title comes last: it is the user's, and may hold any of the other marks.
    for (const auto& [mark, value] : {std::pair{"@SCRIPTS@", &page.scripts},
                                      {"@SRC@", &page.source},
                                      {"@DATA@", &page.data},
                                      {"@TITLE@", &page.title}}) {
        const size_t at = text.find(mark);
        if (at == std::string::npos)
            throwInput("{}: expected {} in it, found none",
                       (assetFolder() / "pages/index.html").string(), mark);
        text.replace(at, std::string_view(mark).size(), *value);
    }
    return text;
}

// Browsers load no modules and no models from a folder without a server, so that index.html hands
// on to the page that has them in it.
constexpr const char* kFromServer = R"(<script type="module">
if (location.protocol === 'file:') location.replace('page.html');
else import('./doppel-avatar.js');
</script>)";

// Modules as addresses that hold them.
std::string importMap() {
    std::string text = "<script type=\"importmap\">\n{\"imports\": {\n";
    for (const Module& module : modules()) {
        const std::string source =
            withImports(module, [](const Module& other) { return other.name; });
        text += fmt::format("\"{}\": \"data:text/javascript;base64,{}\"{}\n", module.name,
                            base64(source), isOurs(module) ? "" : ",");
    }
    return text + "}}\n</script>\n<script type=\"module\">import 'doppel-avatar';</script>";
}

}  // namespace

void requireWebSources() {
    for (const Module& module : modules()) sourceOf(module);
    readThree(kLicence);
    for (const char* name : {"index.html", "README.txt"}) readOwn(name);
}

void writeWebPage(const fs::path& folder, const std::string& title) {
    const std::string licence = readThree(kLicence), html = readOwn("index.html");
    std::error_code error;
    fs::create_directories(folder / "three", error);
    if (error) throwMachine("{}: cannot be made: {}", (folder / "three").string(), error.message());
    for (const Module& module : modules()) {
        const bool ours = isOurs(module);
        write(ours ? folder / module.file : folder / "three" / module.file,
              withImports(module, [&](const Module& other) {
                  return fmt::format("./{}{}", ours ? "three/" : "", other.file);
              }));
    }
    write(folder / "three" / kLicence, licence);
    write(folder / "README.txt", readOwn("README.txt"));
    write(folder / "index.html", filled(html, {escaped(title), kFromServer, "avatar.glb", ""}));

    constexpr uint64_t kMost = uint64_t{1} << 30;
    const std::string model = base64(readWholeFile(folder / "avatar.glb", kMost));
    write(
        folder / "page.html",
        filled(
            html,
            {escaped(title),
             fmt::format("<!-- three.js, which is in this page:\n{}-->\n{}", licence, importMap()),
             "#avatar",
             fmt::format("<script type=\"application/octet-stream\" id=\"avatar\">{}</script>\n",
                         model)}));
}

}  // namespace doppel
