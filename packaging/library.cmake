# The avatar for other programs, as find_package(doppel): engine, nn, and what `figure` has of the
# trainer. docs/example uses it.
include(CMakePackageConfigHelpers)
set(PACKAGE ${CMAKE_INSTALL_LIBDIR}/cmake/doppel)

add_library(doppel_library STATIC $<TARGET_OBJECTS:engine> $<TARGET_OBJECTS:nn>
            $<TARGET_OBJECTS:figure>)
set_target_properties(doppel_library PROPERTIES OUTPUT_NAME doppel LINKER_LANGUAGE CXX)
set_target_properties(io PROPERTIES OUTPUT_NAME doppel_io)
install(FILES $<TARGET_FILE:doppel_library> $<TARGET_FILE:io>
        DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
install(FILES $<TARGET_FILE:doppel-pictures> DESTINATION ${CMAKE_INSTALL_LIBDIR}/doppel
        COMPONENT development)
foreach(folder engine nn trainer/data trainer/motion trainer/avatar)
    get_filename_component(parent ${folder} DIRECTORY)
    install(DIRECTORY ${folder} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/doppel/${parent}
            COMPONENT development FILES_MATCHING PATTERN *.h PATTERN tools EXCLUDE)
endforeach()
# Parameters of kernels, which headers of ops show.
install(DIRECTORY shaders DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/doppel
        COMPONENT development FILES_MATCHING PATTERN *.h)

configure_package_config_file(packaging/doppel-config.cmake.in
                              ${CMAKE_BINARY_DIR}/package/doppel-config.cmake
                              INSTALL_DESTINATION ${PACKAGE}
                              PATH_VARS CMAKE_INSTALL_LIBDIR CMAKE_INSTALL_INCLUDEDIR)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/package/doppel-config-version.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/package/doppel-config.cmake
              ${CMAKE_BINARY_DIR}/package/doppel-config-version.cmake
        DESTINATION ${PACKAGE} COMPONENT development)
