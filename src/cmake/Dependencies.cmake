# Debian ships OpenVDB's find module outside CMake's own search path; our installed config repeats this.
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

# Debian's Imath config says at length that a Python library, which nothing here uses, is not there.
set(mpuvdb_log_level "${CMAKE_MESSAGE_LOG_LEVEL}")
set(CMAKE_MESSAGE_LOG_LEVEL WARNING)
find_package(OpenVDB REQUIRED COMPONENTS openvdb)
set(CMAKE_MESSAGE_LOG_LEVEL "${mpuvdb_log_level}")
find_package(TBB REQUIRED)
find_package(Eigen3 3.3 REQUIRED NO_MODULE)
find_package(fmt REQUIRED)
find_package(PNG REQUIRED)
