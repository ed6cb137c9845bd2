// Products of small matrices that a whole subgroup shares, in half precision with sums in single:
// SPV_KHR_cooperative_matrix, spelled out because glslang 12 does not know it. It cannot say a
// matrix type's component, nor take specialisation constants for its sides: the program puts them
// in (engine/cooperative_matrix.h); 16 stands for all of them here.
//
// Vulkan's memory model is what the extension asks for. Control flow around these is uniform, and a
// workgroup's invocations are whole subgroups.
#pragma use_vulkan_memory_model
#extension GL_KHR_memory_scope_semantics : require
#extension GL_EXT_spirv_intrinsics : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_EXT_shader_16bit_storage : require

// The device's shape: C [m, n] += A [m, k] B [k, n].
layout(constant_id = 20) const uint kMatrixM = 16;
layout(constant_id = 21) const uint kMatrixN = 16;
layout(constant_id = 22) const uint kMatrixK = 16;

#define MATRIX extensions = ["SPV_KHR_cooperative_matrix"], capabilities = [6022]
// Scope of a subgroup (3), rows, columns, use.
#define MatrixA spirv_type(MATRIX, id = 4456, 3, 16, 16, 0)
#define MatrixB spirv_type(MATRIX, id = 4456, 3, 16, 16, 1)
#define MatrixC spirv_type(MATRIX, id = 4456, 3, 16, 16, 2)

const int kRowMajor = 0, kColumnMajor = 1;
// Memory operands: Aligned (2), and to how many bytes; NonPrivatePointer (32) for shared memory.
const int kAligned = 2, kAlignedShared = 2 | 32;
spirv_instruction(MATRIX, id = 4457)
MatrixA matrixLoadA(spirv_by_reference float16_t from, int layoutOf, uint stride,
                    spirv_literal int operands, spirv_literal int alignment);
spirv_instruction(MATRIX, id = 4457)
MatrixB matrixLoadB(spirv_by_reference float16_t from, int layoutOf, uint stride,
                    spirv_literal int operands, spirv_literal int alignment);
spirv_instruction(MATRIX, id = 4458)
void matrixStore(spirv_by_reference float to, MatrixC matrix, int layoutOf, uint stride,
                 spirv_literal int operands, spirv_literal int alignment);
// Every element the same.
spirv_instruction(MATRIX, id = 80) MatrixC matrixOf(float value);
// a b + c
spirv_instruction(MATRIX, id = 4459)
MatrixC matrixMulAdd(MatrixA a, MatrixB b, MatrixC c);
spirv_instruction(MATRIX, id = 143) MatrixC matrixScale(MatrixC matrix, float scale);
