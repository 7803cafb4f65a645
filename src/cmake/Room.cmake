# mpuvdb_room(NAME HEADERS ... SHARED ... SOURCES ... ROOMS ... LIBRARIES ...)
#
# A room is a target of its own. Its include path holds its own public headers and those of the rooms
# it names, and nothing else of ours, so that an upward include does not compile. SHARED headers lie in
# the room's own folder: other rooms include them like public ones, but they are not installed.
function(mpuvdb_room name)
    cmake_parse_arguments(ROOM "" "" "HEADERS;SHARED;SOURCES;ROOMS;LIBRARIES" ${ARGN})
    set(door ${PROJECT_BINARY_DIR}/rooms/${name})
    file(MAKE_DIRECTORY ${door}/mpuvdb)
    foreach(header IN LISTS ROOM_HEADERS)
        file(CREATE_LINK ${PROJECT_SOURCE_DIR}/include/mpuvdb/${header} ${door}/mpuvdb/${header} SYMBOLIC)
    endforeach()
    foreach(header IN LISTS ROOM_SHARED)
        file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR}/${header} ${door}/mpuvdb/${header} SYMBOLIC)
    endforeach()
    add_library(mpuvdb_${name} OBJECT ${ROOM_SOURCES})
    target_include_directories(mpuvdb_${name} PUBLIC $<BUILD_INTERFACE:${door}>)
    target_link_libraries(mpuvdb_${name} PRIVATE mpuvdb_options)
    target_link_libraries(mpuvdb_${name} PUBLIC ${ROOM_LIBRARIES})
    if(MPUVDB_SANITIZE AND name IN_LIST MPUVDB_SANITIZE_ROOMS)
        target_compile_options(mpuvdb_${name} PRIVATE ${MPUVDB_WATCHED})
    endif()
    foreach(room IN LISTS ROOM_ROOMS)
        # Usage requirements only: the objects meet in the library mpuvdb.
        target_include_directories(mpuvdb_${name} PUBLIC
            $<TARGET_PROPERTY:mpuvdb_${room},INTERFACE_INCLUDE_DIRECTORIES>)
        target_link_libraries(mpuvdb_${name} PUBLIC
            $<TARGET_PROPERTY:mpuvdb_${room},INTERFACE_LINK_LIBRARIES>)
    endforeach()
    set_property(GLOBAL APPEND PROPERTY MPUVDB_ROOMS mpuvdb_${name})
    set_property(GLOBAL APPEND PROPERTY MPUVDB_HEADERS ${ROOM_HEADERS})
endfunction()
