#include "trainer/avatar/formats/model_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/io/image.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

fs::path withEnding(fs::path path, const char* ending) { return path.replace_extension(ending); }

constexpr const char* kSoftware = "Doppel";       // as our textures say
constexpr std::string_view kMark = "# Doppel\n";  // with which our text files begin

// By content, since an export that was killed leaves companions alone, and a model of the user's
// own has companions of the same names.
bool isOurs(const fs::path& companion) {
    if (endingOf(companion) == ".png") return imageSoftware(companion) == kSoftware;
    const std::vector<uint8_t> head = readFileHead(companion, kMark.size());
    return std::ranges::equal(head, kMark);
}

void requireCompanionsOurs(const fs::path& out) {
    std::error_code error;
    for (const fs::path& companion : companionsOf(out))
        if (fs::exists(companion, error) && !isOurs(companion))
            throwInput(
                "{}: expected nothing there, or what an export wrote, since it is written beside "
                "{}, found another file; name another --out",
                companion.string(), out.filename().string());
}

void requireFinite(const fs::path& out, std::span<const float> values) {
    for (const float value : values)
        if (!std::isfinite(value))
            throwInput("{}: cannot be exported: the mesh holds {}; expected finite numbers",
                       out.string(), value);
}

void writeTexture(const fs::path& file, const GltfScene& scene) {
    const std::vector<uint8_t> png = encodePng(scene.baseColor, kSoftware);
    AtomicFile texture(file);
    texture.write(png.data(), png.size());
    texture.commit();
}

// Numbers of `width` in brackets: "(1, 2, 3), (4, 5, 6)".
template <typename Values>
void appendRows(std::string& text, const Values& values, size_t width) {
    for (size_t i = 0; i < values.size(); ++i) {
        if (width > 1 && i % width == 0) text += '(';
        fmt::format_to(std::back_inserter(text), "{}", values[i]);
        if (width > 1 && i % width == width - 1) text += ')';
        if (i + 1 < values.size()) text += ", ";
    }
}

std::string usdName(std::string name) {
    for (char& c : name) {
        const bool plain =
            (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        if (!plain) c = '_';
    }
    if (name.empty() || (name[0] >= '0' && name[0] <= '9')) name = fmt::format("_{}", name);
    return name;
}

// USD's paths of files stand between @, or between @@@ where there is one in the name.
std::string usdPath(const std::string& path) {
    if (path.find('@') == std::string::npos) return fmt::format("@{}@", path);
    std::string text;
    for (size_t i = 0; i < path.size(); ++i) {
        if (path.compare(i, 3, "@@@") == 0)
            text += '\\', text += path.substr(i, 3), i += 2;
        else
            text += path[i];
    }
    return fmt::format("@@@{}@@@", text);
}

}  // namespace

std::vector<fs::path> companionsOf(const fs::path& out) {
    const std::string ending = endingOf(out);
    if (ending == ".obj") return {withEnding(out, ".mtl"), withEnding(out, ".png")};
    if (ending == ".usda") return {withEnding(out, ".png")};
    return {};
}

void writeObj(const fs::path& out, const GltfScene& scene) {
    requireFinite(out, scene.positions);
    requireCompanionsOurs(out);
    AtomicFile file(out);
    const fs::path material = withEnding(out, ".mtl"), texture = withEnding(out, ".png");
    std::string text = fmt::format("{}mtllib {}\no avatar\n", kMark, material.filename().string());
    const auto put = std::back_inserter(text);
    for (size_t i = 0; i < scene.positions.size(); i += 3)
        fmt::format_to(put, "v {} {} {}\n", scene.positions[i], scene.positions[i + 1],
                       scene.positions[i + 2]);
    // OBJ's pictures begin at the bottom.
    for (size_t i = 0; i < scene.uvs.size(); i += 2)
        fmt::format_to(put, "vt {} {}\n", scene.uvs[i], 1 - scene.uvs[i + 1]);
    for (size_t i = 0; i < scene.normals.size(); i += 3) {
        const double x = scene.normals[i], y = scene.normals[i + 1], z = scene.normals[i + 2];
        const double length = std::max(std::sqrt(x * x + y * y + z * z), 1e-20);
        fmt::format_to(put, "vn {:.6f} {:.6f} {:.6f}\n", x / length, y / length, z / length);
    }
    text += "usemtl avatar\n";
    for (size_t i = 0; i < scene.indices.size(); i += 3) {
        for (const GltfPart& part : scene.parts)
            if (scene.parts.size() > 1 && part.firstIndex == i)
                text += fmt::format("g {}\n", part.name);
        text += 'f';
        for (size_t k = 0; k < 3; ++k)
            fmt::format_to(put, " {0}/{0}/{0}", scene.indices[i + k] + 1);
        text += '\n';
    }
    writeTexture(texture, scene);
    AtomicFile mtl(material);
    // The texture holds the light that the capture was taken in.
    mtl.write(
        fmt::format("{0}newmtl avatar\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Ka "
                    "{1}\nmap_Kd {1}\n",
                    kMark, texture.filename().string()));
    mtl.commit();
    file.write(text);
    file.commit();
}

void writeUsd(const fs::path& out, const GltfScene& scene) {
    requireFinite(out, scene.positions);
    requireCompanionsOurs(out);
    AtomicFile file(out);
    const size_t joints = scene.skeleton.size();
    const fs::path texture = withEnding(out, ".png");
    std::vector<std::string> paths;
    std::string names, bind, rest;
    for (size_t j = 0; j < joints; ++j) {
        const GltfJoint& joint = scene.skeleton[j];
        const std::string name = usdName(joint.name);
        std::array<float, 3> local = joint.position;
        if (joint.parent >= 0) {
            const auto parent = static_cast<size_t>(joint.parent);
            paths.push_back(fmt::format("{}/{}", paths[parent], name));
            for (size_t c = 0; c < 3; ++c) local[c] -= scene.skeleton[parent].position[c];
        } else {
            paths.push_back(name);
        }
        const char* comma = j > 0 ? ", " : "";
        names += fmt::format("{}\"{}\"", comma, paths.back());
        const auto matrix = [](const std::array<float, 3>& p) {
            return fmt::format("((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), ({}, {}, {}, 1))", p[0],
                               p[1], p[2]);
        };
        bind += fmt::format("{}{}", comma, matrix(joint.position));
        rest += fmt::format("{}{}", comma, matrix(local));
    }
    std::string text =
        "#usda 1.0\n(\n    defaultPrim = \"avatar\"\n    metersPerUnit = 1\n"
        "    upAxis = \"Y\"\n";
    const auto put = std::back_inserter(text);
    const size_t keys = scene.animation ? scene.animation->times.size() : 0;
    double rate = 30;
    if (keys > 1) rate = double(keys - 1) / double(scene.animation->times[keys - 1]);
    if (keys > 0)
        fmt::format_to(
            put,
            "    startTimeCode = 0\n    endTimeCode = {}\n    timeCodesPerSecond = {:.6g}\n"
            "    framesPerSecond = {:.6g}\n",
            keys - 1, rate, rate);
    fmt::format_to(
        put,
        ")\n\ndef SkelRoot \"avatar\" (\n    prepend apiSchemas = [\"SkelBindingAPI\"]\n    kind = "
        "\"component\"\n)\n{{\n"
        "    def Skeleton \"skeleton\" (\n        prepend apiSchemas = [\"SkelBindingAPI\"]\n    "
        ")\n"
        "    {{\n        uniform token[] joints = [{}]\n        uniform matrix4d[] bindTransforms "
        "= "
        "[{}]\n        uniform matrix4d[] restTransforms = [{}]\n",
        names, bind, rest);
    if (keys > 0) {
        fmt::format_to(put,
                       "        rel skel:animationSource = </avatar/skeleton/motion>\n\n"
                       "        def SkelAnimation \"motion\"\n        {{\n"
                       "            uniform token[] joints = [{}]\n            half3[] scales = [",
                       names);
        appendRows(text, std::vector<int>(3 * joints, 1), 3);
        text += "]\n            float3[] translations.timeSamples = {\n";
        for (size_t k = 0; k < keys; ++k) {
            std::vector<float> places;
            for (size_t j = 0; j < joints; ++j)
                for (size_t c = 0; c < 3; ++c) {
                    const GltfJoint& joint = scene.skeleton[j];
                    places.push_back(
                        joint.parent < 0
                            ? joint.position[c] + scene.animation->translations[3 * k + c]
                            : joint.position[c] -
                                  scene.skeleton[static_cast<size_t>(joint.parent)].position[c]);
                }
            fmt::format_to(put, "                {}: [", k);
            appendRows(text, places, 3);
            text += "],\n";
        }
        text += "            }\n            quatf[] rotations.timeSamples = {\n";
        for (size_t k = 0; k < keys; ++k) {
            std::vector<float> turns;
            for (size_t j = 0; j < joints; ++j) {
                const float* q = &scene.animation->rotations[4 * (k * joints + j)];
                turns.insert(turns.end(), {q[3], q[0], q[1], q[2]});
            }
            fmt::format_to(put, "                {}: [", k);
            appendRows(text, turns, 4);
            text += "],\n";
        }
        text += "            }\n        }\n";
    }
    text +=
        "    }\n\n    def Mesh \"mesh\" (\n        prepend apiSchemas = [\"SkelBindingAPI\", "
        "\"MaterialBindingAPI\"]\n    )\n    {\n        uniform bool doubleSided = 1\n        "
        "uniform token subdivisionScheme = \"none\"\n        int[] faceVertexCounts = [";
    appendRows(text, std::vector<int>(scene.indices.size() / 3, 3), 1);
    text += "]\n        int[] faceVertexIndices = [";
    appendRows(text, scene.indices, 1);
    text += "]\n        point3f[] points = [";
    appendRows(text, scene.positions, 3);
    std::vector<float> normals = scene.normals, uvs = scene.uvs, weights = scene.weights;
    for (size_t i = 0; i < normals.size(); i += 3) {
        const float length =
            std::max(std::hypot(normals[i], normals[i + 1], normals[i + 2]), 1e-20f);
        for (size_t c = 0; c < 3; ++c) normals[i + c] /= length;
    }
    for (size_t i = 1; i < uvs.size(); i += 2) uvs[i] = 1 - uvs[i];
    for (size_t i = 0; i < weights.size(); i += 4) {
        const float sum = weights[i] + weights[i + 1] + weights[i + 2] + weights[i + 3];
        for (size_t k = 0; k < 4; ++k) weights[i + k] /= sum > 0 ? sum : 1;
    }
    text += "]\n        normal3f[] normals = [";
    appendRows(text, normals, 3);
    text +=
        "] (\n            interpolation = \"vertex\"\n        )\n        texCoord2f[] "
        "primvars:st = [";
    appendRows(text, uvs, 2);
    text +=
        "] (\n            interpolation = \"vertex\"\n        )\n        int[] "
        "primvars:skel:jointIndices = [";
    appendRows(text, scene.joints, 1);
    text +=
        "] (\n            elementSize = 4\n            interpolation = \"vertex\"\n        )\n"
        "        float[] primvars:skel:jointWeights = [";
    appendRows(text, weights, 1);
    text +=
        "] (\n            elementSize = 4\n            interpolation = \"vertex\"\n        )\n"
        "        matrix4d primvars:skel:geomBindTransform = ((1, 0, 0, 0), (0, 1, 0, 0), "
        "(0, 0, 1, 0), (0, 0, 0, 1))\n        rel skel:skeleton = </avatar/skeleton>\n"
        "        rel material:binding = </avatar/material>\n    }\n\n";
    const char *const texels = ".connect = </avatar/material/texture.outputs:rgb>",
                      *const none = " = (0, 0, 0)";
    fmt::format_to(
        put,
        "    def Material \"material\"\n    {{\n        token outputs:surface.connect = "
        "</avatar/material/surface.outputs:surface>\n\n        def Shader \"surface\"\n        {{\n"
        "            uniform token info:id = \"UsdPreviewSurface\"\n            color3f "
        "inputs:diffuseColor{}\n            color3f inputs:emissiveColor{}\n            float "
        "inputs:roughness = 1\n"
        "            token outputs:surface\n        }}\n\n        def Shader \"texture\"\n        "
        "{{\n"
        "            uniform token info:id = \"UsdUVTexture\"\n            asset inputs:file = "
        "{}\n            token inputs:sourceColorSpace = \"sRGB\"\n            float2 "
        "inputs:st.connect = </avatar/material/st.outputs:result>\n            token inputs:wrapS "
        "= "
        "\"clamp\"\n            token inputs:wrapT = \"clamp\"\n            float3 outputs:rgb\n"
        "        }}\n\n        def Shader \"st\"\n        {{\n            uniform token info:id = "
        "\"UsdPrimvarReader_float2\"\n            string inputs:varname = \"st\"\n            "
        "float2 "
        "outputs:result\n        }}\n    }}\n}}\n",
        scene.unlit ? none : texels, scene.unlit ? texels : none,
        usdPath("./" + texture.filename().string()));
    writeTexture(texture, scene);
    file.write(text);
    file.commit();
}

}  // namespace doppel
