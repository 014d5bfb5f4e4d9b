# What is installed beside the programs, and Debian packages of it (make dist):
#   holdfast-server   the server, its health check and its unit for systemd, the shipped weights, and holdfast-import for
#                     others
#   holdfast-client   the command line
#   libholdfast-dev   the client library: find_package(holdfast), holdfast::client
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# holdfast_copyright(component package): where Debian wants it, our licence, and that of a library whose headers are in
# what we compile and which asks for it; the copy is the distribution's.
function(holdfast_copyright component package)
  set(place DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package} COMPONENT ${component})
  install(FILES LICENSE ${place} RENAME copyright)
  install(FILES /usr/share/doc/nlohmann-json3-dev/copyright ${place} RENAME copyright.nlohmann-json OPTIONAL)
endfunction()

if(HOLDFAST_SERVER)
  install(DIRECTORY weights DESTINATION ${CMAKE_INSTALL_DATADIR}/holdfast COMPONENT holdfast-server)
  install(FILES deploy/holdfast-server.service DESTINATION lib/systemd/system COMPONENT holdfast-server)
  holdfast_copyright(holdfast-server holdfast-server)
  install(FILES web/dist/licenses.txt DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/holdfast-server
    RENAME copyright.page COMPONENT holdfast-server)
endif()

if(HOLDFAST_CLIENT)
  holdfast_copyright(holdfast holdfast-client)
  holdfast_copyright(libholdfast-dev libholdfast-dev)
  set(headers ${CMAKE_INSTALL_INCLUDEDIR}/holdfast)
  set(library_dir ${CMAKE_INSTALL_LIBDIR}/holdfast)
  set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/holdfast)
  install(TARGETS holdfast_api holdfast_generated holdfast_proto holdfast_client EXPORT holdfast-targets
    ARCHIVE DESTINATION ${library_dir} COMPONENT libholdfast-dev
    INCLUDES DESTINATION ${headers})
  install(EXPORT holdfast-targets NAMESPACE holdfast:: DESTINATION ${config_dir} COMPONENT libholdfast-dev)
  install(DIRECTORY api DESTINATION ${headers} COMPONENT libholdfast-dev FILES_MATCHING PATTERN *.h)
  install(FILES client/backoff.h client/credentials.h client/remote_tracker.h
    DESTINATION ${headers}/client COMPONENT libholdfast-dev)
  # For clients in other languages, and for those that speak the protocol by themselves.
  install(DIRECTORY proto/holdfast proto/google DESTINATION ${CMAKE_INSTALL_DATADIR}/holdfast/proto COMPONENT libholdfast-dev)
  configure_package_config_file(cmake/holdfast-config.cmake.in ${PROJECT_BINARY_DIR}/holdfast-config.cmake
    INSTALL_DESTINATION ${config_dir})
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/holdfast-config-version.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/holdfast-config.cmake ${PROJECT_BINARY_DIR}/holdfast-config-version.cmake
    DESTINATION ${config_dir} COMPONENT libholdfast-dev)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/readable.cmake)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL holdfast-server holdfast libholdfast-dev)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
# Whoever makes the packages maintains them: the names that Debian's own tools read.
if(DEFINED ENV{DEBFULLNAME} AND DEFINED ENV{DEBEMAIL})
  set(CPACK_PACKAGE_CONTACT "$ENV{DEBFULLNAME} <$ENV{DEBEMAIL}>")
else()
  set(CPACK_PACKAGE_CONTACT "unknown <root@localhost>")
endif()
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_HOLDFAST-SERVER_PACKAGE_NAME holdfast-server)
set(CPACK_DEBIAN_HOLDFAST_PACKAGE_NAME holdfast-client)
set(CPACK_DEBIAN_LIBHOLDFAST-DEV_PACKAGE_NAME libholdfast-dev)
set(CPACK_DEBIAN_HOLDFAST-SERVER_PACKAGE_SECTION net)
set(CPACK_DEBIAN_HOLDFAST-SERVER_PACKAGE_CONTROL_EXTRA ${PROJECT_SOURCE_DIR}/deploy/packages/holdfast-server/prerm)
set(CPACK_DEBIAN_HOLDFAST-SERVER_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_HOLDFAST_PACKAGE_SECTION net)
# Which client/cli/picture_window.cc looks for.
math(EXPR opencv "${OpenCV_VERSION_MAJOR} * 100 + ${OpenCV_VERSION_MINOR}")
set(CPACK_DEBIAN_HOLDFAST_PACKAGE_RECOMMENDS "libopencv-highgui${opencv}")
set(CPACK_DEBIAN_LIBHOLDFAST-DEV_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_HOLDFAST-SERVER_DESCRIPTION "Point tracking server\n Tracks points in streamed video over gRPC.")
set(CPACK_COMPONENT_HOLDFAST_DESCRIPTION "Point tracking client\n Tracks points through video with a Holdfast server.")
set(CPACK_COMPONENT_LIBHOLDFAST-DEV_DESCRIPTION
  "Point tracking client library\n Streams video to a Holdfast server and takes tracks from it, in C++.")
set(CPACK_DEBIAN_LIBHOLDFAST-DEV_PACKAGE_DEPENDS "libabsl-dev, libgrpc++-dev, libprotobuf-dev, nlohmann-json3-dev, protobuf-compiler-grpc")
include(CPack)
