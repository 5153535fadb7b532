# How sources are compiled, in the program's build and in that of tests/fuzz.

# Eigen cuts a product of matrices by the processor's caches, and where it cuts it rounds: with sizes of its own results are the same bytes
# on every x86-64.
add_compile_definitions(EIGEN_NO_CPUID)
# GCC collects its garbage from 1 GB on, not from 128 MB: 8 % less time for a quarter more memory.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  add_compile_options(--param=ggc-min-heapsize=1048576)
endif()

# Headers of others that most files include are read once: Eigen for calib, the standard library for the rest. A file includes
# what it uses all the same; the debug preset builds without.
set(TURNCAL_STD_HEADERS <algorithm> <array> <chrono> <cmath> <cstdint> <cstdio> <cstring> <functional> <limits> <map>
    <memory> <optional> <span> <sstream> <string> <string_view> <utility> <variant> <vector> <fmt/format.h>)

# A room is compiled as one file: its headers and templates are worked through once. -DTURNCAL_ROOMS=OFF compiles file by file, as
# the debug preset does. Of `target` all rooms, or those that are named.
option(TURNCAL_ROOMS "Compile each room as one file" ON)
function(turncal_compile_rooms target)
  if(NOT TURNCAL_ROOMS)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    cmake_path(GET source PARENT_PATH folder)
    cmake_path(GET folder FILENAME room)
    if(ARGN AND NOT room IN_LIST ARGN)
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
      continue()
    endif()
    string(MAKE_C_IDENTIFIER "${folder}" room)
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${room})
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

# Of tests eight files make one: what a file defines for itself has a name that no other test of its folder has.
function(turncal_compile_tests target)
  if(TURNCAL_ROOMS)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  endif()
endfunction()

# Text that is compiled in: embed_text(NAME FILE) makes `const std::string_view NAME` of a file; whoever uses it declares it extern.
function(embed_text NAME file)
  get_filename_component(path ${file} ABSOLUTE)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${path})
  file(READ ${path} TEXT)
  configure_file(${CMAKE_CURRENT_FUNCTION_LIST_DIR}/imu_io/base/embedded_text.cpp.in ${CMAKE_CURRENT_BINARY_DIR}/embedded/${NAME}.cpp @ONLY)
  set(embedded ${embedded} ${CMAKE_CURRENT_BINARY_DIR}/embedded/${NAME}.cpp PARENT_SCOPE)
endfunction()
