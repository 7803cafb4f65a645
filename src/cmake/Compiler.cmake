# How everything of ours is compiled.
set(CMAKE_CXX_STANDARD 17 CACHE STRING "C++17 or C++20")
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_FLAGS_RELEASE "-O3 -DNDEBUG")

option(MPUVDB_WERROR "Warnings are errors" OFF)
set(MPUVDB_SANITIZE "" CACHE STRING "Sanitizers: address,undefined or thread")
set(MPUVDB_SANITIZE_ROOMS "" CACHE STRING "Rooms that the sanitizers watch, beside the tests; empty: all")

if(MPUVDB_WERROR AND (MPUVDB_SANITIZE_ROOMS OR NOT MPUVDB_SANITIZE))
    set(MPUVDB_ERRORS -Werror) # under sanitizers g++ warns falsely
endif()

add_library(mpuvdb_options INTERFACE)
# No FMA contraction: the same bits from every instruction set. errno and traps of math functions
# are never looked at, and cost the vectoriser every sqrt.
target_compile_options(mpuvdb_options INTERFACE
    -Wall -Wextra -Wconversion -Wno-sign-conversion -Wshadow
    -ffp-contract=off -fno-math-errno -fno-trapping-math
    ${MPUVDB_ERRORS})
if(CMAKE_UNITY_BUILD)
    # Sources compiled as one see each other's names, and are no longer main files.
    target_compile_options(mpuvdb_options INTERFACE -Wno-shadow $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
if(MPUVDB_SANITIZE)
    set(MPUVDB_WATCHED -fsanitize=${MPUVDB_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all
        -Wno-error -O1 -g1 -UNDEBUG) # under sanitizers g++ warns falsely
    target_link_options(mpuvdb_options INTERFACE -fsanitize=${MPUVDB_SANITIZE})
    set(MPUVDB_WATCHED_TESTS ${MPUVDB_WATCHED})
    if(MPUVDB_SANITIZE_ROOMS)
        # Undefined behavior is looked for in the rooms; in tests of them that is half the time of compiling.
        list(APPEND MPUVDB_WATCHED_TESTS -fno-sanitize=undefined)
    else()
        target_compile_options(mpuvdb_options INTERFACE ${MPUVDB_WATCHED})
    endif()
endif()
if(NOT CMAKE_CXX_COMPILER_LAUNCHER)
    find_program(MPUVDB_CCACHE ccache)
    if(MPUVDB_CCACHE)
        # What a precompiled header needs of ccache. Paths count from the build folder: other presets
        # and working copies share what is compiled alike.
        set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}
            CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime ${MPUVDB_CCACHE})
        add_compile_options($<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess>)
    endif()
endif()
