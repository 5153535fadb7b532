// statistics.tcs: what a calibration leaves for the fleet (calib/fleet/unit_statistics.h), with its parameter file. Binary, little-endian, with
// a CRC-32C at the end; format: docs/fleet.md. It is smaller than 100 kB with the whole catalogue and temperature.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "calib/fleet/unit_statistics.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

inline constexpr const char* statistics_name = "statistics.tcs";

struct StatisticsFile {
  ParameterFile file;  // of the base model or of the diagnosed unit: identifies unit, time and site
  UnitStatistics statistics;
};

// Returns an error when the parameter file cannot be written (format_parameter_file).
Result<std::vector<std::byte>> format_statistics(const StatisticsFile& statistics);
Status write_statistics(const StatisticsFile& statistics, const std::string& path);

// Errors name `file_name`: no such file, another version, cut off, a wrong checksum, an invalid number.
Result<StatisticsFile> parse_statistics(std::span<const std::byte> bytes, const std::string& file_name);

}  // namespace turncal
