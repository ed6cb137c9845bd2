// What the names in a pickle make: NumPy's arrays, PyTorch's tensors, joblib's arrays, containers,
// and objects that are kept as their state. No name is ever called as code.
#pragma once

#include "engine/io/pickles/pickle_stack.h"

namespace doppel::pickle {

class Objects : protected Stack {
public:
    using Stack::Stack;

protected:
    // InputError for a name that stands for code.
    void pushName(std::string_view module, std::string_view name);

    // What a node is known to be; InputError where it is something else.
    std::string_view textOf(uint32_t node) const;
    Name nameOf(uint32_t node) const;
    std::vector<uint32_t> argumentsOf(uint32_t node) const;

    // function(*arguments), for the few functions that make data.
    uint32_t call(Name function, const std::vector<uint32_t>& arguments);

    // Gives the value below its state.
    void build(uint32_t node, uint32_t state);

    // ("storage", type, key, device, elements, …)
    uint32_t torchStorage(uint32_t id);

private:
    uint32_t makeInstance(Name name);
    std::vector<int64_t> shapeOf(uint32_t node) const;
    bool truthOf(uint32_t node) const;
    void fillArray(uint32_t node, uint32_t dtype, std::vector<int64_t> shape, bool fortran,
                   std::span<const uint8_t> data);
    const Node* attribute(uint32_t dict, std::string_view name) const;

    // joblib puts an array's bytes right behind the object that describes it.
    void readJoblibArray(uint32_t node, uint32_t dict);
};

}  // namespace doppel::pickle
