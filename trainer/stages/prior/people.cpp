#include "trainer/stages/prior/people.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <optional>
#include <string_view>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "nn/body/body_caps.h"
#include "trainer/avatar/rig.h"
#include "trainer/data/digest.h"
#include "trainer/motion/synthetic.h"

namespace doppel {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view kCast = "cast";
constexpr double kHeightUnit = 5e-4;  // m, of the cast's file

std::vector<KnownPerson> readCast(const BodyModel& body, const std::string& where) {
    if (!isModelOf(bodyFromNpz(readBodyArrays("default")), body))
        throwInput(
            "{}: the cast is of the default body, and \"{}\" is another; expected avatars of that "
            "one",
            where, body.file);
    const Npz file = readNpz(assetFolder() / "body" / "cast.npz");
    const auto vertices = static_cast<size_t>(body.modelVertices);
    const Array& garment = file.at("garment").requireShape({-1, body.modelVertices});
    const int64_t count = garment.shape[0];
    const std::vector<uint8_t> garments = garment.toU8();
    const std::vector<uint8_t> colours =
        file.at("colour").requireShape({count, body.modelVertices, 3}).toU8();
    const std::vector<uint8_t> heights =
        file.at("height").requireShape({count, body.modelVertices}).toU8();
    std::vector<KnownPerson> cast(static_cast<size_t>(count));
    for (size_t i = 0; i < garments.size(); ++i) {
        if (garments[i] >= kGarmentCount)
            throwInput("{}: garment: expected 0 to {}, found {}", file.file, kGarmentCount - 1,
                       garments[i]);
        KnownPerson& person = cast[i / vertices];
        person.garments.push_back(static_cast<Garment>(garments[i]));
        person.colours.push_back(
            glm::dvec3(colours[3 * i], colours[3 * i + 1], colours[3 * i + 2]) / 255.);
        person.heights.push_back(static_cast<float>(kHeightUnit * heights[i]));
    }
    return cast;
}

// Which of the cast are left out by "cast-7-19"; nothing where a word is not such.
std::optional<std::vector<size_t>> leftOut(std::string_view word) {
    if (!word.starts_with(kCast)) return std::nullopt;
    std::vector<size_t> numbers;
    for (word.remove_prefix(kCast.size()); !word.empty();) {
        if (word.front() != '-') return std::nullopt;
        const char *begin = word.data() + 1, *end = word.data() + word.size();
        const auto [rest, error] = std::from_chars(begin, end, numbers.emplace_back());
        if (error != std::errc()) return std::nullopt;
        word.remove_prefix(static_cast<size_t>(rest - word.data()));
    }
    return numbers;
}

std::vector<KnownPerson> castWithout(const std::vector<size_t>& numbers, const BodyModel& body,
                                     const std::string& where) {
    const std::vector<KnownPerson> cast = readCast(body, where);
    std::vector<KnownPerson> others;
    for (size_t number : numbers)
        if (number >= cast.size())
            throwInput("{}: of the cast's members expected 0 to {}, found {}", where,
                       cast.size() - 1, number);
    for (size_t k = 0; k < cast.size(); ++k)
        if (std::ranges::count(numbers, k) == 0) others.push_back(cast[k]);
    return others;
}

// The avatar's folder that a folder is, or that a person's has in it; empty: neither.
fs::path avatarIn(const fs::path& folder) {
    std::error_code ignored;
    for (const fs::path& each : {folder, folder / "avatar"})
        if (!folder.empty() && fs::exists(each / "avatar.toml", ignored)) return each;
    return {};
}

KnownPerson readPerson(const fs::path& folder, const BodyModel& body, const std::string& where) {
    const Avatar avatar = readAvatar(folder);
    if (avatar.texture.empty())
        throwInput("{}: {}: expected an avatar with a texture, found one without", where,
                   folder.string());
    if (avatar.body.modelVertices != body.modelVertices ||
        !std::equal(body.templateVertices.begin(),
                    body.templateVertices.begin() + 3 * body.modelVertices,
                    avatar.body.templateVertices.begin()))
        throwInput("{}: {}: expected an avatar of the body \"{}\", found one of another", where,
                   folder.string(), body.file);
    return personOf(avatar);
}

}  // namespace

std::vector<glm::dvec3> skinNormals(const BodyModel& body) {
    const std::vector<float> sums = areaNormals(body.templateVertices, body.faces);
    std::vector<glm::dvec3> normals;
    for (size_t v = 0; v < sums.size() / 3; ++v) {
        const glm::dvec3 sum(sums[3 * v], sums[3 * v + 1], sums[3 * v + 2]);
        normals.push_back(sum / std::max(glm::length(sum), 1e-12));
    }
    return normals;
}

KnownPerson personOf(const Avatar& avatar) {
    const BodyModel& body = avatar.body;
    const auto vertices = static_cast<size_t>(body.modelVertices);
    KnownPerson person{segmentGarments(body, avatar.texture, avatar.textureSize),
                       vertexColours(body, avatar.texture, avatar.textureSize),
                       {}};
    person.garments.resize(vertices);
    person.colours.resize(vertices);
    const std::vector<glm::dvec3> normals = skinNormals(body);
    for (size_t v = 0; v < vertices; ++v) {
        glm::dvec3 offset(0);
        if (!body.offsets.empty())
            offset = {body.offsets[3 * v], body.offsets[3 * v + 1], body.offsets[3 * v + 2]};
        person.heights.push_back(
            person.garments[v] == Garment::Skin
                ? 0
                : static_cast<float>(std::max(0., glm::dot(offset, normals[v]))));
    }
    return person;
}

KnownPeople readPeople(const std::vector<std::string>& from, const BodyModel& body,
                       const std::string& where, const fs::path& but) {
    KnownPeople known;
    for (const std::string& word : from) {
        if (const auto numbers = leftOut(word)) {
            std::ranges::move(castWithout(*numbers, body, where), std::back_inserter(known.people));
            continue;
        }
        std::error_code ignored;
        auto isWritten = [&](const fs::path& avatar) {
            return !but.empty() && fs::equivalent(avatar, but, ignored);
        };
        std::vector<fs::path> folders;
        if (const fs::path one = avatarIn(word); !one.empty()) {
            if (isWritten(one))
                throwInput("{}: expected another avatar than the one to write, found \"{}\"", where,
                           word);
            folders.push_back(one);
        } else {
            for (const auto& entry : fs::directory_iterator(word, ignored))
                if (const fs::path each = avatarIn(entry.path()); !each.empty() && !isWritten(each))
                    folders.push_back(each);
        }
        if (folders.empty())
            throwInput(
                "{}: expected \"cast\", an avatar's folder, or a folder of avatars, found \"{}\"",
                where, word);
        std::ranges::sort(folders);
        for (const fs::path& folder : folders)
            known.people.push_back(readPerson(folder, body, where));
    }
    if (known.people.empty()) return known;
    Digest digest;
    for (const KnownPerson& person : known.people) {
        digest.add(std::span(person.garments));
        digest.add(std::span(person.colours));
        digest.add(std::span(person.heights));
    }
    known.digest = digest.text();
    return known;
}

}  // namespace doppel
