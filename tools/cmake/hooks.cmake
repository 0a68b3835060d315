# CMake runs this file in every message package that tools/set_up.py builds (CMAKE_PROJECT_INCLUDE), after the package's
# CMakeLists.txt.
# The packages and the files that pip installed are not changed. A patch of the installed files would be undone by the
# next run of pip without a notice.

# The targets of the ROS wheels list include folders of the machine that built the wheels. CMake refuses targets with
# folders that do not exist, although no target needs them: FindPython3 adds the folders of this machine.
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

# The generated C++ code consists of many small files that include the same large headers. Compiling sixteen files at a
# time takes two thirds of the time. The files of the other libraries cannot share a translation unit.
function(compile_many_at_a_time)
  foreach(kind IN ITEMS c cpp fastrtps_c fastrtps_cpp)
    set(target ${PROJECT_NAME}__rosidl_typesupport_${kind})
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    endif()
  endforeach()
endfunction()

# The C++ libraries take more than half of the build time, and no program in .venv uses them, because rclpy needs the C
# libraries. Each package here replaces a generator and generates nothing. It has only the generator's library, to which
# other packages link.
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
