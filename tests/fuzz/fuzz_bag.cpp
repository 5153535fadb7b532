// Bytes as a ROS bag (MCAP, rosbag1, rosbag2's SQLite file: by their first bytes). Bit 0 of byte 0: what is damaged is left out.
#include <cmath>

#include "imu_io/recordings/ros_bag.h"
#include "input.h"
#include "scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  static const fuzz::ScratchFolder folder;
  static const fuzz::ScratchFile file(folder, "bag");
  fuzz::Input input(data, size);
  const bool skip_bad = (input.byte() & 1U) != 0;
  file.write(input.rest);
  const auto bag = read_bag(file.path(), "", skip_bad);
  if (!fuzz::taken(bag)) return 0;
  for (const NumberColumn& column : bag->columns) {
    fuzz::require(column.values.size() == bag->message.size());
    for (const double value : column.values) fuzz::require(std::isfinite(value) || column.name == "temperature");
  }
  return 0;
}
