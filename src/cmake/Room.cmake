# mpuvdb_room(NAME HEADERS ... SOURCES ... ROOMS ... LIBRARIES ...)
#
# A room is a target of its own. Its include path holds its own headers and those of the rooms it names,
# and nothing else of ours, so that an upward include does not compile: <mpuvdb/x.h> is public and gets
# installed, "room/x.h" lies in a room's folder.
function(mpuvdb_room name)
    cmake_parse_arguments(ROOM "" "" "HEADERS;SOURCES;ROOMS;LIBRARIES" ${ARGN})
    set(door ${PROJECT_BINARY_DIR}/rooms/${name})
    file(MAKE_DIRECTORY ${door}/mpuvdb)
    foreach(header IN LISTS ROOM_HEADERS)
        file(CREATE_LINK ${PROJECT_SOURCE_DIR}/include/mpuvdb/${header} ${door}/mpuvdb/${header} SYMBOLIC)
    endforeach()
    file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR} ${door}/${name} SYMBOLIC)
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
