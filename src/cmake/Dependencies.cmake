# What the library stands on; our installed config repeats this.

# OpenVDB's own config package (vcpkg, conda) where there is one, else the find module that Debian ships
# outside CMake's own search path.
set(mpuvdb_log_level "${CMAKE_MESSAGE_LOG_LEVEL}")
set(CMAKE_MESSAGE_LOG_LEVEL WARNING) # Imath's config says at length that it found no Python
find_package(OpenVDB CONFIG QUIET COMPONENTS openvdb)
if(NOT TARGET OpenVDB::openvdb)
    find_path(MPUVDB_OPENVDB_MODULE_DIR FindOpenVDB.cmake
        PATH_SUFFIXES cmake/OpenVDB lib/cmake/OpenVDB lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB
        NO_CACHE)
    if(NOT MPUVDB_OPENVDB_MODULE_DIR)
        find_path(MPUVDB_OPENVDB_MODULE_DIR FindOpenVDB.cmake
            PATHS /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB /usr/lib/x86_64-linux-gnu/cmake/OpenVDB
                  /usr/lib/aarch64-linux-gnu/cmake/OpenVDB /usr/lib/cmake/OpenVDB /usr/local/lib/cmake/OpenVDB
            NO_CACHE REQUIRED)
    endif()
    list(APPEND CMAKE_MODULE_PATH "${MPUVDB_OPENVDB_MODULE_DIR}")
    find_package(OpenVDB MODULE REQUIRED COMPONENTS openvdb)
endif()
set(CMAKE_MESSAGE_LOG_LEVEL "${mpuvdb_log_level}")
find_package(TBB REQUIRED)
# Eigen's config takes other major versions than the one that is asked for as unfit: ours are 3.3 to 5.
find_package(Eigen3 REQUIRED NO_MODULE)
if(Eigen3_VERSION VERSION_LESS 3.3 OR Eigen3_VERSION VERSION_GREATER_EQUAL 6)
    message(FATAL_ERROR "Eigen ${Eigen3_VERSION}: mpuvdb takes 3.3 to 5 (apt-get install libeigen3-dev)")
endif()
find_package(fmt REQUIRED)
find_package(PNG REQUIRED)
