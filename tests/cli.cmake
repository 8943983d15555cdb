# The tool from outside: transcripts of the command line, the documents, and a program that uses the installed library.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

# Leaks are looked for in the test programs: in the tool, whose threads end with it, the search itself crashes at times.
set(tool_options ASAN_OPTIONS=allocator_may_return_null=1:detect_leaks=0 ENVCONV_SANITIZE=${sanitizers})

# Faults on order, for LD_PRELOAD.
add_library(inject MODULE tests/inject.cpp)
target_compile_options(inject PRIVATE -fno-builtin)  # else a call of malloc in malloc may be "optimised"
target_link_libraries(inject PRIVATE ${CMAKE_DL_LIBS})

foreach(test IN ITEMS usage convert batch color memory signals faults corpus cluster info safety documents)
  add_test(NAME cli_${test} COMMAND Python3::Interpreter -B ${CMAKE_CURRENT_SOURCE_DIR}/tests/cli/${test}_test.py
           WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/tests/cli)
  set_tests_properties(cli_${test} PROPERTIES LABELS cli TIMEOUT 600 ENVIRONMENT
    "ENVCONV=$<TARGET_FILE:envconv>;ENVCONV_SOURCE=${CMAKE_CURRENT_SOURCE_DIR};ENVCONV_INJECTOR=$<TARGET_FILE:inject>;${tool_options}")
endforeach()

# Daemons of a cluster of one node: ctest -LE cluster leaves them out.
set_tests_properties(cli_cluster PROPERTIES LABELS "cli;cluster")

# Against other programs, which must be there.
add_test(NAME oracle COMMAND Python3::Interpreter -B ${CMAKE_CURRENT_SOURCE_DIR}/tests/oracle_test.py)
set(oracle_environment ENVCONV=$<TARGET_FILE:envconv> ENVCONV_SOURCE=${CMAKE_CURRENT_SOURCE_DIR}
                       PYTHONPATH=${CMAKE_CURRENT_SOURCE_DIR}/tests/cli ${tool_options})
set_tests_properties(oracle PROPERTIES LABELS oracle TIMEOUT 300 ENVIRONMENT "${oracle_environment}")

add_test(NAME install COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/tests/install/run.sh ${CMAKE_CURRENT_BINARY_DIR}
         ${CMAKE_CURRENT_SOURCE_DIR}/tests/install)
list(JOIN sanitize_options " " flags)  # the consumer's too; none but in builds with a sanitizer
set_tests_properties(install PROPERTIES LABELS install TIMEOUT 300 ENVIRONMENT "CXXFLAGS=${flags}")
