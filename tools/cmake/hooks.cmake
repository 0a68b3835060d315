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
  foreach(kind IN ITEMS c fastrtps_c)
    set(target ${PROJECT_NAME}__rosidl_typesupport_${kind})
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    endif()
  endforeach()
endfunction()

# Python programs load only the libraries in C. Those below are for programs in C++, which build these packages in a ROS
# workspace. Without code in them, the build takes half the time. The folders of their headers are installed, empty.
function(leave_out_cpp_libraries)
  set(empty ${CMAKE_CURRENT_BINARY_DIR}/empty.cpp)
  file(WRITE ${empty} "")
  foreach(kind IN ITEMS cpp fastrtps_cpp introspection_cpp)
    set(target ${PROJECT_NAME}__rosidl_typesupport_${kind})
    if(TARGET ${target})
      set_property(TARGET ${target} PROPERTY SOURCES ${empty})
      file(MAKE_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/rosidl_typesupport_${kind}/${PROJECT_NAME})
    endif()
  endforeach()
endfunction()

if(PROJECT_IS_TOP_LEVEL)
  cmake_language(DEFER CALL leave_out_cpp_libraries)
  cmake_language(DEFER CALL drop_missing_include_directories)
  cmake_language(DEFER CALL compile_many_at_a_time)
endif()
