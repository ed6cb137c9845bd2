#include "engine/io/safetensors.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <unordered_set>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/json_depth.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"

namespace doppel {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kMaxHeader = 100'000'000;  // as the format's own library has it
constexpr uint64_t kMaxFile = uint64_t{64} << 30;

std::string shapeText(std::span<const int64_t> shape) {
    return fmt::format("[{}]", fmt::join(shape, ", "));
}

// Names given twice are refused while parsing: nlohmann's parser would forget the first.
Json parseHeader(std::string_view text, const std::string& file) {
    requireShallowJson(text, file);
    std::vector<std::unordered_set<std::string>> names;
    std::string twice;
    const auto callback = [&](int, Json::parse_event_t event, Json& parsed) {
        if (event == Json::parse_event_t::object_start) names.emplace_back();
        if (event == Json::parse_event_t::object_end && !names.empty()) names.pop_back();
        if (event == Json::parse_event_t::key && !names.empty() &&
            !names.back().insert(parsed.get<std::string>()).second) {
            twice = parsed.get<std::string>();
        }
        return true;
    };
    Json header = Json::parse(text, callback, /*allow_exceptions=*/false);
    if (!twice.empty()) throwInput("{}: '{}' stands twice in the header", file, printable(twice));
    if (header.is_discarded() || !header.is_object()) {
        throwInput("{}: its header is not the JSON of a safetensors file", file);
    }
    return header;
}

int64_t wholeNumber(const Json& value, const std::string& where) {
    if (!value.is_number_integer() || value < 0 ||
        (value.is_number_unsigned() &&
         value.get<uint64_t>() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max()))) {
        throwInput("{}: expected sizes and offsets of 0 or more", where);
    }
    return value.get<int64_t>();
}

size_t itemSize(std::string_view dtype, const std::string& where) {
    if (dtype == "F32") return 4;
    if (dtype == "F16" || dtype == "BF16") return 2;
    if (dtype == "F64") return 8;
    throwInput("{}: type {}; expected F32, F16, BF16 or F64", where, printable(dtype));
}

// Of what can be left out; 0: of no known type.
size_t otherItemSize(std::string_view dtype) {
    if (dtype == "I64" || dtype == "U64") return 8;
    if (dtype == "I32" || dtype == "U32") return 4;
    if (dtype == "I16" || dtype == "U16") return 2;
    if (dtype == "I8" || dtype == "U8" || dtype == "BOOL") return 1;
    return 0;
}

std::vector<float> convert(std::string_view dtype, std::span<const uint8_t> bytes) {
    std::vector<float> values(bytes.size() / itemSize(dtype, {}));
    const auto loop = [&]<typename T>(T, auto toFloat) {
        for (size_t i = 0; i < values.size(); ++i) {
            T raw;
            std::memcpy(&raw, &bytes[i * sizeof(T)], sizeof(T));
            values[i] = toFloat(raw);
        }
    };
    if (dtype == "F32") {
        if (!bytes.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
    } else if (dtype == "F64") {
        loop(double{}, [](double raw) { return static_cast<float>(raw); });
    } else if (dtype == "F16") {
        loop(uint16_t{}, halfToFloat);
    } else {
        loop(uint16_t{}, bfloat16ToFloat);
    }
    return values;
}

}  // namespace

const Tensor32& Safetensors::at(std::string_view name) const {
    const auto it = tensors.find(std::string(name));
    if (it == tensors.end()) {
        throwInput("{}: expected a tensor '{}', found none of this name among {}", file, name,
                   tensors.size());
    }
    return it->second;
}

const Tensor32& Safetensors::at(std::string_view name, std::span<const int64_t> shape) const {
    const Tensor32& tensor = at(name);
    if (!std::equal(shape.begin(), shape.end(), tensor.shape.begin(), tensor.shape.end())) {
        throwInput("{}: {}: expected shape {}, found {}", file, name, shapeText(shape),
                   shapeText(tensor.shape));
    }
    return tensor;
}

Safetensors safetensorsFromBytes(std::span<const uint8_t> file, const std::string& name,
                                 OtherTypes others) {
    uint64_t headerSize = 0;
    if (file.size() < 8)
        throwInput("{}: expected a safetensors file, found {} bytes", name, file.size());
    std::memcpy(&headerSize, file.data(), 8);
    if (headerSize > kMaxHeader) {
        throwInput("{}: expected a safetensors file, found a header of {} bytes (at most {})", name,
                   headerSize, kMaxHeader);
    }
    if (headerSize > file.size() - 8) {
        throwInput("{}: cut short: its header has {} bytes, found {}", name, headerSize,
                   file.size() - 8);
    }
    const std::string_view text(reinterpret_cast<const char*>(file.data()) + 8, headerSize);
    const std::span<const uint8_t> data = file.subspan(8 + headerSize);
    const Json header = parseHeader(text, name);

    Safetensors result;
    result.file = name;
    struct Range {
        uint64_t begin, end;
        std::string dtype;
        Tensor32* tensor;
    };
    std::vector<Range> ranges;
    for (const auto& [key, entry] : header.items()) {
        const std::string where = fmt::format("{}: {}", name, printable(key));
        if (key == "__metadata__") {
            if (!entry.is_object()) throwInput("{}: expected texts by name", where);
            for (const auto& [word, value] : entry.items()) {
                if (!value.is_string()) throwInput("{}: expected texts by name", where);
                result.metadata[word] = value.get<std::string>();
            }
            continue;
        }
        if (!entry.is_object() || !entry.contains("dtype") || !entry["dtype"].is_string() ||
            !entry.contains("shape") || !entry["shape"].is_array() ||
            !entry.contains("data_offsets") || !entry["data_offsets"].is_array() ||
            entry["data_offsets"].size() != 2) {
            throwInput("{}: expected dtype, shape and two data_offsets", where);
        }
        const std::string dtype = entry["dtype"].get<std::string>();
        Tensor32 tensor;
        const bool left = others == OtherTypes::skip && otherItemSize(dtype) > 0;
        uint64_t bytes = left ? otherItemSize(dtype) : itemSize(dtype, where);
        for (const Json& size : entry["shape"]) {
            tensor.shape.push_back(wholeNumber(size, where));
            if (__builtin_mul_overflow(bytes, static_cast<uint64_t>(tensor.shape.back()), &bytes)) {
                throwInput("{}: its shape is impossible", where);
            }
        }
        const uint64_t begin = static_cast<uint64_t>(wholeNumber(entry["data_offsets"][0], where));
        const uint64_t end = static_cast<uint64_t>(wholeNumber(entry["data_offsets"][1], where));
        if (end > data.size()) {
            throwInput("{}: cut short: it ends at byte {} of the data, found {}", where, end,
                       data.size());
        }
        if (begin > end || end - begin != bytes) {
            throwInput("{}: expected {} bytes for shape {}, found {} to {}", where, bytes,
                       shapeText(tensor.shape), begin, end);
        }
        Tensor32* kept =
            left ? nullptr : &result.tensors.emplace(key, std::move(tensor)).first->second;
        ranges.push_back({begin, end, dtype, kept});
    }
    // The format wants every byte of the data in exactly one tensor; only then is memory taken.
    std::sort(ranges.begin(), ranges.end(), [](const Range& a, const Range& b) {
        return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
    });
    uint64_t reached = 0;
    for (const Range& range : ranges) {
        if (range.begin != reached) {
            throwInput("{}: its tensors overlap or leave a gap at byte {} of the data", name,
                       std::min(range.begin, reached));
        }
        reached = range.end;
    }
    if (reached != data.size()) {
        throwInput("{}: {} bytes after the last tensor; expected none", name,
                   data.size() - reached);
    }
    for (const Range& range : ranges) {
        if (range.tensor == nullptr) continue;
        range.tensor->values =
            convert(range.dtype, data.subspan(range.begin, range.end - range.begin));
    }
    return result;
}

Safetensors readSafetensors(const std::filesystem::path& path) {
    return safetensorsFromBytes(readWholeFile(path, kMaxFile), path.string());
}

void writeSafetensors(const std::filesystem::path& path, const Safetensors& content) {
    Json header = Json::object();
    if (!content.metadata.empty()) header["__metadata__"] = content.metadata;
    uint64_t offset = 0;
    for (const auto& [name, tensor] : content.tensors) {
        CHECK(name != "__metadata__", "a tensor must have another name than the metadata");
        uint64_t count = 1;
        for (const int64_t size : tensor.shape) count *= static_cast<uint64_t>(size);
        CHECK(count == tensor.values.size(), "the values of {} must fill its shape {}", name,
              shapeText(tensor.shape));
        header[name] = {{"dtype", "F32"},
                        {"shape", tensor.shape},
                        {"data_offsets", {offset, offset + count * 4}}};
        offset += count * 4;
    }
    // Names and metadata that are not UTF-8 (file names may be) must not stop a checkpoint.
    std::string text = header.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.append((8 - text.size() % 8) % 8, ' ');  // the data starts aligned
    const uint64_t size = text.size();
    AtomicFile file(path);
    file.write(&size, 8);
    file.write(text);
    for (const auto& [name, tensor] : content.tensors) {
        file.write(tensor.values.data(), tensor.values.size() * sizeof(float));
    }
    file.commit();
}

}  // namespace doppel
