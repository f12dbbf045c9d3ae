# The ROS wheels' CMake files name include directories of the machine the wheels were built on
# (/opt/python/...), and CMake refuses a target with a directory that doesn't exist. Used through
# CMAKE_PROJECT_TOP_LEVEL_INCLUDES: at the end of the project those entries are dropped from every
# imported target.
function(roller_drop_wheel_paths)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(directories)
      list(FILTER directories EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${directories}")
    endif()
  endforeach()
endfunction()

cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL roller_drop_wheel_paths)
