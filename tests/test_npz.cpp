// .npy and .npz: what is written is read back, NumPy's own files are read, and no damage to a file
// does more than an InputError.
#include "engine/files/npz.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/deflate.h"
#include "engine/files/numbers.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

std::vector<uint8_t> npy(std::string header, const std::vector<uint8_t>& data, int version = 1) {
    header += '\n';
    std::vector<uint8_t> file = {0x93, 'N', 'U', 'M', 'P', 'Y', static_cast<uint8_t>(version), 0};
    file.push_back(static_cast<uint8_t>(header.size() & 255));
    file.push_back(static_cast<uint8_t>(header.size() >> 8));
    if (version > 1) file.insert(file.end(), {0, 0});
    file.insert(file.end(), header.begin(), header.end());
    file.insert(file.end(), data.begin(), data.end());
    return file;
}

template <typename T>
void append(std::vector<uint8_t>& out, T value) {
    const size_t at = out.size();
    out.resize(at + sizeof(T));
    std::memcpy(&out[at], &value, sizeof(T));
}

struct ZipPart {
    std::string name;
    std::vector<uint8_t> data;
    uint32_t claimed = 0;     // size in the directory, where not the data's
    uint16_t flags = 0;       // bit 3: sizes stand behind the data, zeros in the local header
    bool zip64 = false;       // as NumPy writes: sizes in an extra field of the local header
    bool sameOffset = false;  // points at the first entry: overlap
};

// A zip as other programs write it (stored).
std::vector<uint8_t> zip(const std::vector<ZipPart>& parts) {
    std::vector<uint8_t> file, directory;
    for (const ZipPart& part : parts) {
        const uint32_t crc =
            static_cast<uint32_t>(crc32(0, part.data.data(), static_cast<uInt>(part.data.size())));
        const uint32_t size = static_cast<uint32_t>(part.data.size());
        const uint32_t claimed = part.claimed ? part.claimed : size;
        const bool behind = (part.flags & 8) != 0;
        const uint32_t offset = part.sameOffset ? 0 : static_cast<uint32_t>(file.size());
        append(file, uint32_t{0x04034b50});
        for (const int value : {45, int{part.flags}, 0, 0, 33})
            append(file, static_cast<uint16_t>(value));
        append(file, behind ? 0 : crc);
        append(file, part.zip64 ? 0xFFFFFFFF : behind ? 0 : size);
        append(file, part.zip64 ? 0xFFFFFFFF : behind ? 0 : size);
        append(file, static_cast<uint16_t>(part.name.size()));
        append(file, static_cast<uint16_t>(part.zip64 ? 20 : 0));
        file.insert(file.end(), part.name.begin(), part.name.end());
        if (part.zip64) {
            append(file, uint16_t{1});
            append(file, uint16_t{16});
            append(file, uint64_t{size});
            append(file, uint64_t{size});
        }
        file.insert(file.end(), part.data.begin(), part.data.end());
        if (behind) {
            for (const uint32_t value : {0x08074b50u, crc, size, size}) append(file, value);
        }
        append(directory, uint32_t{0x02014b50});
        for (const int value : {45, 45, int{part.flags}, 0, 0, 33}) {
            append(directory, static_cast<uint16_t>(value));
        }
        for (const uint32_t value : {crc, claimed, claimed}) append(directory, value);
        append(directory, static_cast<uint16_t>(part.name.size()));
        for (int i = 0; i < 4; ++i) append(directory, uint16_t{0});
        append(directory, uint32_t{0});
        append(directory, offset);
        directory.insert(directory.end(), part.name.begin(), part.name.end());
    }
    const uint32_t offset = static_cast<uint32_t>(file.size());
    file.insert(file.end(), directory.begin(), directory.end());
    append(file, uint32_t{0x06054b50});
    append(file, uint32_t{0});
    append(file, static_cast<uint16_t>(parts.size()));
    append(file, static_cast<uint16_t>(parts.size()));
    append(file, static_cast<uint32_t>(directory.size()));
    append(file, offset);
    append(file, uint16_t{0});
    return file;
}

Npz sample() {
    Npz npz;
    const std::vector<float> floats = {0.5f, -1.25f, 3e38f, -0.0f, 1e-40f, 7.0f};
    npz.set("floats", Array::f32({2, 3}, floats));
    npz.set("doubles", Array::f64({2}, std::vector<double>{M_PI, -1e300}));
    npz.set("ints",
            Array::i32({3, 1}, std::vector<int32_t>{-7, 0, std::numeric_limits<int32_t>::max()}));
    npz.set("longs", Array::i64({1}, std::vector<int64_t>{std::numeric_limits<int64_t>::min()}));
    npz.set("bytes", Array::u8({300}, std::vector<uint8_t>(300, 9)));
    npz.set("attr_slope", Array::scalarF32(0.2f));
    npz.set("empty", Array::f32({0, 3}, {}));
    npz.set("gender", Array::text("female"));
    npz.set("name", Array::text("Zoë"));
    return npz;
}

TEST(Npz, readsBackWhatItWrites) {
    Folder folder;
    for (const bool compress : {false, true}) {
        const auto path = folder / "sample.npz";
        writeNpz(path, sample(), compress);
        const Npz back = readNpz(path);
        ASSERT_EQ(back.size(), sample().size());
        auto it = back.begin();
        for (const auto& [name, array] : sample()) {
            EXPECT_EQ(it->first, name) << "the order is kept";
            EXPECT_EQ(it->second.dtype, array.dtype) << name;
            EXPECT_EQ(it->second.shape, array.shape) << name;
            EXPECT_EQ(it->second.bytes, array.bytes) << name;
            ++it;
        }
        EXPECT_EQ(back.at("gender").toText(), "female");
        EXPECT_EQ(back.at("name").toText(), "Zoë");
        EXPECT_FLOAT_EQ(static_cast<float>(back.at("attr_slope").scalar()), 0.2f);
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"sample.npz"}) << "nothing else is left";
}

TEST(Npz, sameArraysGiveTheSameBytes) {
    Folder folder;
    writeNpz(folder / "a.npz", sample(), true);
    writeNpz(folder / "b.npz", sample(), true);
    EXPECT_EQ(readWholeFile(folder / "a.npz"), readWholeFile(folder / "b.npz"));
}

TEST(Npz, manyArraysAndLargeOnes) {
    Folder folder;
    Npz npz;
    for (int i = 0; i < 1000; ++i) npz.set(fmt::format("a{}", i), Array::scalarI64(i));
    std::vector<float> large(300'001);
    std::mt19937 random(1);
    for (float& value : large) value = static_cast<float>(random() % 1000);
    npz.set("large", Array::f32({300'001}, large));
    npz.set("zeros", Array::f32({2'000'000}, std::vector<float>(2'000'000)));
    writeNpz(folder / "many.npz", npz, true);
    const Npz back = readNpz(folder / "many.npz");
    ASSERT_EQ(back.size(), 1002u);
    EXPECT_EQ(back.at("a999").integer(), 999);
    EXPECT_EQ(back.at("large").toF32(), large);
    EXPECT_EQ(back.at("zeros").count(), 2'000'000);
}

TEST(Npz, readsWhatOtherProgramsWrite) {
    Folder folder;
    const auto one =
        npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", {0, 0, 0x80, 0x3F});
    folder.write("x.npz", zip({{.name = "numpy.npy", .data = one, .zip64 = true},
                               {.name = "streamed.npy", .data = one, .flags = 8},
                               {.name = "readme.txt", .data = {'h', 'i'}}}));
    const Npz npz = readNpz(folder / "x.npz");
    EXPECT_EQ(npz.size(), 2u) << "only *.npy are arrays";
    EXPECT_EQ(npz.at("numpy").toF32(), std::vector<float>{1});
    EXPECT_EQ(npz.at("streamed").toF32(), std::vector<float>{1});
}

TEST(Npz, saysWhatIsMissing) {
    Folder folder;
    writeNpz(folder / "s.npz", sample(), false);
    const Npz npz = readNpz(folder / "s.npz");
    const std::string message = messageOf<InputError>([&] { npz.at("betas"); });
    EXPECT_NE(message.find("s.npz"), std::string::npos) << message;
    EXPECT_NE(message.find("'betas'"), std::string::npos) << message;
    EXPECT_NE(message.find("floats, doubles"), std::string::npos) << message;
    EXPECT_NE(messageOf<InputError>([&] { readNpz(folder / "no.npz"); }).find("No such file"),
              std::string::npos);
    EXPECT_THROW(readNpz(folder.path()), InputError);
    folder.write("text.npz", std::string("hello, this is not a zip file at all"));
    EXPECT_NE(messageOf<InputError>([&] { readNpz(folder / "text.npz"); }).find("found other"),
              std::string::npos);
}

TEST(Npz, conversionsCheckRangeAndType) {
    EXPECT_EQ(Array::f64({1}, std::vector<double>{0.5}).toF32(), std::vector<float>{0.5f});
    EXPECT_EQ(Array::i64({1}, std::vector<int64_t>{-3}).toI32(), std::vector<int32_t>{-3});
    EXPECT_EQ(Array::u8({1}, std::vector<uint8_t>{255}).toF32(), std::vector<float>{255});
    const std::string range = messageOf<InputError>([] {
        Array::i64({2}, std::vector<int64_t>{0, int64_t{1} << 40}).toI32("faces");
    });
    EXPECT_EQ(range, "faces: expected 32-bit integers, found 1099511627776 at element 1");
    EXPECT_EQ(messageOf<InputError>([] { Array::scalarF32(1).toI32("faces"); }),
              "faces: expected integers, found float32");
    EXPECT_NE(messageOf<InputError>([] { Array::scalarF64(1e300).toF32("x"); }).find("range"),
              std::string::npos);
    EXPECT_TRUE(
        std::isinf(Array::scalarF64(std::numeric_limits<double>::infinity()).toF32().front()));
    EXPECT_THROW(Array::text("x").toF32(), InputError);
    EXPECT_THROW(Array::scalarF32(1).toText(), InputError);
    EXPECT_THROW(Array::f32({2}, std::vector<float>{1, 2}).scalar(), InputError);
    EXPECT_EQ(Array::scalarF64(3).integer(), 3);
    EXPECT_EQ(messageOf<InputError>([] { Array::scalarF64(2.5).integer("stride"); }),
              "stride: expected a whole number, found 2.5");
    EXPECT_THROW(Array::scalarF64(NAN).integer(), InputError);
    const Array matrix = Array::f32({2, 3}, std::vector<float>(6));
    EXPECT_EQ(&matrix.requireShape({-1, 3}), &matrix);
    EXPECT_EQ(messageOf<InputError>([&] {
                  matrix.requireShape({-1, 4}, "v");
              }),
              "v: expected shape [any, 4], found [2, 3]");
}

TEST(Npy, typesOrdersAndVersions) {
    Folder folder;
    const auto read = [&](std::string header, const std::vector<uint8_t>& data, int version = 1) {
        folder.write("a.npy", npy(std::move(header), data, version));
        return readNpy(folder / "a.npy");
    };
    EXPECT_EQ(read("{'descr': '>i4', 'fortran_order': False, 'shape': (2,), }",
                   {0, 0, 1, 0, 0xFF, 0xFF, 0xFF, 0xFE})
                  .toI32(),
              (std::vector<int32_t>{256, -2}));
    EXPECT_EQ(read("{'descr': '|u1', 'fortran_order': True, 'shape': (2, 3), }", {0, 3, 1, 4, 2, 5})
                  .toI32(),
              (std::vector<int32_t>{0, 1, 2, 3, 4, 5}));
    EXPECT_EQ(
        read("{'descr': '|u1', 'fortran_order': True, 'shape': (2, 1, 2), }", {0, 2, 1, 3}).toI32(),
        (std::vector<int32_t>{0, 1, 2, 3}));
    EXPECT_EQ(
        read("{'descr': '<f2', 'fortran_order': False, 'shape': (4L,), }",
             {0, 0x3C, 0, 0xC0, 1, 0, 0, 0x7C})
            .toF32(),
        (std::vector<float>{1, -2, std::ldexp(1.0f, -24), std::numeric_limits<float>::infinity()}));
    EXPECT_EQ(read("{'shape': (3,), 'fortran_order': False, 'descr': '|b1'}", {1, 0, 1}, 2).toI32(),
              (std::vector<int32_t>{1, 0, 1}));
    EXPECT_EQ(read("{'descr': '|S6', 'fortran_order': False, 'shape': (), }",
                   {'m', 'a', 'l', 'e', 0, 0}, 3)
                  .toText(),
              "male");
    EXPECT_EQ(read("{'descr': '>U2', 'fortran_order': False, 'shape': (), }",
                   {0, 0, 0, 'h', 0, 0, 0, 0xEB})
                  .toText(),
              "hë");
    // Python objects: the array is listed, its content is refused by name.
    const Array objects = read("{'descr': '|O', 'fortran_order': False, 'shape': (), }", {1, 2, 3});
    EXPECT_EQ(objects.bytes, (std::vector<uint8_t>{1, 2, 3})) << "the pickle, as data";
    EXPECT_NE(messageOf<InputError>([&] { objects.toF32(); })
                  .find("a.npy: expected numbers, found "
                        "Python objects (|O)"),
              std::string::npos);
    const Array records = read(
        "{'descr': [('x', '<f4'), ('y', '<i4', (2,))], 'fortran_order': False, 'shape': (1,), }",
        std::vector<uint8_t>(12));
    EXPECT_EQ(records.dtype, DType::other);
}

TEST(Npy, refusesBrokenHeaders) {
    Folder folder;
    const std::vector<uint8_t> four(4);
    for (const char* header : {
             "",
             "{}",
             "{'descr': '<f4', 'fortran_order': False}",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)",
             "{'descr': '<f4', 'fortran_order': 0, 'shape': (1,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (1 1), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296), }",
             "{'descr': '<f8', 'fortran_order': False, 'shape': (2305843009213693953,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'x': 1}",
             "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1,), }",
             "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), } + exit()",
             "{'descr': '<U0', 'fortran_order': False, 'shape': (1099511627776,), }",
         }) {
        folder.write("bad.npy", npy(header, four));
        EXPECT_THROW(readNpy(folder / "bad.npy"), InputError) << header;
    }
}

TEST(Numbers, HalvesAndNarrowing) {
    EXPECT_EQ(halfToFloat(0x3c00), 1);
    EXPECT_EQ(halfToFloat(0xc580), -5.5f);
    EXPECT_EQ(halfToFloat(0x7bff), 65504);
    EXPECT_EQ(halfToFloat(0x0001), std::ldexp(1.f, -24));
    EXPECT_EQ(halfToFloat(0x83ff), -1023 * std::ldexp(1.f, -24));
    EXPECT_EQ(halfToFloat(0xfc00), -INFINITY);
    EXPECT_TRUE(std::isnan(halfToFloat(0x7e00)));
    EXPECT_TRUE(std::signbit(halfToFloat(0x8000)));
    EXPECT_EQ(bfloat16ToFloat(0x3f80), 1);
    EXPECT_EQ(bfloat16ToFloat(0xc0b0), -5.5f);
    EXPECT_EQ(u32(0xffffffff), 0xffffffffu);
    EXPECT_DEATH(u32(int64_t{1} << 32), "4294967296 fits into 32 bits");
    EXPECT_DEATH(u32(-1), "-1 fits into 32 bits");
}

TEST(Deflate, UnpacksWhatItPacked) {
    std::vector<uint8_t> bytes(3 << 20);
    for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = uint8_t(i % 251 ^ i >> 12);
    const std::span<const uint8_t> all(bytes);
    const std::vector<std::span<const uint8_t>> parts{all.first(7), {}, all.subspan(7)};
    std::vector<uint8_t> packed = deflate(parts, 4);
    EXPECT_LT(packed.size(), bytes.size());
    const size_t size = packed.size();
    packed.insert(packed.end(), {1, 2, 3});  // somebody else's
    std::vector<uint8_t> back;
    const auto take = [&](std::span<const uint8_t> more) {
        EXPECT_LE(more.size(), size_t{1} << 20);
        back.insert(back.end(), more.begin(), more.end());
    };
    EXPECT_EQ(inflate(packed, Packing::raw, "x", take), size);
    EXPECT_EQ(back, bytes);
    EXPECT_EQ(messageOf<InputError>(
                  [&] { inflate(std::span(packed).first(size / 2), Packing::raw, "x", take); }),
              "x: its packed bytes are damaged or cut short");
    // take() ends it.
    EXPECT_THROW(
        inflate(packed, Packing::raw, "x", [](std::span<const uint8_t>) { throwInput("enough"); }),
        InputError);
}

TEST(Npz, refusesHostileZips) {
    Folder folder;
    const auto data =
        npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", {0, 0, 0, 0});
    const auto refusal = [&](const std::vector<uint8_t>& file, const NpzLimits& limits = {}) {
        folder.write("bad.npz", file);
        const std::string message =
            messageOf<InputError>([&] { readNpz(folder / "bad.npz", limits); });
        EXPECT_NE(message.find("bad.npz"), std::string::npos) << message;
        return message;
    };
    EXPECT_NE(refusal(zip({{.name = "a.npy", .data = data},
                           {.name = "b.npy", .data = data, .sameOffset = true}}))
                  .find("overlap"),
              std::string::npos);
    EXPECT_NE(refusal(zip({{.name = "a.npy", .data = data}, {.name = "a.npy", .data = data}}))
                  .find("twice"),
              std::string::npos);
    EXPECT_NE(
        refusal(zip({{.name = "a.npy", .data = data, .claimed = 0xF0000000}})).find("cut short"),
        std::string::npos);
    EXPECT_NE(refusal(zip({{.name = "a.npy", .data = data, .flags = 1}})).find("encrypted"),
              std::string::npos);
    std::vector<uint8_t> wrongCrc = zip({{.name = "a.npy", .data = data}});
    wrongCrc[30 + 5 + data.size() - 1] ^= 1;
    EXPECT_NE(refusal(wrongCrc).find("CRC"), std::string::npos);

    // 64 MiB of zeros in 64 KiB: honest below the limit, a bomb above it.
    Npz zeros;
    zeros.set("z", Array::u8({64 << 20}, std::vector<uint8_t>(64 << 20)));
    writeNpz(folder / "zeros.npz", zeros, true);
    EXPECT_EQ(readNpz(folder / "zeros.npz").at("z").count(), 64 << 20);
    const auto bytes = readWholeFile(folder / "zeros.npz");
    EXPECT_LT(bytes.size(), 100'000u);
    EXPECT_NE(refusal(bytes, {.maxInflated = 1 << 20}).find("zip bomb"), std::string::npos);
    EXPECT_NE(refusal(bytes, {.maxTotal = 1 << 20}).find("at most"), std::string::npos);
    EXPECT_NE(refusal(bytes, {.maxFile = 1 << 10}).find("at most"), std::string::npos);
    // The directory claims fewer bytes than the stream holds.
    std::vector<uint8_t> small = bytes;
    const size_t at = small.size() - 22 - 46 - 5 + 24;
    const uint32_t claim = 1 << 20;
    std::memcpy(&small[at], &claim, 4);
    EXPECT_NE(refusal(small).find("more than"), std::string::npos);
}

// Every cut and a few thousand damaged bytes: an InputError or an honest result.
TEST(Npz, damageIsRefusedNotFollowed) {
    Folder folder;
    for (const bool compress : {false, true}) {
        writeNpz(folder / "whole.npz", sample(), compress);
        const std::vector<uint8_t> whole = readWholeFile(folder / "whole.npz");
        for (size_t size = 0; size < whole.size(); ++size) {
            EXPECT_THROW(npzFromBytes(std::span(whole).first(size), "cut"), InputError) << size;
        }
        std::mt19937 random(7);
        for (int round = 0; round < 3000; ++round) {
            std::vector<uint8_t> damaged = whole;
            for (int i = 0; i <= round % 3; ++i) {
                damaged[random() % damaged.size()] = static_cast<uint8_t>(random());
            }
            try {
                for (const auto& [name, array] : npzFromBytes(damaged, "damaged")) {
                    if (array.isNumber()) array.toF64();
                }
            } catch (const InputError&) {
            }
        }
    }
}

TEST(Npy, damageIsRefusedNotFollowed) {
    Folder folder;
    writeNpy(folder / "whole.npy", sample().at("floats"));
    const std::vector<uint8_t> whole = readWholeFile(folder / "whole.npy");
    EXPECT_EQ(readNpy(folder / "whole.npy").toF32(), sample().at("floats").toF32());
    EXPECT_EQ((whole.size() - 24) % 64, 0u) << "elements start at a multiple of 64";
    std::mt19937 random(3);
    for (size_t size = 0; size < whole.size(); ++size) {
        EXPECT_THROW(npyFromBytes(std::span(whole).first(size), "cut"), InputError) << size;
        for (int round = 0; round < 20; ++round) {
            std::vector<uint8_t> damaged = whole;
            damaged[size] = static_cast<uint8_t>(random());
            try {
                const Array array = npyFromBytes(damaged, "damaged");
                if (array.isNumber()) array.toF64();
            } catch (const InputError&) {
            }
        }
    }
}

TEST(AtomicFile, leavesNothingWithoutCommit) {
    Folder folder;
    folder.write("target.txt", std::string("old"));
    {
        AtomicFile file(folder / "target.txt");
        file.write("new");
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"target.txt"});
    EXPECT_EQ(readWholeFile(folder / "target.txt"), (std::vector<uint8_t>{'o', 'l', 'd'}));
    AtomicFile file(folder / "target.txt");
    file.write("new");
    file.commit();
    EXPECT_EQ(readWholeFile(folder / "target.txt"), (std::vector<uint8_t>{'n', 'e', 'w'}));
    EXPECT_EQ(folder.names(), std::vector<std::string>{"target.txt"});
}

TEST(AtomicFile, anInterruptCanCleanUp) {
    Folder folder;
    folder.write("target.txt", std::string("old"));
    AtomicFile first(folder / "target.txt"), second(folder / "other.txt");
    second.write("done");
    second.commit();
    EXPECT_EQ(folder.names().size(), 3u);
    removeTemporaryFiles();  // as the handler does, just before the process ends
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"other.txt", "target.txt"}));
}

TEST(AtomicFile, saysWhyItCannot) {
    Folder folder;
    EXPECT_NE(
        messageOf<InputError>([&] { AtomicFile(folder / "no" / "x.npz"); }).find("does not exist"),
        std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] { AtomicFile{folder.path()}; }).find("is a folder"),
              std::string::npos);
    EXPECT_THROW(AtomicFile("/dev/null"), InputError) << "a device must not be renamed over";
    if (access("/dev/full", F_OK) == 0) {
        folder.link("/dev/full", "full");
        EXPECT_THROW(AtomicFile(folder / "full"), InputError);
    }
    // A link stays a link.
    folder.write("real.txt", std::string("old"));
    folder.link("real.txt", "link.txt");
    writeWholeFile(folder / "link.txt", std::vector<uint8_t>{'n'});
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "link.txt"));
    EXPECT_EQ(readWholeFile(folder / "real.txt"), std::vector<uint8_t>{'n'});
    if (geteuid() != 0) {
        chmod(folder.path().c_str(), 0500);
        EXPECT_THROW(AtomicFile(folder / "x.npz"), MachineError);
        chmod(folder.path().c_str(), 0700);
    }
}

}  // namespace
}  // namespace doppel
