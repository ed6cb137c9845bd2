// Pickles as data: what NumPy, SciPy, chumpy and joblib write is read, code is refused by name, and
// no damage does more than an InputError.
#include "engine/io/pickle.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

using namespace std::string_literals;
using Kind = PickleValue::Kind;
using test::messageOf;

const std::filesystem::path kPickles = test::sourceFolder() / "tests/pickles";

PickleValue parse(const std::string& text) {
    return pickleFromBytes({reinterpret_cast<const uint8_t*>(text.data()), text.size()}, "p.pkl");
}

std::string refusal(const std::string& text) {
    const std::string message = messageOf<InputError>([&] { parse(text).asArray(); });
    EXPECT_NE(message.find("p.pkl"), std::string::npos) << message;
    return message;
}

// Reads everything that is in a value, whatever it is.
void readAll(const PickleValue& value, int depth = 0) {
    if (depth > 6) return;
    try {
        if (value.kind() == Kind::dict) {
            for (const std::string& key : value.keys()) readAll(value.at(key), depth + 1);
        } else if (value.kind() == Kind::list || value.kind() == Kind::tuple) {
            for (size_t i = 0; i < std::min<size_t>(value.size(), 20); ++i) {
                readAll(value.item(i), depth + 1);
            }
        }
        value.asArray();
    } catch (const InputError&) {
    }
}

// A later pair takes the place of an earlier one of the same key.
TEST(Pickle, pairsInTheFilesOrder) {
    const PickleValue dict = parse("}(X\1\0\0\0bK\1X\1\0\0\0aK\2K\7K\3X\1\0\0\0bK\4u."s);
    std::string pairs;
    dict.eachPair([&](const std::string& key, const PickleValue& value) {
        EXPECT_EQ(value.where(), "p.pkl: " + key);
        EXPECT_EQ(value.asInteger(), dict.at(key).asInteger());
        pairs += key + std::to_string(value.asInteger()) + " ";
    });
    EXPECT_EQ(pairs, "b4 a2 73 ");
    EXPECT_EQ(dict.keys(), (std::vector<std::string>{"b", "a", "7"}));
    EXPECT_THROW(parse("K\1."s).eachPair([](const std::string&, const PickleValue&) {}),
                 InputError);
}

class PickleProtocol : public testing::TestWithParam<int> {};

TEST_P(PickleProtocol, readsWhatPythonWrites) {
    const PickleValue p = readPickle(kPickles / ("protocol" + std::to_string(GetParam()) + ".pkl"));
    ASSERT_EQ(p.kind(), Kind::dict);
    EXPECT_EQ(p.size(), 28u);
    EXPECT_EQ(p.keys().front(), "pose");
    EXPECT_EQ(p.at("pose").asArray().requireShape({3}).toF64(),
              (std::vector<double>{0.1, -2.5, 3e-3}));
    EXPECT_EQ(p.at("faces").asArray().requireShape({2, 3}).toI32(),
              (std::vector<int32_t>{0, 1, 2, 2, 1, 3}));
    EXPECT_EQ(p.at("fortran").asArray().requireShape({2, 3}).toI32(),
              (std::vector<int32_t>{0, 1, 2, 3, 4, 5}));
    EXPECT_EQ(p.at("big").asArray().toF32(), (std::vector<float>{0, 1, 2}));
    EXPECT_EQ(p.at("shapedirs").kind(), Kind::object);
    EXPECT_EQ(p.at("shapedirs").asArray().requireShape({1, 2, 3}).toF32(),
              (std::vector<float>{0, 0.5f, 1, 1.5f, 2, 2.5f}));
    EXPECT_EQ(p.at("select").asArray().requireShape({2, 1}).toF32(), (std::vector<float>{2.5f, 0}));
    for (const char* sparse : {"J_regressor", "csr", "coo"}) {
        EXPECT_EQ(p.at(sparse).asArray().requireShape({2, 4}).toF32(),
                  (std::vector<float>{0, 0.25f, 0, 0.75f, 1, 0, 0, 0}))
            << sparse;
    }
    EXPECT_EQ(p.at("n").asInteger(), 7);
    EXPECT_EQ(p.at("neg").asInteger(), -300);
    EXPECT_EQ(p.at("long").asInteger(), int64_t{1} << 40);
    EXPECT_EQ(p.at("minus").asInteger(), std::numeric_limits<int64_t>::min());
    EXPECT_EQ(p.at("f").asNumber(), 1.5);
    EXPECT_EQ(p.at("yes").kind(), Kind::boolean);
    EXPECT_EQ(p.at("yes").asInteger(), 1);
    EXPECT_EQ(p.at("none").kind(), Kind::none);
    EXPECT_EQ(p.at("scalar").asNumber(), 0.25);
    EXPECT_EQ(p.at("list").asArray().requireShape({3}).toF64(), (std::vector<double>{1, 2.5, 3}));
    EXPECT_EQ(p.at("rows").asArray().requireShape({2, 2}).toI32(),
              (std::vector<int32_t>{1, 2, 3, 4}));
    EXPECT_EQ(p.at("name").asText(), "Zoë");
    EXPECT_EQ(p.at("raw").asText(), "a\0\xff"s);
    EXPECT_EQ(p.at("3").asText(), "three");
    EXPECT_EQ(p.at("nested").at("k").asArray().requireShape({2, 2}).toF32(),
              (std::vector<float>{1, 1, 0, 0}));
    EXPECT_EQ(p.at("empty").asArray().requireShape({0, 3}).count(), 0);
    EXPECT_EQ(p.at("objects").asArray().toF64(), (std::vector<double>{1, 2.5}));
    EXPECT_EQ(p.at("text").asText(), "male");
    EXPECT_EQ(p.at("set").size(), 1u);
    EXPECT_EQ(p.at("counts").at("a").asArray().toI32(), std::vector<int32_t>{1});
    // Errors say where.
    EXPECT_NE(messageOf<InputError>([&] {
                  p.at("nested").at("betas");
              }).find(": nested: expected 'betas' in the dict, found k"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  p.at("none").asArray();
              }).find(": none: expected numbers, found None"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  p.at("pose").asArray().requireShape({72});
              }).find(": pose: expected shape [72], found [3]"),
              std::string::npos);
    EXPECT_THROW(p.at("pose").at("x"), InputError);
    EXPECT_THROW(p.at("list").item(3), InputError);
}

INSTANTIATE_TEST_SUITE_P(All, PickleProtocol, testing::Range(0, 6));

TEST(Pickle, readsJoblib) {
    for (const char* name : {"joblib.pkl", "joblib_zlib.pkl"}) {
        const PickleValue p = readPickle(kPickles / name);
        ASSERT_EQ(p.keys(), std::vector<std::string>{"1"});
        const PickleValue person = p.at("1");
        const std::vector<float> verts =
            person.at("verts").asArray().requireShape({2, 2, 3}).toF32();
        for (size_t i = 0; i < verts.size(); ++i) EXPECT_EQ(verts[i], static_cast<float>(i));
        EXPECT_EQ(person.at("ids").asArray().toI32(), (std::vector<int32_t>{4, 9}));
    }
}

// An npz may hold a pickle as an array of Python objects; its other arrays are read as always.
TEST(Pickle, readsObjectsInsideNpz) {
    const Npz npz = readNpz(kPickles / "objects.npz");
    EXPECT_EQ(npz.at("n").integer(), 3);
    const Array& results = npz.at("results");
    ASSERT_EQ(results.dtype, DType::other);
    const PickleValue value = pickleFromBytes(results.bytes, results.where);
    EXPECT_EQ(value.item(0).at("pose").asArray().toF32(), (std::vector<float>{0, 1, 2}));
    EXPECT_NE(messageOf<InputError>([&] { value.item(0).at("x"); }).find("objects.npz: results[0]"),
              std::string::npos);
}

// Python 2's strings hold an array's bytes directly, as in the official SMPL files.
TEST(Pickle, readsPython2) {
    const PickleValue p = parse(
        "\x80\x02}q\x01(U\x01vq\x02"
        "cnumpy.core.multiarray\n_reconstruct\nq\x03"
        "cnumpy\nndarray\nq\x04K\x00\x85U\x01"
        "bq\x05\x87Rq\x06(K\x01K\x02\x85"
        "cnumpy\ndtype\nq\x07U\x02"
        "f4K\x00K\x01\x87Rq\x08(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
        "\x89U\x08\x00\x00\x80\x3f\x00\x00\x00\xc0tbu."s);
    EXPECT_EQ(p.at("v").asArray().toF32(), (std::vector<float>{1, -2}));
    // Protocol 0's escapes and an old-style object.
    EXPECT_EQ(parse("S'it\\'s\\n\\x41\\\\'\n."s).asText(), "it's\nA\\");
    EXPECT_EQ(parse("V\\u00e9\xe9\n."s).asText(), "éé");
    EXPECT_EQ(parse("(S'x'\nL5L\nd."s).at("x").asInteger(), 5);
}

TEST(Pickle, refusesCodeByName) {
    EXPECT_EQ(refusal("cos\nsystem\n(S'touch /tmp/hacked'\ntR."s),
              "p.pkl: refers to code (os.system); only numeric data is read");
    EXPECT_NE(refusal("\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x02id\x85R."s)
                  .find("refers to code (posix.system)"),
              std::string::npos);
    EXPECT_NE(refusal("(S'id'\nios\nsystem\n."s).find("refers to code (os.system)"),
              std::string::npos);
    EXPECT_NE(refusal("c__builtin__\neval\n(S'1'\ntR."s).find("(__builtin__.eval)"),
              std::string::npos);
    EXPECT_NE(refusal("cbuiltins\ngetattr\n."s).find("(builtins.getattr)"), std::string::npos);
    EXPECT_NE(refusal("\x80\x02\x82\x01."s).find("refers to code"), std::string::npos);
    EXPECT_NE(refusal("Pid\n."s).find("outside the file"), std::string::npos);
    EXPECT_NE(refusal("\x80\x05\x97."s).find("outside the file"), std::string::npos);
    // Known names, used for what they are not meant for.
    EXPECT_THROW(parse("c__builtin__\nlist\n)R."s), InputError);
    EXPECT_THROW(parse("cnumpy\nndarray\n(I3\ntR."s), InputError);
    EXPECT_THROW(parse("c_codecs\nencode\n(S'x'\nS'rot13'\ntR."s), InputError);
    EXPECT_THROW(parse("cnumpy.core.multiarray\n_reconstruct\n(c__builtin__\nobject\ntR."s),
                 InputError);
}

TEST(Pickle, refusesNonsense) {
    for (const std::string& text : {""s,
                                    "."s,
                                    "t."s,
                                    "(."s,
                                    "K"s,
                                    "K\x01"s,
                                    "0."s,
                                    "h\x05."s,
                                    "g9\n."s,
                                    "Kx\x01."s,
                                    "Iabc\n."s,
                                    "F1.5x\n."s,
                                    "S'x\n."s,
                                    "S'\\x4'\n."s,
                                    "\x80\x09K\x01."s,
                                    "K\x01K\x02s."s,
                                    "}K\x01K\x02"s,
                                    "}(K\x01u."s,
                                    "(K\x01"s + "d."s,
                                    "K\x01K\x02R."s,
                                    "]K\x01"s + "b."s,
                                    "]}a(K\x01K\x02u."s,
                                    "B\xff\xff\xff\xffxx."s,
                                    "\x8e\xff\xff\xff\xff\xff\xff\xff\x7fxx."s,
                                    "\x95\xff\xff\xff\xff\xff\xff\xff\xffK\x01."s,
                                    "\x8b\xff\xff\xff\xff."s,
                                    "\xff."s}) {
        EXPECT_THROW(parse(text), InputError) << testing::PrintToString(text);
    }
    EXPECT_NE(refusal("\x8b\x0a\0\0\0aaaaaaaaaa."s).find("more than 64 bits"), std::string::npos);
    EXPECT_NE(refusal("]q\0(K\x01]K\x02"s + "ae."s).find("differ in length"), std::string::npos);
}

// Small files that would take for ever, or all memory, if they were followed.
TEST(Pickle, refusesBombs) {
    // A list that contains itself.
    EXPECT_NE(refusal("]q\x01h\x01"s + "a."s).find("nested more than"), std::string::npos);
    // Lists of lists of lists: 2^30 numbers in a hundred bytes; and the same without any number.
    std::string deep = "(K\x01K\x01l", hollow = "]";
    for (int i = 0; i < 29; ++i) deep += "q\x01(h\x01h\x01l";
    for (int i = 0; i < 30; ++i) hollow += "q\x01(h\x01h\x01l";
    EXPECT_NE(refusal(deep + ".").find("more than"), std::string::npos);
    EXPECT_NE(refusal(hollow + ".").find("more than"), std::string::npos);
    // One long text, encoded a hundred thousand times.
    std::string encode = "c_codecs\nencode\nq\x01"s + "0X"s;
    const uint32_t size = 1'000'000;
    encode.append(reinterpret_cast<const char*>(&size), 4);
    encode.append(size, 'x');
    encode += "q\x02"s + "0U\x06latin1q\x03"s + "0"s;
    for (int i = 0; i < 100'000; ++i) encode += "h\x01(h\x02h\x03tR";
    EXPECT_NE(refusal(encode + ".").find("far more than its own size"), std::string::npos);
    // Opcodes that only pile up values.
    EXPECT_NE(refusal("("s + std::string(5'000'000, 'N') + "l.").find("more than"),
              std::string::npos);
    // Shapes whose product overflows, or whose bytes are not there.
    const std::string array =
        "cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR(I1\n(";
    const std::string rest =
        "tcnumpy\ndtype\n(S'f8'\nI0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntbI00\nS''\ntb.";
    for (const std::string shape :
         {"I4294967296\nI4294967296\n", "I9223372036854775807\n", "I1\n", "I-1\n"}) {
        EXPECT_THROW(parse(array + shape + rest), InputError) << shape;
    }
    EXPECT_EQ(parse(array + "I0\n" + rest).asArray().count(), 0)
        << "the same file with a true shape";
}

TEST(Pickle, damageIsRefusedNotFollowed) {
    std::mt19937 random(5);
    for (const auto& entry : std::filesystem::directory_iterator(kPickles)) {
        if (entry.path().extension() != ".pkl") continue;
        const std::vector<uint8_t> whole = readWholeFile(entry.path());
        for (size_t size = 0; size < whole.size(); ++size) {
            EXPECT_THROW(pickleFromBytes(std::span(whole).first(size), "cut"), InputError)
                << entry.path() << " at " << size;
        }
        for (int round = 0; round < 1000; ++round) {
            std::vector<uint8_t> damaged = whole;
            for (int i = 0; i <= round % 3; ++i) {
                damaged[random() % damaged.size()] = static_cast<uint8_t>(random());
            }
            try {
                readAll(pickleFromBytes(damaged, "damaged"));
            } catch (const InputError&) {
            }
        }
    }
}

TEST(Pickle, readsTheRealCaptures) {
    const std::filesystem::path data = test::sourceFolder() / "../shared/data/retargeting";
    if (!std::filesystem::exists(data)) GTEST_SKIP() << "needs the real captures of ../shared";
    int frames = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(data)) {
        if (entry.path().extension() != ".pkl") continue;
        const PickleValue p = readPickle(entry.path());
        EXPECT_EQ(p.at("betas").asArray().count(), 10) << entry.path();
        if (entry.path().parent_path().filename() != "smpl_pose") continue;
        ++frames;
        EXPECT_EQ(p.at("pose").asArray().count(), 72) << entry.path();
        EXPECT_EQ(p.at("trans").asArray().count(), 3) << entry.path();
        EXPECT_GT(p.at("f").asArray().toF64().front(), 1000) << entry.path();
    }
    EXPECT_EQ(frames, 128);
}

}  // namespace
}  // namespace doppel
