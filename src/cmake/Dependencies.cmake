# What the library stands on; our installed config repeats this.
include(CMakeFindDependencyMacro)

# find_package() of what the library needs: in our own tree it has to be there, and find_package(mpuvdb)
# says that mpuvdb is not found without it.
macro(mpuvdb_need)
    if(CMAKE_FIND_PACKAGE_NAME STREQUAL "mpuvdb")
        find_dependency(${ARGN})
    else()
        find_package(${ARGN} REQUIRED)
    endif()
endmacro()

# OpenVDB's own config package (vcpkg, conda) where there is one, else the find module that Debian ships
# outside CMake's own search path.
set(mpuvdb_module_path "${CMAKE_MODULE_PATH}") # to which its folder is added, with its FindTBB
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
            NO_CACHE)
    endif()
    if(MPUVDB_OPENVDB_MODULE_DIR)
        list(APPEND CMAKE_MODULE_PATH "${MPUVDB_OPENVDB_MODULE_DIR}")
    endif()
    find_package(OpenVDB MODULE QUIET COMPONENTS openvdb)
endif()
set(CMAKE_MESSAGE_LOG_LEVEL "${mpuvdb_log_level}")
if(NOT TARGET OpenVDB::openvdb)
    mpuvdb_need(OpenVDB) # says where it was looked for
endif()
mpuvdb_need(TBB)
# Eigen's config takes other major versions than the one that is asked for as unfit: ours are 3.3 to 5.
mpuvdb_need(Eigen3 NO_MODULE)
if(Eigen3_VERSION VERSION_LESS 3.3 OR Eigen3_VERSION VERSION_GREATER_EQUAL 6)
    set(mpuvdb_NOT_FOUND_MESSAGE "Eigen ${Eigen3_VERSION}: mpuvdb takes 3.3 to 5 (apt-get install libeigen3-dev)")
    set(mpuvdb_FOUND FALSE)
    if(NOT CMAKE_FIND_PACKAGE_NAME STREQUAL "mpuvdb")
        message(FATAL_ERROR "${mpuvdb_NOT_FOUND_MESSAGE}")
    endif()
    return()
endif()
mpuvdb_need(fmt)
mpuvdb_need(PNG)
set(CMAKE_MODULE_PATH "${mpuvdb_module_path}")
