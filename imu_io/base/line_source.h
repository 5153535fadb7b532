// Where the lines of a description (a register map, a dialect, a frame) come from.
//
//   source.manual = Maker, "Title", edition                 names a source
//   write.stop = 0x50E u32 1000           # [manual]        a line that is taken from it
//   link.terminator_in = \n               # [guess]         a line for which there is none
//   axis.heading.unit = 1                 # [yours]         a setting of the station, which claims nothing of the device
//
// More may stand after the bracket. A line without a mark is the word of whoever wrote the file.
#pragma once

#include <string>
#include <vector>

#include "imu_io/base/key_value.h"

namespace turncal {

struct LineSource {
  std::string key;
  int line = 0;
  std::string mark;  // empty: none
  bool is_guess() const { return mark == "guess"; }
};

// Of every key but source.*, which it reads. In a file that names sources a mark that is none of them is a defect.
std::vector<LineSource> read_line_sources(KeyValueFile& file);

}  // namespace turncal
