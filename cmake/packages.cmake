# Every library the project takes from outside.
find_package(absl REQUIRED)
find_package(Protobuf REQUIRED)
find_package(gRPC CONFIG REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(spdlog REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc imgcodecs videoio video)
find_package(PkgConfig REQUIRED)
pkg_check_modules(libzip REQUIRED IMPORTED_TARGET libzip)  # its CMake file wants the command-line tools too
pkg_check_modules(ffmpeg REQUIRED IMPORTED_TARGET libavformat libavcodec libavutil libswscale)
find_package(OpenSSL REQUIRED COMPONENTS Crypto SSL)
find_package(Threads REQUIRED)
find_package(ZLIB REQUIRED)

if(HOLDFAST_SERVER OR HOLDFAST_TRAINING)
  find_package(Torch REQUIRED)
  find_package(prometheus-cpp CONFIG REQUIRED)
  pkg_check_modules(turbojpeg REQUIRED IMPORTED_TARGET libturbojpeg)
  find_package(Boost 1.74 REQUIRED)  # Asio and Beast, which are headers alone
  # ThreadSanitizer knows no fences. Asio's order nothing here that its mutexes do not.
  if(HOLDFAST_SANITIZE STREQUAL thread)
    target_compile_definitions(Boost::headers INTERFACE BOOST_ASIO_DISABLE_FENCED_BLOCK)
  endif()
  # Torch's own flags come with its target; only the directories are marked as not ours.
  add_library(holdfast_torch INTERFACE)
  target_include_directories(holdfast_torch SYSTEM INTERFACE ${TORCH_INCLUDE_DIRS})
  target_link_libraries(holdfast_torch INTERFACE ${TORCH_LIBRARIES})
  # The copy of oneDNN that LibTorch convolves with; its CMake file wants OpenCL's headers too.
  find_library(HOLDFAST_DNNL dnnl REQUIRED)
  find_path(HOLDFAST_DNNL_INCLUDE oneapi/dnnl/dnnl.h REQUIRED)
  add_library(holdfast_dnnl INTERFACE)
  target_include_directories(holdfast_dnnl SYSTEM INTERFACE ${HOLDFAST_DNNL_INCLUDE})
  target_link_libraries(holdfast_dnnl INTERFACE ${HOLDFAST_DNNL})
  # at::parallel_for is a template: without OpenMP in our own flags it runs on one thread. LibTorch uses GCC's runtime,
  # and a process must not have two, so clang (which serves for analysis only) goes without.
  if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    find_package(OpenMP REQUIRED COMPONENTS CXX)
    target_link_libraries(holdfast_torch INTERFACE OpenMP::OpenMP_CXX)
  endif()
endif()
if(HOLDFAST_TRAINING)
  find_package(PNG REQUIRED)
endif()
if(HOLDFAST_TESTS)
  find_package(GTest REQUIRED)
  find_package(benchmark REQUIRED)
endif()
