# find_package(uvcam) gives the target uvcam::uvcam, for C and, with uvcam.hpp, C++17.
get_filename_component(uvcam_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET uvcam::uvcam)
    add_library(uvcam::uvcam SHARED IMPORTED)
    set_target_properties(uvcam::uvcam PROPERTIES
        IMPORTED_LOCATION "${uvcam_prefix}/lib/libuvcam.so"
        INTERFACE_INCLUDE_DIRECTORIES "${uvcam_prefix}/include")
endif()
unset(uvcam_prefix)
