// Pickles, npz of objects and PyTorch files as Python's programs write them, for tests of readers.
// Values are the bytes that push them; they go into one another.
//
//     write("a.pkl", py::pickle(py::dict({{py::text("pose"), py::array({2, 72}, numbers)}})));
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/files/zip.h"

namespace doppel::test::py {

using Value = std::string;

inline std::string little(uint64_t number, int bytes) {
    std::string text;
    for (int i = 0; i < bytes; ++i) text += static_cast<char>(number >> (8 * i));
    return text;
}
inline Value none() { return "N"; }
inline Value integer(int64_t number) { return "J" + little(static_cast<uint64_t>(number), 4); }
inline Value real(double number) {
    uint64_t bits = 0;
    std::memcpy(&bits, &number, 8);
    std::string big = little(bits, 8);
    return "G" + std::string(big.rbegin(), big.rend());
}
inline Value text(const std::string& value) { return "X" + little(value.size(), 4) + value; }
inline Value bytes(const std::string& value) { return "B" + little(value.size(), 4) + value; }
inline Value tuple(const std::vector<Value>& values) {
    std::string all = "(";
    for (const Value& value : values) all += value;
    return all + "t";
}
inline Value list(const std::vector<Value>& values) {
    std::string all = "](";
    for (const Value& value : values) all += value;
    return all + "e";
}
inline Value dict(const std::vector<std::pair<Value, Value>>& values) {
    std::string all = "}(";
    for (const auto& [key, value] : values) all += key + value;
    return all + "u";
}
inline Value sizes(const std::vector<int64_t>& shape) {
    std::vector<Value> values;
    for (const int64_t size : shape) values.push_back(integer(size));
    return tuple(values);
}
inline std::string floats(const std::vector<double>& values) {
    std::string raw;
    for (const double value : values) {
        const auto single = static_cast<float>(value);
        raw.append(reinterpret_cast<const char*>(&single), 4);
    }
    return raw;
}
inline Value dtype(const std::string& name, const std::string& order) {
    return "cnumpy\ndtype\n" + tuple({text(name), "\x89", "\x88"}) + "R" +
           tuple({integer(3), text(order), none(), none(), none(), integer(-1), integer(-1),
                  integer(0)}) +
           "b";
}
// NumPy's arrays of float32, in a pickle of their own.
inline Value array(const std::vector<int64_t>& shape, const std::vector<double>& values) {
    return "cnumpy.core.multiarray\n_reconstruct\n" +
           tuple({"cnumpy\nndarray\n", tuple({integer(0)}), bytes("b")}) + "R" +
           tuple({integer(1), sizes(shape), dtype("f4", "<"), "\x89", bytes(floats(values))}) + "b";
}
// The same as joblib.dump writes them: the elements follow what describes them.
inline Value joblibArray(const std::vector<int64_t>& shape, const std::vector<double>& values) {
    return "cjoblib.numpy_pickle\nNumpyArrayWrapper\n)\x81" +
           dict({{text("subclass"), "cnumpy\nndarray\n"},
                 {text("shape"), sizes(shape)},
                 {text("order"), text("C")},
                 {text("dtype"), dtype("f4", "<")},
                 {text("allow_mmap"), "\x88"}}) +
           "b" + floats(values);
}
inline std::string pickle(const Value& value) { return "\x80\x03" + value + "."; }

inline std::span<const uint8_t> raw(const std::string& text) {
    return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

// np.savez(file, NAME=value) of a Python object.
inline void savezObject(const std::filesystem::path& file, const std::string& name,
                        const Value& value) {
    std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': (), }";
    header.resize(118 - 1, ' ');
    header += '\n';
    const std::string npy = std::string("\x93NUMPY\x01\x00", 8) + little(header.size(), 2) + header;
    const std::string object =
        pickle("cnumpy.core.multiarray\n_reconstruct\n" +
               tuple({"cnumpy\nndarray\n", tuple({integer(0)}), bytes("b")}) + "R" +
               tuple({integer(1), tuple({}), dtype("O8", "|"), "\x89", list({value})}) + "b");
    ZipWriter zip(file);
    zip.add(name + ".npy", {raw(npy), raw(object)}, false);
    zip.commit();
}

// Tensors of one file that torch.save writes.
class Torch {
public:
    Value tensor(const std::vector<int64_t>& shape, const std::vector<double>& values,
                 const char* storage = "FloatStorage") {
        const std::string key = std::to_string(storages_.size());
        std::vector<int64_t> strides(shape.size(), 1);
        for (size_t d = shape.size(); d-- > 1;) strides[d - 1] = strides[d] * shape[d];
        storages_.push_back(floats(values));
        return "ctorch._utils\n_rebuild_tensor_v2\n" +
               tuple({tuple({text("storage"), std::string("ctorch\n") + storage + "\n", text(key),
                             text("cpu"), integer(static_cast<int64_t>(values.size()))}) +
                          "Q",
                      integer(0), sizes(shape), sizes(strides), "\x89",
                      "ccollections\nOrderedDict\n)R"}) +
               "R";
    }
    void save(const std::filesystem::path& file, const Value& value) const {
        ZipWriter zip(file);
        const std::string data = pickle(value);
        zip.add("archive/data.pkl", {raw(data)}, false);
        for (size_t i = 0; i < storages_.size(); ++i)
            zip.add("archive/data/" + std::to_string(i), {raw(storages_[i])}, false);
        const std::string version = "3\n";
        zip.add("archive/version", {raw(version)}, false);
        zip.commit();
    }

private:
    std::vector<std::string> storages_;
};

}  // namespace doppel::test::py
