#include "engine/files/npz.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <unordered_set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"
#include "engine/files/zip.h"

namespace doppel {
namespace {

// ---- .npy ---------------------------------------------------------------------------------------

struct NpyHeader {
    std::string descr;
    bool fortranOrder = false;
    std::vector<int64_t> shape;
    size_t dataOffset = 0;
};

// The header's dictionary: {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }
class HeaderParser {
public:
    HeaderParser(std::string_view text, const std::string& where) : text_(text), where_(where) {}

    void parse(NpyHeader& header) {
        bool haveDescr = false, haveOrder = false, haveShape = false;
        expect('{');
        while (!accept('}')) {
            const std::string key = quoted();
            expect(':');
            if (key == "descr" && !haveDescr) {
                haveDescr = true;
                header.descr = peek() == '[' ? bracketed() : quoted();
            } else if (key == "fortran_order" && !haveOrder) {
                haveOrder = true;
                header.fortranOrder = boolean();
            } else if (key == "shape" && !haveShape) {
                haveShape = true;
                header.shape = tuple();
            } else {
                bad();
            }
            if (!accept(',') && peek() != '}') bad();
        }
        skipSpace();
        if (position_ != text_.size() || !haveDescr || !haveOrder || !haveShape) bad();
    }

private:
    [[noreturn]] void bad() const {
        throwInput("{}: the .npy header is not as NumPy writes it (near byte {})", where_,
                   position_);
    }
    void skipSpace() {
        while (position_ < text_.size() && (text_[position_] == ' ' || text_[position_] == '\n')) {
            ++position_;
        }
    }
    char peek() {
        skipSpace();
        return position_ < text_.size() ? text_[position_] : '\0';
    }
    bool accept(char c) {
        if (peek() != c) return false;
        ++position_;
        return true;
    }
    void expect(char c) {
        if (!accept(c)) bad();
    }
    std::string quoted() {
        const char quote = peek();
        if (quote != '\'' && quote != '"') bad();
        const size_t end = text_.find(quote, ++position_);
        if (end == std::string_view::npos) bad();
        std::string value(text_.substr(position_, end - position_));
        if (value.find('\\') != std::string::npos) bad();
        position_ = end + 1;
        return value;
    }
    // A structured type: kept as text only, to be named in an error.
    std::string bracketed() {
        const size_t begin = position_;
        int depth = 0;
        for (; position_ < text_.size(); ++position_) {
            const char c = text_[position_];
            if (c == '[') ++depth;
            if (c == ']' && --depth == 0) {
                ++position_;
                return std::string(text_.substr(begin, position_ - begin));
            }
        }
        bad();
    }
    bool boolean() {
        skipSpace();
        for (const auto& [word, value] : {std::pair{"True", true}, std::pair{"False", false}}) {
            if (text_.substr(position_).starts_with(word)) {
                position_ += std::strlen(word);
                return value;
            }
        }
        bad();
    }
    std::vector<int64_t> tuple() {
        std::vector<int64_t> sizes;
        expect('(');
        while (!accept(')')) {
            if (sizes.size() == 32) bad();  // NumPy's own limit
            const char first = peek();
            if (first < '0' || first > '9') bad();
            int64_t value = 0;
            while (position_ < text_.size() && text_[position_] >= '0' && text_[position_] <= '9') {
                if (value > (std::numeric_limits<int64_t>::max() - 9) / 10) bad();
                value = value * 10 + (text_[position_++] - '0');
            }
            if (position_ < text_.size() && text_[position_] == 'L')
                ++position_;  // Python 2's long
            sizes.push_back(value);
            if (!accept(',') && peek() != ')') bad();
        }
        return sizes;
    }

    std::string_view text_;
    const std::string& where_;
    size_t position_ = 0;
};

NpyHeader parseNpyHeader(std::span<const uint8_t> file, const std::string& where) {
    constexpr uint8_t kMagic[] = {0x93, 'N', 'U', 'M', 'P', 'Y'};
    if (file.size() < 10 || !std::equal(std::begin(kMagic), std::end(kMagic), file.begin())) {
        throwInput("{}: expected a NumPy array (.npy), found other content or {} bytes only", where,
                   file.size());
    }
    const int version = file[6];
    if (version < 1 || version > 3) {
        throwInput("{}: .npy version {}; expected 1, 2 or 3", where, version);
    }
    const size_t start = version == 1 ? 10 : 12;
    if (file.size() < start) throwInput("{}: cut short in the .npy header", where);
    const size_t length =
        version == 1 ? loadAt<uint16_t>(&file[8], 0) : loadAt<uint32_t>(&file[8], 0);
    if (length > file.size() - start) throwInput("{}: cut short in the .npy header", where);
    NpyHeader header;
    const std::string_view text(reinterpret_cast<const char*>(&file[0]) + start, length);
    HeaderParser(text, where).parse(header);
    header.dataOffset = start + length;
    return header;
}

// Header only; the elements follow as they are in Array::bytes, those of text as in `data`.
std::string makeNpyHeader(const Array& array, std::vector<uint8_t>& data) {
    const std::string descr = rawTypeOf(array, data);
    std::string shape = "(";
    for (size_t i = 0; i < array.shape.size(); ++i) {
        shape += fmt::format("{}{}", i > 0 ? ", " : "", array.shape[i]);
    }
    if (array.shape.size() == 1) shape += ",";
    shape += ")";
    std::string text =
        fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", descr, shape);
    // Data starts at a multiple of 64, as NumPy has it for memory maps.
    const size_t unpadded = 10 + text.size() + 1;
    text.append((64 - unpadded % 64) % 64, ' ');
    text += '\n';
    std::string header = "\x93NUMPY\x01";
    header += '\0';
    header += static_cast<char>(text.size() & 255);
    header += static_cast<char>(text.size() >> 8);
    return header + text;
}

}  // namespace

// ---- Npz ----------------------------------------------------------------------------------------

const Array* Npz::find(std::string_view name) const {
    for (const auto& [key, array] : arrays_) {
        if (key == name) return &array;
    }
    return nullptr;
}

const Array& Npz::at(std::string_view name) const {
    if (const Array* array = find(name)) return *array;
    std::string present;
    for (size_t i = 0; i < arrays_.size() && i < 20; ++i) {
        present += (i > 0 ? ", " : "") + arrays_[i].first;
    }
    if (arrays_.size() > 20) present += ", …";
    throwInput("{}: expected an array '{}', found {}", file.empty() ? "npz" : file, name,
               present.empty() ? "none" : present);
}

void Npz::set(std::string name, Array array) {
    for (auto& [key, old] : arrays_) {
        if (key == name) {
            old = std::move(array);
            return;
        }
    }
    arrays_.emplace_back(std::move(name), std::move(array));
}

void Npz::remove(std::string_view name) {
    std::erase_if(arrays_, [&](const auto& entry) { return entry.first == name; });
}

Npz readNpz(const std::filesystem::path& path, const NpzLimits& limits) {
    return npzFromBytes(readWholeFile(path, limits.maxFile), path.string(), limits);
}

Npz npzFromBytes(std::span<const uint8_t> file, const std::string& name, const NpzLimits& limits) {
    Npz npz;
    npz.file = name;
    std::unordered_set<std::string> seen;
    const ZipLimits zipLimits{limits.maxTotal, limits.maxInflated, limits.maxArrays};
    for (const ZipEntry& entry : zipEntries(file, {}, name, zipLimits)) {
        if (!entry.name.ends_with(".npy")) continue;
        const std::string key =
            printable(std::string_view(entry.name).substr(0, entry.name.size() - 4));
        const std::string where = name + ": " + key;
        if (!seen.insert(key).second) throwInput("{}: stands twice in the file", where);
        npz.set(key, npyFromBytes(unpackZip(file, entry, where), where));
    }
    return npz;
}

void writeNpz(const std::filesystem::path& path, const Npz& npz, bool compress) {
    ZipWriter zip(path);
    for (const auto& [key, array] : npz) {
        CHECK(!key.empty(), "an array has a name");
        std::vector<uint8_t> widened;
        const std::string header = makeNpyHeader(array, widened);
        zip.add(key + ".npy",
                {std::span(reinterpret_cast<const uint8_t*>(header.data()), header.size()),
                 array.dtype == DType::text ? widened : array.bytes},
                compress);
    }
    zip.commit();
}

Array readNpy(const std::filesystem::path& path, const NpzLimits& limits) {
    return npyFromBytes(readWholeFile(path, std::min(limits.maxFile, limits.maxTotal)),
                        path.string());
}

Array npyFromBytes(std::span<const uint8_t> file, const std::string& where) {
    NpyHeader header = parseNpyHeader(file, where);
    return arrayFromRaw(header.descr, std::move(header.shape), header.fortranOrder,
                        file.subspan(header.dataOffset), where);
}

void writeNpy(const std::filesystem::path& path, const Array& array) {
    std::vector<uint8_t> widened;
    const std::string header = makeNpyHeader(array, widened);
    const std::vector<uint8_t>& data = array.dtype == DType::text ? widened : array.bytes;
    AtomicFile out(path);
    out.write(header);
    out.write(data.data(), data.size());
    out.commit();
}

}  // namespace doppel
