# One line per test program: envconv_test(NAME [LABELS ...] [LIBRARIES ...]); the source is tests/NAME.cpp.
find_package(GTest REQUIRED)
include(GoogleTest)

function(envconv_test name)
  cmake_parse_arguments(arg "" "" "LABELS;LIBRARIES" ${ARGN})
  add_executable(${name} tests/${name}.cpp)
  target_link_libraries(${name} PRIVATE libenvconv GTest::gtest GTest::gtest_main ${arg_LIBRARIES})
  target_compile_definitions(${name} PRIVATE ENVCONV_TESTDATA="${CMAKE_CURRENT_SOURCE_DIR}/testdata"
                                             ENVCONV_BUILD="${CMAKE_CURRENT_BINARY_DIR}")
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS "${arg_LABELS}")
endfunction()

set(tests
  analyze_test
  color_test
  diamond_facts_test
  draw_test
  io_test
  layout_facts_test
  layout_laws_test
  packing_test
  recognize_test
  resample_test
  tiny_test)
foreach(test IN LISTS tests)
  envconv_test(${test})
endforeach()

# Chooses SIMD targets, so it talks to Highway itself.
envconv_test(simd_test LIBRARIES hwy::hwy)

# The authors' library is GPL: an oracle for this test, never linked into the tool.
find_library(CHEALPIX chealpix REQUIRED)
envconv_test(healpix_oracle_test LIBRARIES ${CHEALPIX})
# The scheduler of the tool, alone.
envconv_test(batch_test LIBRARIES TBB::tbb)
target_sources(batch_test PRIVATE tools/batch.cpp)
target_include_directories(batch_test PRIVATE tools)

include(tests/cli.cmake)
include(tests/fuzz.cmake)
if(TARGET io_test)
  add_dependencies(io_test envconv_imageio)  # loaded at run time
  target_link_libraries(io_test PRIVATE PkgConfig::OPENEXR)  # writes what the library does not
endif()

# Not a test: quality and rate on analytic panoramas (ninja resample_bench).
add_executable(resample_bench EXCLUDE_FROM_ALL tests/bench/resample_bench.cpp)
target_link_libraries(resample_bench PRIVATE libenvconv TBB::tbb)
