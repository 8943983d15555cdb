# Fuzz targets: envconv_fuzz(NAME FOLDER) for tests/fuzz/NAME.cpp.  As a test it runs over the files of
# testdata/corpus/FOLDER.  Configured with the preset fuzz, it is a fuzzer as well:
# build-fuzz/NAME -max_len=4096 NEW_FOLDER testdata/corpus/FOLDER
function(envconv_fuzz name folder)
  add_executable(${name}_replay tests/fuzz/${name}.cpp tests/fuzz/replay.cpp)
  target_link_libraries(${name}_replay PRIVATE libenvconv)
  add_test(NAME ${name} COMMAND ${name}_replay ${CMAKE_CURRENT_SOURCE_DIR}/testdata/corpus/${folder})
  set_tests_properties(${name} PROPERTIES LABELS fuzz)
  if(ENVCONV_FUZZ)
    add_executable(${name} tests/fuzz/${name}.cpp)
    target_link_libraries(${name} PRIVATE libenvconv)
    target_link_options(${name} PRIVATE -fsanitize=fuzzer)
  endif()
endfunction()

envconv_fuzz(dds_fuzz dds)
envconv_fuzz(ktx_fuzz ktx)
envconv_fuzz(ktx2_fuzz ktx2)
