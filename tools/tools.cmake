# The tool.  A verb's file follows from its line in commands.inc.
find_package(CLI11 CONFIG REQUIRED)
find_package(nlohmann_json CONFIG REQUIRED)
find_package(ZLIB REQUIRED)  # pictures in reports

set(commands tools/commands.inc)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${commands})
file(STRINGS ${commands} lines REGEX "^ENVCONV_COMMAND")
foreach(line IN LISTS lines)
  string(REGEX REPLACE "^ENVCONV_COMMAND\\(([a-z]+)\\).*" "tools/cmd_\\1.cpp" file "${line}")
  list(APPEND command_sources ${file})
endforeach()

add_executable(envconv
  tools/batch.cpp
  tools/color_options.cpp
  tools/commands.cpp
  tools/convert_batch.cpp
  tools/convert_levels.cpp
  tools/convert_memory.cpp
  tools/convert_plan.cpp
  tools/convert_run.cpp
  tools/describe.cpp
  tools/envconv.cpp
  tools/error_picture.cpp
  tools/figures.cpp
  tools/generate.cpp
  tools/input.cpp
  tools/interrupt.cpp
  tools/memory.cpp
  tools/options.cpp
  tools/output_name.cpp
  tools/parse.cpp
  tools/pixels.cpp
  tools/png.cpp
  tools/progress.cpp
  tools/report.cpp
  tools/standard_input.cpp
  tools/svg.cpp
  tools/text.cpp
  ${command_sources})
add_dependencies(envconv envconv_imageio)  # loaded at run time
set_target_properties(envconv PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR})
target_link_libraries(envconv PRIVATE libenvconv CLI11::CLI11 nlohmann_json::nlohmann_json hwy::hwy TBB::tbb ZLIB::ZLIB)
set_source_files_properties(tools/envconv.cpp tools/generate.cpp PROPERTIES COMPILE_DEFINITIONS
  "ENVCONV_VERSION=\"${PROJECT_VERSION}\";ENVCONV_OPENEXR_VERSION=\"${OPENEXR_VERSION}\";ENVCONV_OIIO_VERSION=\"${OIIO_VERSION}\";ENVCONV_OCIO_VERSION=\"${OCIO_VERSION}\"")
# The module is needed at run time, not at link time.
add_dependencies(envconv envconv_imageio)

# --- installation ------------------------------------------------------------------------------------------------------
include(CMakePackageConfigHelpers)
target_compile_features(libenvconv PUBLIC cxx_std_20)  # so that a consumer's compiler is told
install(TARGETS libenvconv EXPORT envconv ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(TARGETS envconv RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(TARGETS envconv_imageio LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/envconv)
install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/envconv)
install(FILES man/envconv.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES man/envconv-layouts.7 man/envconv-metrics.7 man/envconv-seams.7 DESTINATION ${CMAKE_INSTALL_MANDIR}/man7)
install(FILES README.md CHANGELOG.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

install(EXPORT envconv NAMESPACE envconv:: FILE envconv-targets.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/envconv)
configure_package_config_file(.cmake/envconv-config.cmake.in envconv-config.cmake
                              INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/envconv)
write_basic_package_version_file(envconv-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/envconv-config.cmake ${CMAKE_CURRENT_BINARY_DIR}/envconv-config-version.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/envconv)
# Relative, so that an installation can be moved, and --prefix given at the installation.
file(RELATIVE_PATH prefix_from_pc ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
configure_file(.cmake/envconv.pc.in envconv.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/envconv.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

foreach(pair IN ITEMS "bash;bash-completion/completions/envconv" "zsh;zsh/site-functions/_envconv"
                      "fish;fish/vendor_completions.d/envconv.fish")
  list(GET pair 0 shell)
  list(GET pair 1 place)
  set(script ${CMAKE_CURRENT_BINARY_DIR}/completions/envconv.${shell})
  add_custom_command(OUTPUT ${script} COMMAND ${CMAKE_COMMAND} -E make_directory ${CMAKE_CURRENT_BINARY_DIR}/completions
                     COMMAND envconv completion ${shell} > ${script} DEPENDS envconv VERBATIM)
  list(APPEND completion_scripts ${script})
  get_filename_component(folder ${place} DIRECTORY)
  get_filename_component(name ${place} NAME)
  install(FILES ${script} DESTINATION ${CMAKE_INSTALL_DATADIR}/${folder} RENAME ${name})
endforeach()
add_custom_target(completions ALL DEPENDS ${completion_scripts})
