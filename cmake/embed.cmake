# Of holdfast_embed: adds the bytes of a file to its lists, and has 'view' name them.
macro(_holdfast_blob symbol path)
  string(APPEND blobs "  .global ${symbol}, ${symbol}_end\n${symbol}:\n  .incbin \"${path}\"\n${symbol}_end:\n")
  string(APPEND declarations "extern \"C\" const char ${symbol}[], ${symbol}_end[];\n")
  list(APPEND paths ${path})
  set(view "{${symbol}, static_cast<size_t>(${symbol}_end - ${symbol})}")
endmacro()

# holdfast_embed(target FILES path[=name]...): the target's PageFiles() (server/web/page_files.h) has these files, each by
# its name, as part of the program, and compressed beside it, but for video, which is compressed by itself. Paths are
# relative to the project's root.
function(holdfast_embed target)
  cmake_parse_arguments(A "" "" "FILES" ${ARGN})
  set(blobs "")
  set(paths "")
  set(declarations "")
  set(entries "")
  set(number 0)
  find_program(HOLDFAST_GZIP gzip REQUIRED)
  foreach(file ${A_FILES})
    string(REGEX REPLACE "=.*" "" path ${file})
    string(REGEX REPLACE ".*[=/]" "" name ${file})
    set(path ${PROJECT_SOURCE_DIR}/${path})
    file(SHA256 ${path} sum)
    string(SUBSTRING ${sum} 0 16 etag)
    _holdfast_blob(holdfast_page_${number} ${path})
    set(bytes "${view}")
    set(view "{}")
    if(NOT name MATCHES "\\.mp4$")
      set(packed ${CMAKE_CURRENT_BINARY_DIR}/${name}.gz)
      execute_process(COMMAND ${HOLDFAST_GZIP} -9nc ${path} OUTPUT_FILE ${packed}.new COMMAND_ERROR_IS_FATAL ANY)
      file(COPY_FILE ${packed}.new ${packed} ONLY_IF_DIFFERENT)  # or every configuration would link the server anew
      _holdfast_blob(holdfast_page_${number}_gzip ${packed})
    endif()
    string(APPEND entries "      {\"/${name}\", ${bytes}, \"\\\"${etag}\\\"\", ${view}},\n")
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${path})  # for the sum, and what is compressed
    math(EXPR number "${number} + 1")
  endforeach()
  file(CONFIGURE OUTPUT page_blobs.s @ONLY CONTENT "  .section .rodata\n${blobs}  .section .note.GNU-stack,\"\",%progbits\n")
  file(CONFIGURE OUTPUT page_files.cc @ONLY CONTENT "#include \"server/web/page_files.h\"

${declarations}
namespace holdfast {

const std::vector<PageFile>& PageFiles() {
  static const auto* const files = new std::vector<PageFile>{
${entries}  };
  return *files;
}

}  // namespace holdfast
")
  target_sources(${target} PRIVATE ${CMAKE_CURRENT_BINARY_DIR}/page_blobs.s ${CMAKE_CURRENT_BINARY_DIR}/page_files.cc)
  # What the other sources want, an assembler does not: of that clang warns, and warnings are errors.
  set_source_files_properties(${CMAKE_CURRENT_BINARY_DIR}/page_blobs.s PROPERTIES LANGUAGE ASM
    OBJECT_DEPENDS "${paths}" SKIP_PRECOMPILE_HEADERS ON COMPILE_OPTIONS -Wno-unused-command-line-argument)
endfunction()
