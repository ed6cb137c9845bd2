// SPIR-V modules as words: what reflection and rewriting share.
#pragma once

#include <cstdint>

#include "engine/error.h"
#include "engine/shader_table.h"

namespace doppel::spirv {

// The few opcodes that are looked for (SPIR-V specification, section 3).
enum Op : uint32_t {
    kOpName = 5,
    kOpCapability = 17,
    kOpTypeInt = 21,
    kOpTypeFloat = 22,
    kOpTypeVector = 23,
    kOpTypeArray = 28,
    kOpTypePointer = 32,
    kOpConstant = 43,
    kOpSpecConstant = 50,
    kOpSpecConstantComposite = 51,
    kOpSpecConstantOp = 52,
    kOpFunction = 54,
    kOpVariable = 59,
    kOpLoad = 61,
    kOpAccessChain = 65,
    kOpDecorate = 71,
    kOpMemberDecorate = 72,
    kOpCompositeExtract = 81,
    kOpIAdd = 128,
    kOpISub = 130,
    kOpIMul = 132,
    kOpUDiv = 134,
    kOpTypeCooperativeMatrix = 4456,
};
constexpr uint32_t kHeaderWords = 5;

struct Instruction {
    const uint32_t* words;  // the first holds length and opcode
    uint32_t op, length;
    uint32_t operator[](uint32_t i) const { return words[i]; }
    // A string from word i on.
    const char* text(uint32_t i) const { return reinterpret_cast<const char*>(words + i); }
};

// Calls visit(Instruction) for each, in order.
template <typename Visit>
void eachInstruction(SpirvRange module, Visit visit) {
    for (const uint32_t* word = module.begin + kHeaderWords; word < module.end;) {
        Instruction i{word, *word & 0xffff, *word >> 16};
        CHECK(i.length > 0 && word + i.length <= module.end, "SPIR-V instructions fill the module");
        visit(i);
        word += i.length;
    }
}

}  // namespace doppel::spirv
