# Installs the build into a folder of its own, then configures, builds and runs the consumer there.
# cmake -D BUILD_DIR=... -D SOURCE_DIR=... -D WORK_DIR=... -D GENERATOR=... -P run.cmake
file(REMOVE_RECURSE ${WORK_DIR})
function(step)
    execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()
step(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${WORK_DIR}/prefix)
step(${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/build -G ${GENERATOR}
    -D CMAKE_PREFIX_PATH=${WORK_DIR}/prefix -D CMAKE_BUILD_TYPE=Release)
step(${CMAKE_COMMAND} --build ${WORK_DIR}/build)
foreach(standard 17 20)
    execute_process(COMMAND ${WORK_DIR}/build/consumer_${standard}
        OUTPUT_VARIABLE output_${standard} COMMAND_ERROR_IS_FATAL ANY)
    if(NOT output_${standard} MATCHES "^[1-9][0-9]+ active voxels\n$")
        message(FATAL_ERROR "consumer_${standard} printed: ${output_${standard}}")
    endif()
endforeach()
if(NOT output_17 STREQUAL output_20)
    message(FATAL_ERROR "C++17 and C++20 differ: ${output_17} ${output_20}")
endif()
step(${WORK_DIR}/prefix/bin/mpuvdb --version)
