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
envconv_fuzz(hdr_fuzz hdr)
envconv_fuzz(convert_fuzz convert)

# What is the tool's: all of it but its main().
get_target_property(sources envconv SOURCES)
list(REMOVE_ITEM sources tools/envconv.cpp)
add_library(envconv_parts STATIC ${sources})
target_include_directories(envconv_parts PUBLIC tools)
target_link_libraries(envconv_parts PUBLIC libenvconv CLI11::CLI11 nlohmann_json::nlohmann_json hwy::hwy TBB::tbb ZLIB::ZLIB)
foreach(name IN ITEMS options template)
  envconv_fuzz(${name}_fuzz ${name})
  target_link_libraries(${name}_fuzz_replay PRIVATE envconv_parts)
  if(ENVCONV_FUZZ)
    target_link_libraries(${name}_fuzz PRIVATE envconv_parts)
  endif()
endforeach()
