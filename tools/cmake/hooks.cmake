# Runs inside every message package that tools/set_up.py builds (CMAKE_PROJECT_INCLUDE), after its CMakeLists.txt.
# The packages themselves stay as they would be in any ROS workspace, and so do the files that pip installed: a patch of
# those would be undone by the next pip, and would not be seen by anyone.

# The ROS wheels' targets name include folders of the machine that built them. CMake refuses targets with folders that
# do not exist, though nobody needs these: FindPython3 adds this machine's own.
function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(directories)
      foreach(directory IN LISTS directories)
        if(IS_ABSOLUTE "${directory}" AND NOT EXISTS "${directory}")
          list(REMOVE_ITEM directories "${directory}")
        endif()
      endforeach()
      set_property(TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${directories}")
    endif()
  endforeach()
endfunction()

# The generated C++ is many small files that include the same large headers. Compiled sixteen at a time it takes two
# thirds of the time. The other libraries' files can not share a translation unit.
function(compile_many_at_a_time)
  foreach(kind IN ITEMS c cpp fastrtps_c fastrtps_cpp)
    set(target ${PROJECT_NAME}__rosidl_typesupport_${kind})
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    endif()
  endforeach()
endfunction()

# The libraries in C++ take more than half of the time, and nothing in .venv uses them: rclpy needs those in C. A package
# in the place of a generator generates nothing. It has only the library of the generator, to which others link.
function(leave_out_libraries_in_cpp)
  foreach(package IN ITEMS rosidl_typesupport_cpp rosidl_typesupport_fastrtps_cpp rosidl_typesupport_introspection_cpp)
    file(CONFIGURE OUTPUT "${CMAKE_FIND_PACKAGE_REDIRECTS_DIR}/${package}-config.cmake" @ONLY CONTENT [[
find_package(fastcdr QUIET REQUIRED)
find_package(rmw QUIET REQUIRED)
find_package(rosidl_runtime_cpp QUIET REQUIRED)
if(NOT TARGET @package@::@package@)
  add_library(@package@::@package@ INTERFACE IMPORTED)
  target_include_directories(@package@::@package@ INTERFACE "@CMAKE_INSTALL_PREFIX@/include/@package@")
  target_link_libraries(@package@::@package@ INTERFACE "@CMAKE_INSTALL_PREFIX@/lib/lib@package@.so"
    fastcdr rmw::rmw rosidl_runtime_cpp::rosidl_runtime_cpp)
endif()
]])
  endforeach()
endfunction()

if(PROJECT_IS_TOP_LEVEL)
  leave_out_libraries_in_cpp()
  cmake_language(DEFER CALL drop_missing_include_directories)
  cmake_language(DEFER CALL compile_many_at_a_time)
endif()
