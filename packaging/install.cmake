# What `cmake --install build --prefix PREFIX` copies. The prefix can be moved afterwards.

install(TARGETS doppel doppel-bench RUNTIME)
install(PROGRAMS scripts/doppel-fetch scripts/doppel-thumbnail DESTINATION ${CMAKE_INSTALL_BINDIR})
install(TARGETS doppel-pictures LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/doppel)
# A component of its own: packages of the programs need no MPI.
if(TARGET doppel-mpi)
    install(TARGETS doppel-mpi LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/doppel COMPONENT mpi)
endif()
install(DIRECTORY assets/body assets/actor assets/pages DESTINATION ${CMAKE_INSTALL_DATADIR}/doppel)
# three.js for pages, where set-up has fetched it.
install(DIRECTORY build/web DESTINATION ${CMAKE_INSTALL_DATADIR}/doppel OPTIONAL)
install(FILES README.md LICENSE packaging/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES assets/NOTICE assets/README.md DESTINATION ${CMAKE_INSTALL_DOCDIR}/assets)
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR})

# Manual pages and completions are what the program says of its own flags.
set(MANUAL ${CMAKE_BINARY_DIR}/manual)
file(MAKE_DIRECTORY ${MANUAL})
add_custom_command(
    OUTPUT ${MANUAL}/complete
    COMMAND doppel manual --out ${MANUAL}/pages > ${MANUAL}/log
    COMMAND doppel completion bash > ${MANUAL}/doppel
    COMMAND doppel completion zsh > ${MANUAL}/_doppel
    COMMAND doppel completion fish > ${MANUAL}/doppel.fish
    COMMAND ${CMAKE_COMMAND} -E touch ${MANUAL}/complete
    DEPENDS doppel
    COMMENT "Manual pages and completions")
add_custom_target(manual ALL DEPENDS ${MANUAL}/complete)
install(DIRECTORY ${MANUAL}/pages/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1
        FILES_MATCHING PATTERN *.1)
install(FILES ${MANUAL}/doppel
        DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(FILES ${MANUAL}/_doppel DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
install(FILES ${MANUAL}/doppel.fish
        DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)

install(FILES packaging/doppel.desktop DESTINATION ${CMAKE_INSTALL_DATADIR}/applications)
install(FILES packaging/doppel.thumbnailer DESTINATION ${CMAKE_INSTALL_DATADIR}/thumbnailers)
install(FILES packaging/doppel.svg
        DESTINATION ${CMAKE_INSTALL_DATADIR}/icons/hicolor/scalable/apps)

# These are in the programs themselves, as headers or static libraries, and want their notices to come
# along. Debian keeps them with its packages.
foreach(package libfmt-dev zlib1g-dev libcli11-dev libtomlplusplus-dev nlohmann-json3-dev
        libtinygltf-dev libeigen3-dev libimgui-dev libflatbuffers-dev libglm-dev libbenchmark-dev)
    install(FILES /usr/share/doc/${package}/copyright OPTIONAL RENAME ${package}
            DESTINATION ${CMAKE_INSTALL_DOCDIR}/libraries)
endforeach()
