# `cpack -G DEB` in the build folder makes a Debian package of what packaging/install.cmake installs,
# for the release of Debian on which it was built.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME doppel)
set(CPACK_PACKAGE_VENDOR Doppel)
set(CPACK_PACKAGE_CONTACT "Doppel's maintainers <doppel@localhost>" CACHE STRING
    "Whom a package names as its maintainer, as NAME <ADDRESS>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "textured, riggable 3D avatar of a person from a video")
set(CPACK_PACKAGE_DESCRIPTION
    "Doppel fits a body to the person in a video, learns shape and texture by
differentiable rendering, and writes an avatar that takes new poses and opens
in other programs as glTF, VRM or USD. All of it runs in Vulkan compute
shaders, on a GPU or on Mesa's software driver.")
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_CMAKE_PROJECTS "${CMAKE_BINARY_DIR};doppel;programs;/")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# A driver is needed, but which one the machine decides; the viewer takes its letters from a font.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "mesa-vulkan-drivers | vulkan-icd, fonts-dejavu-core")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS npm)  # by which doppel-fetch fetches
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_SOURCE_DIR}/packaging/as_debian_does.cmake)
include(CPack)
