# find_package(zivi) and target_link_libraries(program zivi::zivi), or zivi::zivi_f32
get_filename_component(_zivi_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
foreach(_zivi_name zivi zivi_f32)
    if(NOT TARGET zivi::${_zivi_name})
        add_library(zivi::${_zivi_name} STATIC IMPORTED)
        if(EXISTS "${_zivi_prefix}/lib/${_zivi_name}.lib")
            set(_zivi_library "${_zivi_prefix}/lib/${_zivi_name}.lib")
        else()
            set(_zivi_library "${_zivi_prefix}/lib/lib${_zivi_name}.a")
        endif()
        set_target_properties(zivi::${_zivi_name} PROPERTIES
            IMPORTED_LOCATION "${_zivi_library}"
            INTERFACE_INCLUDE_DIRECTORIES "${_zivi_prefix}/include")
        unset(_zivi_library)
    endif()
endforeach()
unset(_zivi_name)
unset(_zivi_prefix)
