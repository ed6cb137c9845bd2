# Finds every shader and its entries, compiles each entry in both binding flavours, and embeds the
# SPIR-V in the program. Adding a .comp file is all there is to do.
#
#   shaders/<family>/<op>.comp, ENTRY(forward)  ->  kernel "<family>/<op>.forward"
#
# Flavours: "addresses" (GL_EXT_buffer_reference) and "descriptors" (storage buffer descriptors).
# What a kernel reads and writes is reflected from the second flavour, so it is always built.
#
# A line "// VARIANTS: plain, cpu" compiles the shader once more with CPU = 1, as the kernels
# "<family>/<op>.<entry>@cpu"; Device::kernel() takes these in place of the plain ones where the
# device runs a CPU's kernels (shaders/common/loads.glsl). "// VARIANTS: cpu" and CPU_ENTRY(name)
# have no plain form. Any other variant defines its name in capitals, and the op asks for it.

set(SHADER_DIR ${CMAKE_SOURCE_DIR}/shaders)
set(SHADER_OUT ${CMAKE_BINARY_DIR}/shaders)
file(MAKE_DIRECTORY ${SHADER_OUT})
file(GLOB SHADER_FILES CONFIGURE_DEPENDS ${SHADER_DIR}/*/*.comp)
# A new ENTRY in an old file must be found too.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${SHADER_FILES})

set(assembly "    .section .rodata\n")
set(externs "")
set(rows "")
set(binaries "")
foreach(file ${SHADER_FILES})
    file(RELATIVE_PATH relative ${SHADER_DIR} ${file})
    string(REGEX REPLACE "\\.comp$" "" stem ${relative})
    set(variants plain)
    file(STRINGS ${file} variants_line REGEX "^// VARIANTS: ")
    if(variants_line)
        string(REGEX REPLACE "^// VARIANTS: " "" variants "${variants_line}")
        string(REGEX REPLACE ", *" ";" variants "${variants}")
    endif()
    # Debian 12's validator does not know cooperative matrices, and they come out of the compiler
    # incomplete (engine/cooperative_matrix.h).
    file(STRINGS ${file} matrices REGEX "common/cooperative_matrix.glsl")
    file(STRINGS ${file} entry_lines REGEX "^(CPU_)?ENTRY\\(")
    foreach(variant ${variants})
        set(suffix "")
        set(define "")
        if(NOT variant STREQUAL plain)
            set(suffix "@${variant}")
            string(TOUPPER "-D${variant}=1" define)
        endif()
        foreach(line ${entry_lines})
            if(line MATCHES "^CPU_" AND NOT variant STREQUAL cpu)
                continue()
            endif()
            string(REGEX REPLACE "^[A-Z_]+\\(([a-zA-Z0-9_]+)\\).*" "\\1" entry ${line})
            set(kernel "${stem}.${entry}${suffix}")
            string(MAKE_C_IDENTIFIER "spv_${kernel}" symbol)
            foreach(flavour addresses descriptors)
                set(binary ${SHADER_OUT}/${symbol}_${flavour}.spv)
                set(use_descriptors 0)
                if(flavour STREQUAL descriptors)
                    set(use_descriptors 1)
                endif()
                set(validation COMMAND ${SPIRV_VAL} --target-env vulkan1.2 --scalar-block-layout
                               ${binary})
                if(matrices)
                    set(validation "")
                endif()
                add_custom_command(
                    OUTPUT ${binary}
                    COMMAND ${GLSLANG} -V --quiet --target-env vulkan1.2 -I${SHADER_DIR}
                            --depfile ${binary}.d -DDESCRIPTORS=${use_descriptors} ${define}
                            -Dentry_${entry}=main -o ${binary} ${file}
                    ${validation}
                    DEPENDS ${file}
                    DEPFILE ${binary}.d
                    COMMENT "Shader ${kernel} (${flavour})"
                    VERBATIM)
                list(APPEND binaries ${binary})
                string(APPEND assembly
                       "    .balign 4\n    .global ${symbol}_${flavour}\n"
                       "${symbol}_${flavour}: .incbin \"${binary}\"\n"
                       "    .global ${symbol}_${flavour}_end\n${symbol}_${flavour}_end:\n")
                string(APPEND externs
                       "extern const uint32_t ${symbol}_${flavour}[], ${symbol}_${flavour}_end[];\n")
            endforeach()
            string(APPEND rows
                   "    {\"${kernel}\", {${symbol}_addresses, ${symbol}_addresses_end}, "
                   "{${symbol}_descriptors, ${symbol}_descriptors_end}},\n")
        endforeach()
    endforeach()
endforeach()
string(APPEND assembly "    .section .note.GNU-stack,\"\",%progbits\n")

file(CONFIGURE OUTPUT ${SHADER_OUT}/shader_table.S CONTENT "${assembly}" @ONLY)
file(CONFIGURE OUTPUT ${SHADER_OUT}/shader_table.cpp CONTENT "#include \"engine/shader_table.h\"
extern \"C\" {
${externs}}
namespace doppel {
static const ShaderTableRow kRows[] = {
${rows}};
std::span<const ShaderTableRow> shaderTable() { return kRows; }
}  // namespace doppel
" @ONLY)
set_source_files_properties(${SHADER_OUT}/shader_table.S PROPERTIES OBJECT_DEPENDS "${binaries}")
set(SHADER_TABLE ${SHADER_OUT}/shader_table.S ${SHADER_OUT}/shader_table.cpp)
