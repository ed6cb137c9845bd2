#include "trainer/avatar/avatar.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "engine/files/atomic_file.h"
#include "engine/io/image.h"
#include "engine/io/pickle.h"
#include "engine/io/safetensors.h"
#include "nn/steps/light.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/sheet.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/version.h"
#include "trainer/motion/synthetic.h"

namespace doppel {

namespace fs = std::filesystem;

namespace {

WeightMap readNetwork(const fs::path& path) {
    if (!fs::exists(path)) return {};
    WeightMap weights = readSafetensors(path).tensors;
    requireFinite(weights, path.string());
    return weights;
}

void writeNetwork(const fs::path& path, const WeightMap& weights) {
    if (weights.empty()) {
        std::error_code ignored;
        fs::remove(path, ignored);
        return;
    }
    Safetensors file;
    file.tensors = weights;
    file.metadata["format"] = "doppel";
    writeSafetensors(path, file);
}

void writeTexture(const fs::path& path, const std::vector<float>& texture, int size) {
    std::error_code ignored;
    if (texture.empty())
        fs::remove(path, ignored);
    else
        writeImage(path, toImage(texture, size, size));
}

// Empty where there is no such file. Textures of one avatar have one size; 0: not known yet.
std::vector<float> readTexture(const fs::path& path, int& size) {
    if (!fs::exists(path)) return {};
    Image image = readImage(path, 3);
    if (image.width != image.height || (size > 0 && image.width != size))
        throwInput("{}: expected a square texture{}, found {}×{}", path.string(),
                   size > 0 ? fmt::format(" of {} pixels", size) : "", image.width, image.height);
    size = image.width;
    std::vector<float> texture;
    for (uint8_t byte : image.data) texture.push_back(static_cast<float>(byte) / 255.0f);
    return texture;
}

void writeSeen(const fs::path& path, const std::vector<uint8_t>& seen, int size) {
    std::error_code ignored;
    if (seen.empty()) {
        fs::remove(path, ignored);
        return;
    }
    Image image(size, size, 1);
    image.data = seen;
    writeImage(path, image);
}

// Empty where there is no such file, as in avatars of earlier versions.
std::vector<uint8_t> readSeen(const fs::path& path, int size) {
    if (!fs::exists(path)) return {};
    Image image = readImage(path, 1);
    if (image.width != size || image.height != size)
        throwInput("{}: expected {}×{} pixels, as texels.png has, found {}×{}", path.string(), size,
                   size, image.width, image.height);
    return image.data;
}

// Values in a table and the tables in it.
int64_t entriesOf(const toml::table& table) {
    int64_t entries = 0;
    for (const auto& [key, value] : table)
        entries += value.is_table() ? entriesOf(*value.as_table()) : 1;
    return entries;
}

toml::table parseToml(const fs::path& path) {
    std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{1} << 20);
    std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    try {
        return toml::parse(text, path.string());
    } catch (const toml::parse_error& error) {
        throwInput("{}: line {}: not TOML: {}", path.string(), error.source().begin.line,
                   error.description());
    }
}

}  // namespace

fs::path liveFolder(const fs::path& avatar) { return avatar / "checkpoints" / "live"; }

void writeLiveAvatar(const fs::path& out, const Avatar& avatar) {
    OutputFolder live(liveFolder(out), kAvatarKind);
    writeAvatar(live.folder(), avatar);
    live.commit();
}

void claimAvatar(const fs::path& folder) {
    claimFiles(
        folder, kAvatarKind,
        {"avatar.toml", "body.npz", "poses.npz", "mesh_net.safetensors", "texture_net.safetensors",
         "refine_net.safetensors", "texels.png", "texels_seen.png", "texture.png",
         "texture_baked.png", "preview.png", "progress.png", "checkpoints", "log"});
}

fs::path bodyFile(const std::string& body) {
    return body == "default" || body == "default-full" ? fs::path() : fs::path(body);
}

Npz readBodyArrays(const std::string& body) {
    fs::path path = bodyFile(body);
    if (path.empty()) return readNpz(assetFolder() / "body" / (body + ".npz"));
    if (path.extension() == ".npz") return readNpz(path);
    if (path.extension() != ".pkl")
        throwInput("--body: expected default, default-full, an .npz or a .pkl file, found \"{}\"",
                   body);
    // SMPL's own file: a dict of arrays.
    PickleValue file = readPickle(path);
    Npz arrays;
    arrays.file = path.string();
    for (const char* name :
         {"v_template", "f", "shapedirs", "posedirs", "weights", "J_regressor", "kintree_table"})
        if (auto value = file.find(name)) arrays.set(name, value->asArray());
    return arrays;
}

void writeAvatar(const fs::path& folder, const Avatar& avatar) {
    claimAvatar(folder);
    Npz body = avatar.bodyArrays;
    body.set("betas", Array::f32({10}, avatar.betas));
    writeNpz(folder / "body.npz", body, true);
    writeNetwork(folder / "mesh_net.safetensors", avatar.meshNet);
    writeNetwork(folder / "texture_net.safetensors", avatar.textureNet);
    writeNetwork(folder / "refine_net.safetensors", avatar.refineNet);
    writeTexture(folder / "texels.png", avatar.texels, avatar.textureSize);
    writeSeen(folder / "texels_seen.png", avatar.texelsSeen, avatar.textureSize);
    writeTexture(folder / "texture.png", avatar.texture, avatar.textureSize);
    writeTexture(folder / "texture_baked.png", avatar.bakedTexture, avatar.textureSize);

    toml::table source, preset, trained;
    for (const auto& [stage, asked] : avatar.trained) {
        toml::table of;
        for (const auto& [key, value] : asked) of.insert(key, value);
        trained.insert(stage, of);
    }
    for (const auto& [key, value] : avatar.provenance) source.insert(key, value);
    for (const auto& [key, value] : presetValues(avatar.preset)) preset.insert(key, value);
    toml::table table{{"doppel", kVersion},
                      {"vertices", avatar.body.vertexCount},
                      {"texture_size", avatar.textureSize},
                      {"preset", avatar.preset.name},
                      {"source", source},
                      {"numbers", preset},
                      {"trained", trained}};
    if (!avatar.light.empty()) {
        toml::array light;
        for (float number : avatar.light) light.push_back(double{number});
        table.insert("light", light);
    }
    // A file that is cut at a line's end is TOML as well.
    table.insert("entries", entriesOf(table));
    std::ostringstream text;
    text << table << "\n";
    AtomicFile file(folder / "avatar.toml");
    file.write(text.str());
    file.commit();
}

Avatar readAvatar(const fs::path& folder) {
    if (!fs::exists(folder / "avatar.toml")) {
        const fs::path persons = folder / "avatar";  // by `doppel avatar`
        throwInput("{}: expected an avatar's folder with an avatar.toml, found none; {}",
                   folder.string(),
                   fs::exists(persons / "avatar.toml")
                       ? fmt::format("there is one in {}", persons.string())
                       : "`doppel avatar` makes one of a video or of pictures");
    }
    fs::path path = folder / "avatar.toml";
    toml::table table = parseToml(path);
    // Older programs wrote no such number.
    const auto entries = table["entries"].value<int64_t>();
    if (const int64_t found = entriesOf(table) - 1; entries && found < *entries)
        throwInput("{}: expected {} entries, as it says of itself, found {}; it was cut short",
                   path.string(), *entries, found);
    Avatar avatar;
    avatar.bodyArrays = readNpz(folder / "body.npz");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    std::vector<float> betas = avatar.bodyArrays.at("betas").requireShape({10}).toF32();
    std::ranges::copy(betas, avatar.betas.begin());
    for (float beta : betas)
        if (!std::isfinite(beta))
            throwInput("{}: betas: expected finite numbers, found {}",
                       (folder / "body.npz").string(), beta);
    avatar.preset = presetByName("paper");
    avatar.preset.name = table["preset"].value_or(std::string("paper"));
    if (const toml::table* numbers = table["numbers"].as_table())
        for (const auto& [key, value] : *numbers)
            setPresetValue(avatar.preset, key.str(), value.value_or(std::string()), path.string());
    if (const toml::table* source = table["source"].as_table())
        for (const auto& [key, value] : *source)
            avatar.provenance[std::string(key.str())] = value.value_or(std::string());
    if (const toml::table* trained = table["trained"].as_table())
        for (const auto& [stage, asked] : *trained)
            if (asked.is_table())
                for (const auto& [key, value] : *asked.as_table())
                    avatar.trained[std::string(stage.str())][std::string(key.str())] =
                        value.value_or(std::string());
    if (const toml::array* light = table["light"].as_array()) {
        for (const toml::node& number : *light)
            avatar.light.push_back(static_cast<float>(number.value_or(double{NAN})));
        // Light that is a hundred times what it lights is nobody's.
        if (avatar.light.size() != kLightNumbers ||
            !std::ranges::all_of(avatar.light, [](float x) { return std::abs(x) <= 100; }))
            throwInput("{}: light: expected {} numbers from -100 to 100, found {}", path.string(),
                       kLightNumbers, fmt::join(avatar.light, " "));
    }
    avatar.meshNet = readNetwork(folder / "mesh_net.safetensors");
    avatar.textureNet = readNetwork(folder / "texture_net.safetensors");
    avatar.refineNet = readNetwork(folder / "refine_net.safetensors");
    avatar.texels = readTexture(folder / "texels.png", avatar.textureSize);
    avatar.texelsSeen = readSeen(folder / "texels_seen.png", avatar.textureSize);
    avatar.texture = readTexture(folder / "texture.png", avatar.textureSize);
    avatar.bakedTexture = readTexture(folder / "texture_baked.png", avatar.textureSize);
    return avatar;
}

void setOffsets(Avatar& avatar, const std::vector<float>& offsets) {
    CHECK(offsets.empty() || offsets.size() == avatar.body.templateVertices.size(),
          "a vertex has an offset");
    avatar.body.offsets = offsets;
    if (offsets.empty())
        avatar.bodyArrays.remove("offsets");
    else
        avatar.bodyArrays.set("offsets", Array::f32({avatar.body.vertexCount, 3}, offsets));
}

TextureKind textureKind(std::string_view word, std::string_view where) {
    if (word == "best") return TextureKind::Best;
    if (word == "coarse") return TextureKind::Coarse;
    if (word == "refined") return TextureKind::Refined;
    if (word == "baked") return TextureKind::Baked;
    throwInput("{}: expected best, coarse, refined or baked, found \"{}\"", where, word);
}

void requireTexture(const Avatar& avatar, TextureKind kind, const fs::path& folder) {
    if (avatar.texture.empty())
        throwInput("{}: it has no texture yet; train stage texture first", folder.string());
    if ((kind == TextureKind::Refined && avatar.refineNet.empty()) ||
        (kind == TextureKind::Baked && avatar.bakedTexture.empty()))
        throwInput("{}: it has no refined texture yet; train stage refine first", folder.string());
}

}  // namespace doppel
