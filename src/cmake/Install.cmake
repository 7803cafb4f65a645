include(CMakePackageConfigHelpers)

get_property(headers GLOBAL PROPERTY MPUVDB_HEADERS)
list(TRANSFORM headers PREPEND ${PROJECT_SOURCE_DIR}/include/mpuvdb/)
install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/mpuvdb)
install(TARGETS mpuvdb EXPORT mpuvdbTargets
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/mpuvdb)
install(EXPORT mpuvdbTargets NAMESPACE mpuvdb:: DESTINATION ${config_dir})
configure_package_config_file(src/cmake/mpuvdbConfig.cmake.in
    ${PROJECT_BINARY_DIR}/mpuvdbConfig.cmake INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/mpuvdbConfigVersion.cmake
    COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/mpuvdbConfig.cmake ${PROJECT_BINARY_DIR}/mpuvdbConfigVersion.cmake
    src/cmake/Dependencies.cmake DESTINATION ${config_dir})
