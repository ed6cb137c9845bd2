// Byte strings that are put away once and read at will.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace doppel {

// Those that fit into the budget are kept in memory, those after them in a file without a name, in
// TMPDIR or else in /var/tmp, which is gone with the process however that ends.
class ByteStore {
public:
    explicit ByteStore(uint64_t memoryBudget) : budget_(memoryBudget) {}
    ~ByteStore();
    ByteStore(ByteStore&& other) noexcept;
    ByteStore& operator=(ByteStore&&) = delete;

    // Returns its number, from 0. MachineError where the file cannot be written.
    size_t add(std::span<const uint8_t> bytes);
    // By any thread. MachineError where the file cannot be read.
    std::vector<uint8_t> read(size_t which) const;

    uint64_t bytesInMemory() const { return inMemory_; }
    uint64_t bytesInFile() const { return inFile_; }

private:
    struct Entry {
        std::vector<uint8_t> bytes;    // empty where it is in the file,
        uint64_t place = 0, size = 0;  // here
    };
    std::vector<Entry> entries_;
    uint64_t budget_, inMemory_ = 0, inFile_ = 0;
    int file_ = -1;
};

}  // namespace doppel
