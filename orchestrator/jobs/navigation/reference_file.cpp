#include "orchestrator/jobs/navigation/reference_file.h"

#include <cmath>

#include "calib/model/parameters.h"
#include "calib/navigation/alignment.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {

Result<ReferenceTrack> read_reference(const std::string& path) {
  const Result<std::string> content = read_whole_file(path);
  if (!content) return content.error();
  const Result<NumberTable> table = read_number_table(*content, path,
                                                      {{"time_s"},
                                                       {"latitude_deg"},
                                                       {"longitude_deg"},
                                                       {.name = "height_m", .may_be_missing = true},
                                                       {.name = "velocity_north_mps", .may_be_missing = true},
                                                       {.name = "velocity_east_mps", .may_be_missing = true}},
                                                      TableFormat{.whole_rows = true});
  if (!table) return table.error();
  if (table->rows() < 2)
    return input_error(path + ": " + std::to_string(table->rows()) + " rows: expected two and more");
  const auto& c = table->columns;
  const bool with_velocity = !c[4].empty() && !c[5].empty();
  if (c[4].empty() != c[5].empty())
    return input_error(path + ": one of velocity_north_mps and velocity_east_mps: expected both or neither");
  std::vector<ReferencePoint> points;
  for (std::size_t row = 0; row < table->rows(); ++row) {
    const auto refuse = [&](const char* name, double value, const std::string& expected) {
      return input_error(path + ":" + std::to_string(table->line[row]) + ": " + name + " = '" + format_number(value) +
                         "': expected " + expected);
    };
    if (!points.empty() && !(c[0][row] > points.back().time_s))
      return refuse("time_s", c[0][row], "more than in the row before");
    if (std::abs(c[1][row]) > max_navigation_latitude_deg)
      return refuse(
          "latitude_deg", c[1][row],
          "-" + format_number(max_navigation_latitude_deg) + " to " + format_number(max_navigation_latitude_deg));
    if (std::abs(c[2][row]) > 360.0) return refuse("longitude_deg", c[2][row], "-360 to 360");
    ReferencePoint point{c[0][row], c[1][row] * rad_per_deg, c[2][row] * rad_per_deg};
    if (!c[3].empty()) point.height_m = c[3][row];
    if (with_velocity) point.velocity_mps = {c[4][row], c[5][row]};
    points.push_back(point);
  }
  return ReferenceTrack(std::move(points), with_velocity);
}

}  // namespace turncal
