# One line per test program: envconv_test(NAME [LABELS ...] [LIBRARIES ...]); the source is tests/NAME.cpp.
find_package(GTest REQUIRED)
include(GoogleTest)

function(envconv_test name)
  cmake_parse_arguments(arg "" "" "LABELS;LIBRARIES" ${ARGN})
  add_executable(${name} tests/${name}.cpp)
  if("thread" IN_LIST ENVCONV_SANITIZE)
    target_sources(${name} PRIVATE tests/early_reader.cpp)
  endif()
  target_link_libraries(${name} PRIVATE libenvconv GTest::gtest GTest::gtest_main ${arg_LIBRARIES})
  target_compile_definitions(${name} PRIVATE ENVCONV_TESTDATA="${CMAKE_CURRENT_SOURCE_DIR}/testdata"
                                             ENVCONV_BUILD="${CMAKE_CURRENT_BINARY_DIR}")
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS "${arg_LABELS}")
endfunction()

set(tests
  analyze_test
  block_code_test
  color_test
  container_damage_test
  container_test
  creases_test
  diamond_facts_test
  discrepancy_test
  draw_test
  io_damage_test
  io_output_test
  io_test
  layout_facts_test
  layout_laws_test
  metrics_test
  mip_test
  packing_test
  pattern_test
  quality_test
  recognize_test
  resample_test
  rim_texel_test
  scratch_test
  texel_format_test
  seam_test
  tile_map_test
  tiny_test)
foreach(test IN LISTS tests)
  envconv_test(${test})
endforeach()

foreach(test IN ITEMS discrepancy_test pattern_test)
  target_link_libraries(${test} PRIVATE TBB::tbb)  # chooses the number of threads
endforeach()

# Shares the benchmarks' signals, and paints in parallel.
target_link_libraries(quality_test PRIVATE TBB::tbb)
target_include_directories(quality_test PRIVATE tests)

# Chooses SIMD targets, so it talks to Highway itself.
envconv_test(simd_test LIBRARIES hwy::hwy)

# OpenEXR reads and writes what we write and read, on every SIMD target.
envconv_test(exr_test LIBRARIES PkgConfig::OPENEXR hwy::hwy TBB::tbb)

# What OpenEXR writes, and we do not.
envconv_test(exr_kinds_test LIBRARIES PkgConfig::OPENEXR)

# Inflates what is deflated, and chooses the number of threads.
envconv_test(tiff_png_test LIBRARIES PkgConfig::ZLIB PkgConfig::DEFLATE TBB::tbb)

# The image library, libjpeg and libtiff as oracles of the readers that are ours.
envconv_test(own_readers_test LIBRARIES PkgConfig::JPEG PkgConfig::TIFF)

# The authors' library is GPL: an oracle for this test, never linked into the tool.
find_library(CHEALPIX chealpix REQUIRED)
envconv_test(healpix_oracle_test LIBRARIES ${CHEALPIX})

# The scheduler of the tool, alone.
envconv_test(batch_test LIBRARIES TBB::tbb)
target_sources(batch_test PRIVATE tools/batch.cpp)
target_include_directories(batch_test PRIVATE tools)

# Its own search runs on every SIMD target; the image library and Mesa decode what it encodes.
find_library(EGL EGL REQUIRED)
envconv_test(bc6h_test LIBRARIES hwy::hwy)
envconv_test(bc6h_oracle_test LIBRARIES PkgConfig::OIIO ${EGL})

# DevIL reads DDS files of the older kind.
find_library(DEVIL IL REQUIRED)
envconv_test(devil_oracle_test LABELS oracle LIBRARIES ${DEVIL})

# Mesa's software renderer looks up what we write.
pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)
envconv_test(gl_oracle_test LABELS oracle LIBRARIES PkgConfig::EPOXY)

include(tests/cli.cmake)
include(tests/fuzz.cmake)
# The module is loaded at run time.
foreach(test IN ITEMS block_code_test container_damage_test container_test exr_kinds_test io_damage_test io_output_test
        io_test own_readers_test tiff_png_test)
  add_dependencies(${test} envconv_imageio)
endforeach()

# Not a test: quality and rate on analytic panoramas (ninja resample_bench).
add_executable(resample_bench EXCLUDE_FROM_ALL tests/bench/resample_bench.cpp)
target_link_libraries(resample_bench PRIVATE libenvconv TBB::tbb)
# The same for every ordered pair of layouts, beside the best that can be attained (ninja pairs_bench).
add_executable(pairs_bench EXCLUDE_FROM_ALL tests/bench/pairs_bench.cpp)
target_link_libraries(pairs_bench PRIVATE libenvconv TBB::tbb)

# Beside OpenCV, where it is installed (ninja peers_bench; libopencv-dev).
find_package(OpenCV QUIET COMPONENTS core imgproc)
if(OpenCV_FOUND)
  add_executable(peers_bench EXCLUDE_FROM_ALL tests/bench/peers_bench.cpp)
  target_link_libraries(peers_bench PRIVATE libenvconv TBB::tbb opencv_core opencv_imgproc)
endif()

# The same for BC6H (ninja bc6h_bench).
add_executable(bc6h_bench EXCLUDE_FROM_ALL tests/bench/bc6h_bench.cpp)
target_link_libraries(bc6h_bench PRIVATE libenvconv)
