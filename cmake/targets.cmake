# The three kinds of target of this project: holdfast_library, holdfast_program and holdfast_test.
# Sources are listed by name; PCH names the precompiled-header holder a target shares (torch, grpc or none).

# Flags of our own code, none of them reaching the headers of libraries.
add_library(holdfast_flags INTERFACE)
target_compile_options(holdfast_flags INTERFACE -Wall -Wextra -Werror -Wno-psabi
  $<$<CXX_COMPILER_ID:GNU>:-Wno-missing-field-initializers>
  # GCC 14 sees an overrun in the vector<bool> that torch's autograd functions grow; there is none.
  "$<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_GREATER_EQUAL:$<CXX_COMPILER_VERSION>,13>>:-Wno-array-bounds;-Wno-stringop-overflow>"
  $<$<CXX_COMPILER_ID:Clang>:-Wthread-safety -Wno-missing-field-initializers>)

function(_holdfast_common target pch)
  set_property(GLOBAL APPEND PROPERTY HOLDFAST_TARGETS ${target})
  target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
  target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:holdfast_flags>)
  if(pch AND HOLDFAST_PCH)
    target_precompile_headers(${target} REUSE_FROM pch_${pch})
  endif()
endfunction()

# Compiles up to HOLDFAST_UNITY sources of every target as one, but for targets whose property HOLDFAST_ALONE is set.
# CMake's own way names them by their full paths, so that ccache would take the same unit of another checkout for a
# different one.
function(holdfast_unite_sources)
  if(NOT HOLDFAST_UNITY MATCHES "^[1-9][0-9]*$")
    message(FATAL_ERROR "HOLDFAST_UNITY is ${HOLDFAST_UNITY}, expected a number of sources, at least 1")
  endif()
  get_property(targets GLOBAL PROPERTY HOLDFAST_TARGETS)
  foreach(target ${targets})
    get_target_property(alone ${target} HOLDFAST_ALONE)
    if(NOT alone)
      _holdfast_unite(${target})
    endif()
  endforeach()
endfunction()

# Generated sources, and those with options of their own, stay by themselves.
function(_holdfast_unite target)
  get_target_property(folder ${target} SOURCE_DIR)
  get_target_property(sources ${target} SOURCES)
  set(alone "")
  set(together "")
  foreach(source ${sources})
    cmake_path(ABSOLUTE_PATH source BASE_DIRECTORY ${folder} OUTPUT_VARIABLE path)
    get_source_file_property(options ${path} TARGET_DIRECTORY ${target} COMPILE_OPTIONS)
    get_source_file_property(definitions ${path} TARGET_DIRECTORY ${target} COMPILE_DEFINITIONS)
    if(source MATCHES "^[^$/].*\\.cc$" AND NOT options AND NOT definitions)
      list(APPEND together ${source})
    else()
      list(APPEND alone ${source})
    endif()
  endforeach()
  set(number 0)
  while(together)
    list(SUBLIST together 0 ${HOLDFAST_UNITY} unit)
    list(REMOVE_ITEM together ${unit})
    list(LENGTH unit length)
    if(length GREATER 1)
      _holdfast_unit(unit ${PROJECT_BINARY_DIR}/units/${target}_${number}.cc ${folder} ${unit})
      math(EXPR number "${number} + 1")
    endif()
    list(APPEND alone ${unit})
  endwhile()
  set_property(TARGET ${target} PROPERTY SOURCES ${alone})
endfunction()

# Sets 'out' to the file 'path', which includes the sources.
function(_holdfast_unit out path folder)
  set(lines "")
  foreach(source ${ARGN})
    cmake_path(ABSOLUTE_PATH source BASE_DIRECTORY ${folder} NORMALIZE)
    cmake_path(RELATIVE_PATH source BASE_DIRECTORY ${PROJECT_SOURCE_DIR})
    string(APPEND lines "#include \"${source}\"\n")
  endforeach()
  file(CONFIGURE OUTPUT ${path} CONTENT "${lines}" @ONLY)
  set(${out} ${path} PARENT_SCOPE)
endfunction()

# A holder builds its headers once; targets of the same flags share the result.
function(holdfast_pch name)
  cmake_parse_arguments(A "" "" "HEADERS;DEPS" ${ARGN})
  file(WRITE ${PROJECT_BINARY_DIR}/pch/${name}.cc "// Holder of the precompiled headers of '${name}'.\n")
  add_library(pch_${name} OBJECT ${PROJECT_BINARY_DIR}/pch/${name}.cc)
  target_include_directories(pch_${name} PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(pch_${name} PRIVATE holdfast_flags ${A_DEPS})
  if(HOLDFAST_PCH)
    target_precompile_headers(pch_${name} PRIVATE ${A_HEADERS})
    _holdfast_pch_sum(pch_${name} "${A_HEADERS}")
  endif()
endfunction()

# What a precompiled header is made of, for ccache: without it ccache reads hundreds of megabytes for every file it
# compiles, and takes the same header of another checkout for a different one.
function(_holdfast_pch_sum target headers)
  string(TOUPPER "${CMAKE_BUILD_TYPE}" type)
  set(made_of ${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION} ${CMAKE_CXX_FLAGS}
    ${CMAKE_CXX_FLAGS_${type}} ${HOLDFAST_SANITIZE} ${headers})
  foreach(header ${headers})
    string(REGEX REPLACE "[<>]" "" name ${header})
    string(MAKE_C_IDENTIFIER "HOLDFAST_DIR_OF_${name}" variable)
    find_path(${variable} ${name} PATHS ${TORCH_INCLUDE_DIRS})
    mark_as_advanced(${variable})
    file(TIMESTAMP ${${variable}}/${name} changed)
    list(APPEND made_of ${changed})
  endforeach()
  string(SHA256 sum "${made_of}")
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/CMakeFiles/${target}.dir/cmake_pch.hxx.gch.sum ${sum})
endfunction()

# holdfast_library(name SOURCES ... [DEPS public...] [PRIVATE_DEPS private...] [PCH torch|grpc]): the library of a
# folder, target holdfast_name; others link it as holdfast::name.
function(holdfast_library name)
  cmake_parse_arguments(A "" "PCH" "SOURCES;DEPS;PRIVATE_DEPS" ${ARGN})
  set(target holdfast_${name})
  add_library(${target} STATIC ${A_SOURCES})
  add_library(holdfast::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_link_libraries(${target} PUBLIC ${A_DEPS} PRIVATE ${A_PRIVATE_DEPS})
  _holdfast_common(${target} "${A_PCH}")
endfunction()

# The source defines flags: absl's use a fence, which GCC reports as unknown to ThreadSanitizer; one thread reads them.
function(holdfast_defines_flags source)
  if(HOLDFAST_SANITIZE STREQUAL thread AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS -Wno-tsan)
  endif()
endfunction()

# What programs and tests' programs have in common; 'folder' is where the executable lies.
function(_holdfast_executable target sources deps pch folder)
  add_executable(${target} ${sources})
  target_link_libraries(${target} PRIVATE ${deps})
  _holdfast_common(${target} "${pch}")
  if(HOLDFAST_SANITIZE STREQUAL thread AND HOLDFAST_TESTS)  # tests run the programs
    target_link_libraries(${target} PRIVATE holdfast_tsan_libraries)
  endif()
  set_target_properties(${target} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/${folder})
endfunction()

# holdfast_program(name SOURCES ... DEPS ... [PCH torch|grpc] [COMPONENT name]); the target has the executable's file name.
# It is installed as a component of that name, too, unless it belongs to another one.
function(holdfast_program name)
  cmake_parse_arguments(A "" "PCH;COMPONENT" "SOURCES;DEPS" ${ARGN})
  if(NOT A_COMPONENT)
    set(A_COMPONENT ${name})
  endif()
  _holdfast_executable(${name} "${A_SOURCES}" "${A_DEPS}" "${A_PCH}" bin)
  install(TARGETS ${name} RUNTIME COMPONENT ${A_COMPONENT})
endfunction()

# A program of tests, in the groups of its folder and those above: model_ops_tests, model_tests. Without PCH it has that
# of tests, which does not fit what links gRPC. Code of tests is optimised lightly: it runs once, and most of the time of a
# build goes into tests.
function(_holdfast_test_program target module sources deps pch)
  if(NOT pch)
    set(pch test)
  endif()
  _holdfast_executable(${target} "${sources}" "${deps};holdfast_test_main;GTest::gmock" "${pch}" tests)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  string(REPLACE "/" ";" folders ${module})
  set(group "")
  foreach(folder ${folders})
    string(APPEND group ${folder}_)
    if(NOT TARGET ${group}tests)
      add_custom_target(${group}tests)
    endif()
    add_dependencies(${group}tests ${target})
  endforeach()
endfunction()

# holdfast_takes_long(module/x_test seconds [label...]): how long a test may take. Those that may take longest begin
# first: one that begins last runs alone.
function(holdfast_takes_long name timeout)
  if(HOLDFAST_SANITIZE)
    math(EXPR timeout "4 * ${timeout}")
  endif()
  set_tests_properties(${name} PROPERTIES LABELS "${ARGN}" TIMEOUT ${timeout} COST ${timeout})
endfunction()

function(_holdfast_add_test name command labels timeout)
  add_test(NAME ${name} COMMAND ${command})
  set_property(GLOBAL PROPERTY "HOLDFAST_COMMAND_${name}" ${command})
  if(NOT timeout)
    set(timeout 300)
  endif()
  holdfast_takes_long(${name} ${timeout} ${labels})
endfunction()

# holdfast_test(module/x_test SOURCES ... DEPS ... [PCH torch|grpc] [LABELS ...] [TIMEOUT seconds]): a test program;
# ctest shows the name as given.
function(holdfast_test name)
  cmake_parse_arguments(A "" "PCH;TIMEOUT" "SOURCES;DEPS;LABELS" ${ARGN})
  string(REPLACE "/" "_" target ${name})
  string(REGEX REPLACE "/[^/]*$" "" module ${name})
  _holdfast_test_program(${target} ${module} "${A_SOURCES}" "${A_DEPS}" "${A_PCH}")
  _holdfast_add_test(${name} ${target} "${A_LABELS}" "${A_TIMEOUT}")
endfunction()

# holdfast_tests(module TESTS x... DEPS ... [SOURCES more...] [PCH torch|grpc] [PROGRAM name]): the tests x_test.cc of a
# folder in one program, which ctest runs once for each of them, as module/x_test. Most of what a test costs to compile
# are the headers that its neighbours include too. A folder's second program needs a name.
function(holdfast_tests module)
  cmake_parse_arguments(A "" "PCH;PROGRAM" "TESTS;SOURCES;DEPS" ${ARGN})
  if(NOT A_PROGRAM)
    string(REPLACE "/" "_" A_PROGRAM ${module})
  endif()
  set(target ${A_PROGRAM}_test_program)
  list(TRANSFORM A_TESTS APPEND _test.cc OUTPUT_VARIABLE sources)
  _holdfast_test_program(${target} ${module} "${sources};${A_SOURCES}" "${A_DEPS}" "${A_PCH}")
  foreach(test ${A_TESTS})
    _holdfast_add_test(${module}/${test}_test "${target};--source=${test}_test.cc" "" "")
  endforeach()
endfunction()

# holdfast_isa_test(module/x_test ISA set THREADS n [FILTER gtest filter]) runs a test once more with at most one
# instruction set of oneDNN and n threads of OpenMP, as <module>/x_test_<set>_<n>. Not under sanitizers, which do not see
# into oneDNN.
function(holdfast_isa_test name)
  cmake_parse_arguments(A "" "ISA;THREADS;FILTER" "" ${ARGN})
  if(HOLDFAST_SANITIZE)
    return()
  endif()
  get_property(command GLOBAL PROPERTY "HOLDFAST_COMMAND_${name}")
  string(TOLOWER "${name}_${A_ISA}_${A_THREADS}" variant)
  add_test(NAME ${variant} COMMAND ${command})
  # Threads that spin at barriers would make these tests many times slower beside other work.
  set(environment OMP_NUM_THREADS=${A_THREADS} OMP_WAIT_POLICY=passive)
  if(NOT A_ISA STREQUAL "ALL")
    list(APPEND environment DNNL_MAX_CPU_ISA=${A_ISA})
  endif()
  if(A_FILTER)
    list(APPEND environment "GTEST_FILTER=${A_FILTER}")
  endif()
  set_tests_properties(${variant} PROPERTIES LABELS isa TIMEOUT 600 COST 600 ENVIRONMENT "${environment}")
endfunction()
