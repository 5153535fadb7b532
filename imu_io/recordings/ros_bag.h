// The sensor_msgs/Imu messages of a ROS bag as columns of numbers: MCAP, rosbag2's SQLite files (.db3) and folders, rosbag1 (.bag).
//
//   t                              s since the first message, by header.stamp; by the time of recording where no stamp was set
//   angular_velocity.x .y .z       rad/s
//   linear_acceleration.x .y .z    m/s^2, specific force: +g on the axis that points up (REP 145)
//   temperature                    degrees Celsius of a sensor_msgs/Temperature: in the first row after each reading, else NaN
//
// Sources: https://mcap.dev/spec; https://github.com/ros2/rosbag2 (tables topics and messages); http://wiki.ros.org/Bags/Format/2.0;
// DDS-XTypes 7.4 (CDR: alignment counts from the end of its 4-byte header, to 8 bytes or, in version 2, to 4);
// https://github.com/ros2/common_interfaces (the messages). Read once from front to back, in memory for a chunk and the columns.
//
// Errors: one line with the file and the byte or message. With `skip_bad` what is damaged is left out and counted: a message that is cut off
// or not finite, a chunk with a wrong checksum, the missing end of a bag that was cut off.
// Not read: encodings other than CDR and ROS 1's own.
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
  std::vector<std::int64_t> message;  // of each row: its number among those of its topic, from 0, bad ones counted
  std::string topic, temperature_topic;
  std::optional<std::int64_t> started_utc_s;  // the first stamp, where it is a time of day
  bool recording_times = false;               // no header.stamp was set
  std::int64_t bad = 0;
  std::string first_bad;
};

// `topic`: empty where the bag has one of the type. Errors about topics list those that are there.
Result<BagImu> read_bag(const std::string& path, const std::string& topic, bool skip_bad);

// A sensor_msgs/msg/Imu of topic /imu/data for each sample, in an MCAP file (chunks of zstd with checksums, indexes and a summary), whole or not at
// all; a sensor_msgs/msg/Temperature of /imu/temperature before it where there is one. `columns`: time in s, rates, specific forces, and
// maybe a temperature. Stamps begin when the recording did (UTC), where that is not known at 1 s, since 0 says that there is none, and are whole
// nanoseconds. The orientation's covariance says that it is not measured, the others that they are not known.
Status write_imu_mcap(RecordingSource& source, const SampleColumns& columns, const std::string& path);

}  // namespace turncal
