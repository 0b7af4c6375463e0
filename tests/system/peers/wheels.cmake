# Lets packages that rosidl generates be built against the wheels of ROS 2 on PyPI, as in
#
#     cmake -S msgs -B build -DCMAKE_PROJECT_INCLUDE=$PWD/tests/system/peers/wheels.cmake ...
#
# The targets that those wheels export for Python name the headers of Python and NumPy where they lay on the machine that built the
# wheel, and CMake refuses a target with a folder that is not there. What is generated here looks for both headers itself, so such folders
# are left out, when the package has said all it wants and before CMake looks.
function(leave_out_folders_that_are_not_here)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT folders)
      continue()
    endif()
    set(here "")
    foreach(folder IN LISTS folders)
      if(NOT IS_ABSOLUTE "${folder}" OR EXISTS "${folder}")
        list(APPEND here "${folder}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${here}")
  endforeach()
endfunction()
cmake_language(DEFER CALL leave_out_folders_that_are_not_here)
