# ccache where it is installed, the mold linker where it is installed, sanitizers on request.
find_program(HOLDFAST_CCACHE ccache)
if(HOLDFAST_CCACHE)
  # Precompiled headers need the sloppiness, and holdfast_pch says what they are made of; the base directory lets one cache
  # serve several checkouts, and debuggers are not told where that is; depend mode saves a run of the preprocessor per file.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_DEPEND=1
    CCACHE_NOHASHDIR=1 CCACHE_PCH_EXTSUM=1
    CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime ${HOLDFAST_CCACHE})
  if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    add_compile_options(-fpch-preprocess)
  endif()
endif()

find_program(HOLDFAST_MOLD mold)
if(HOLDFAST_MOLD)
  # Segments on pages of their own: mold 1.10 (Debian 12) protects a page too many where code ends a few bytes before one and
  # thread-local variables follow, and such a program does not start.
  add_link_options(-fuse-ld=mold -Wl,-z,separate-code)
endif()

if(HOLDFAST_SANITIZE)
  add_compile_options(-fsanitize=${HOLDFAST_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all -g1)
  add_link_options(-fsanitize=${HOLDFAST_SANITIZE})
  add_compile_definitions(HOLDFAST_SANITIZED)
  if(HOLDFAST_SANITIZE STREQUAL thread AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    add_compile_options(-Wno-maybe-uninitialized)  # GCC sees optionals without a value being copied
  endif()
endif()
