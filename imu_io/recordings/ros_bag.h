// Reads the sensor_msgs/Imu messages of a ROS bag as columns of numbers: MCAP, rosbag2's SQLite files (.db3) and folders, rosbag1 (.bag).
//
//   t                              s since the first message by header.stamp, or by the time of recording if no stamp was set
//   angular_velocity.x .y .z       rad/s
//   linear_acceleration.x .y .z    m/s^2, specific force: +g on the axis that points up (REP 145)
//   temperature                    degrees Celsius of a sensor_msgs/Temperature, in the first row after each reading; else NaN
//
// Sources: https://mcap.dev/spec; https://github.com/ros2/rosbag2 (tables topics and messages); http://wiki.ros.org/Bags/Format/2.0;
// DDS-XTypes 7.4 (CDR: alignment counts from the end of its 4-byte header, to 8 bytes or, in version 2, to 4);
// https://github.com/ros2/common_interfaces (the messages). One pass from front to back; memory holds one chunk and the columns.
//
// Errors are one line with the file and the byte or message. `skip_bad` skips and counts damage instead: a message that is cut off or not
// finite, a chunk with a wrong checksum, the missing end of a bag.
// Not read: encodings other than CDR and that of ROS 1.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {

struct BagImu {
  std::vector<NumberColumn> columns;
  std::vector<std::int64_t> message;  // of each row: its number within its topic, from 0, counting bad ones
  std::string topic, temperature_topic;
  std::optional<std::int64_t> started_utc_s;  // the first stamp, if it is civil time
  bool recording_times = false;               // no header.stamp was set: times of recording
  std::int64_t bad = 0;
  std::string first_bad;
};

// `topic`: may be empty if the bag has only one of this type. Errors about topics list the existing ones.
Result<BagImu> read_bag(const std::string& path, const std::string& topic, bool skip_bad);

// Writes an MCAP file atomically: zstd chunks with checksums, indexes and a summary. Each sample is a sensor_msgs/msg/Imu of topic /imu/data,
// preceded by a sensor_msgs/msg/Temperature of /imu/temperature where there is one. `columns`: time in s, rates, specific forces and optionally
// temperature. Stamps are whole nanoseconds and begin at the recording's start (UTC), or at 1 s if that is unknown, since 0 means no stamp.
// The covariances say that orientation is not measured, and that the others are unknown.
Status write_imu_mcap(RecordingSource& source, const SampleColumns& columns, const std::string& path);

}  // namespace turncal
