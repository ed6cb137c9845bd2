// The one door to every op: its declaration, and how to run it on arrays.
//
//     static const Op kLinear{{
//         .name = "linear",
//         .inputs = "x[V,I] weight[O,I] bias[O]",
//         .outputs = "y",
//         .differentiable = "x weight bias",
//         .build = [](OpCall& c) { c.result("y", linear(c.graph, c["x"], c["weight"], c["bias"]));
//         },
//     }};
//
// A declaration in nn/<family>.cpp is all that op_runner and the tests need to know an op. Inputs:
// name[dimensions], a dimension being a letter (bound at first sight, checked afterwards) or a
// number; no brackets: any shape; ":i32" behind the name: integers; "?" at the end: optional.
// Attributes: name, or name=default.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "engine/files/npz.h"
#include "nn/core/graph.h"

namespace doppel {

// What a declaration's build function is given.
struct OpCall {
    Graph& graph;
    std::map<std::string, Tensor, std::less<>> tensors;
    std::map<std::string, std::vector<int32_t>, std::less<>> integers;
    std::map<std::string, Shape, std::less<>> shapes;
    std::map<std::string, double, std::less<>> attributes;
    std::vector<std::pair<std::string, Tensor>> results;

    // An input; an empty tensor where an optional one is not given.
    Tensor operator[](std::string_view name) const;
    // An integer input's values on the host (its tensor is there as well).
    const std::vector<int32_t>& ints(std::string_view name) const;
    double attribute(std::string_view name) const;
    float f(std::string_view name) const { return static_cast<float>(attribute(name)); }
    // A whole number from 0 on; InputError otherwise.
    uint32_t u(std::string_view name) const;
    void result(std::string name, Tensor tensor) {
        results.emplace_back(std::move(name), std::move(tensor));
    }
};

struct OpDeclaration {
    std::string name, inputs, attributes, outputs, differentiable;
    std::function<void(OpCall&)> build;
};

class Op {
public:
    struct Input {
        std::string name;
        std::vector<std::string> dims;
        bool anyShape = false, optional = false, integer = false, differentiable = false;
    };
    struct Attribute {
        std::string name;
        std::optional<double> fallback;
    };

    // Registers itself; declared as a constant of a source file.
    explicit Op(OpDeclaration declaration);

    const OpDeclaration& declaration() const { return declaration_; }
    const std::string& name() const { return declaration_.name; }
    const std::vector<Input>& inputs() const { return inputs_; }
    const std::vector<Attribute>& attributes() const { return attributes_; }
    const std::vector<std::string>& outputs() const { return outputs_; }

    static const std::vector<const Op*>& all();  // by name
    static const Op* find(std::string_view name);

    // Runs forward and, where the arrays hold grad_<output>, backward. Arrays: inputs by name,
    // attr_<attribute>, grad_<output>. Returns outputs by name and grad_<input> for every
    // differentiable input. InputError names what is missing or wrong.
    Npz run(Device& device, const Npz& arrays, const CompileOptions& options) const;

private:
    OpDeclaration declaration_;
    std::vector<Input> inputs_;
    std::vector<Attribute> attributes_;
    std::vector<std::string> outputs_;
};

}  // namespace doppel
