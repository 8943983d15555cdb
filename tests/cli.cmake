# The tool from outside: transcripts of the command line, the documents, and a program that uses the installed library.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

# Leaks are looked for in the test programs: in the tool, whose threads end with it, the search itself crashes at times.
set(tool_options ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=0 ENVCONV_SANITIZE=${sanitizers})

# Seconds that a test may take.
set(patience 600)
if(ENVCONV_SANITIZE)
  set(patience 3600)
endif()

# Faults on order, for LD_PRELOAD.
add_library(inject MODULE tests/inject.cpp)
target_compile_options(inject PRIVATE -fno-builtin)  # else a call of malloc in malloc may be "optimised"
target_link_libraries(inject PRIVATE ${CMAKE_DL_LIBS})

set(cli_tests
  analyze
  batch
  color
  compare
  convert
  damage
  corpus
  documents
  faults
  info
  memory
  mips
  pattern
  safety
  signals
  usage)
# Chromium and GNU parallel need /proc, and Slurm's daemons need control groups: where there are none, as in a bare chroot,
# these programs do not start.
if(EXISTS /proc/cpuinfo)
  list(APPEND cli_tests report)
else()
  message(WARNING "no /proc: the test cli_report (Chromium) is left out")
endif()
if(EXISTS /proc/self/status AND EXISTS /sys/fs/cgroup)
  file(GLOB control_groups /sys/fs/cgroup/*)
endif()
if(control_groups)
  list(APPEND cli_tests cluster)
else()
  message(WARNING "no /proc or no control groups: the test cli_cluster (GNU parallel, Slurm) is left out")
endif()
foreach(test IN LISTS cli_tests)
  add_test(NAME cli_${test} COMMAND Python3::Interpreter -B ${CMAKE_CURRENT_SOURCE_DIR}/tests/cli/${test}_test.py
           WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/tests/cli)
  set_tests_properties(cli_${test} PROPERTIES LABELS cli TIMEOUT ${patience} ENVIRONMENT
    "ENVCONV=$<TARGET_FILE:envconv>;ENVCONV_SOURCE=${CMAKE_CURRENT_SOURCE_DIR};ENVCONV_INJECTOR=$<TARGET_FILE:inject>;${tool_options}")
endforeach()

# Daemons of a cluster of one node: ctest -LE cluster leaves them out.
if(TEST cli_cluster)
  set_tests_properties(cli_cluster PROPERTIES LABELS "cli;cluster")
endif()

# Against other programs, which must be there.
add_test(NAME oracle COMMAND Python3::Interpreter -B ${CMAKE_CURRENT_SOURCE_DIR}/tests/oracle_test.py)
set(oracle_environment ENVCONV=$<TARGET_FILE:envconv> ENVCONV_SOURCE=${CMAKE_CURRENT_SOURCE_DIR}
                       PYTHONPATH=${CMAKE_CURRENT_SOURCE_DIR}/tests/cli ${tool_options})
set_tests_properties(oracle PROPERTIES LABELS oracle TIMEOUT ${patience} ENVIRONMENT "${oracle_environment}")

add_executable(container_samples tests/container_samples.cpp)
target_link_libraries(container_samples PRIVATE libenvconv)
add_test(NAME container_oracle COMMAND Python3::Interpreter -B ${CMAKE_CURRENT_SOURCE_DIR}/tests/container_oracle_test.py)
set_tests_properties(container_oracle PROPERTIES LABELS oracle TIMEOUT ${patience} ENVIRONMENT
  "${oracle_environment};CONTAINER_SAMPLES=$<TARGET_FILE:container_samples>")

# Against packages that only npm has, which the first test downloads into the build folder, and Debian's chromium.
option(ENVCONV_ORACLES_NPM "Add the tests that download packages with npm" OFF)
if(ENVCONV_ORACLES_NPM)
  find_program(NODE node REQUIRED)
  find_program(NPM npm REQUIRED)
  set(npm_folder ${CMAKE_CURRENT_BINARY_DIR}/npm)
  add_test(NAME npm_packages COMMAND ${NPM} install --prefix ${npm_folder} --no-audit --no-fund --ignore-scripts
           ktx-parse@2.0.0 playwright-core@1.65.1 three@0.187.0)
  add_test(NAME ktx_parse COMMAND ${NODE} ${CMAKE_CURRENT_SOURCE_DIR}/tests/ktx_parse_test.mjs ${npm_folder}
           $<TARGET_FILE:container_samples>)
  find_program(CHROMIUM chromium REQUIRED)
  add_test(NAME three COMMAND ${NODE} ${CMAKE_CURRENT_SOURCE_DIR}/tests/three_test.mjs ${npm_folder}
           $<TARGET_FILE:envconv>)
  set_tests_properties(three PROPERTIES ENVIRONMENT "CHROMIUM=${CHROMIUM}")
  set_tests_properties(npm_packages PROPERTIES LABELS npm TIMEOUT 300 FIXTURES_SETUP npm)
  set_tests_properties(ktx_parse three PROPERTIES LABELS npm TIMEOUT 300 FIXTURES_REQUIRED npm)
endif()

add_test(NAME install COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/tests/install/run.sh ${CMAKE_CURRENT_BINARY_DIR}
         ${CMAKE_CURRENT_SOURCE_DIR}/tests/install)
# The consumer's too; none but in builds with a sanitizer.
list(JOIN sanitize_options " " flags)
if(CMAKE_BUILD_RPATH)
  string(APPEND flags " -Wl,-rpath,${CMAKE_BUILD_RPATH}")
endif()
set_tests_properties(install PROPERTIES LABELS install TIMEOUT ${patience} ENVIRONMENT "CXXFLAGS=${flags}")
