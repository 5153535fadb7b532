#include "calib/statistics/unit_slip.h"

#include <cmath>
#include <cstdio>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/median.h"
#include "calib/statistics/table_turns.h"

namespace turncal {

namespace {

constexpr UnitSlip of_accelerometers[] = {
    {1.0 / standard_gravity_mps2, "as if they were in g, not m/s^2"},
    {standard_gravity_mps2, "as if they were in m/s^2, not g"},
    {1000.0 / standard_gravity_mps2, "as if they were in mg, not m/s^2"},
    {standard_gravity_mps2 / 1000.0, "as if they were in m/s^2, not mg"},
    {2.0, "too large by 2: the range, or the rate, is another"},
    {0.5, "too small by 2: the range, or the rate, is another"},
};
constexpr UnitSlip of_gyros[] = {
    {1.0 / rad_per_deg, "as if they were in deg/s, not rad/s"},
    {rad_per_deg, "as if they were in rad/s, not deg/s"},
    {2.0, "too large by 2: the range, or the rate, is another"},
    {0.5, "too small by 2: the range, or the rate, is another"},
};

std::string found(const char* what, double ratio, const UnitSlip* slip) {
  if (slip == nullptr) return {};
  char text[200];
  std::snprintf(text, sizeof text, "%s %.4g times what is expected: %s", what, ratio, slip->words);
  return text;
}

std::string wrong_accelerometers(const CompressedRecording& recording, const SensorModel& model) {
  std::vector<double> ratios;
  for (const Block& block : recording.blocks)
    if (block.whole_second)
      ratios.push_back((model.accel_scale * block.accel).norm() / (block.duration_s * recording.info.gravity_mps2));
  if (ratios.empty()) return {};
  const double ratio = median(ratios);
  return found("gravity reads", ratio, slip_near(accel_slips(), ratio));
}

std::string wrong_gyros(const CompressedRecording& recording) {
  const double ratio = felt_of_commanded(recording);
  return found("in the table's turns the gyros add up to", ratio, slip_near(gyro_slips(), ratio));
}

}  // namespace

std::span<const UnitSlip> accel_slips() { return of_accelerometers; }
std::span<const UnitSlip> gyro_slips() { return of_gyros; }

const UnitSlip* slip_near(std::span<const UnitSlip> slips, double ratio) {
  for (const UnitSlip& slip : slips)
    if (std::abs(ratio / slip.factor - 1.0) < slip_nearness) return &slip;
  return nullptr;
}

std::string wrong_table_units(const CompressedRecording& recording) {
  const RecordingInfo& info = recording.info;
  const SensorModel model = sensor_model(start_parameters(info), info);
  std::string both;
  if (info.accel_increment == IncrementKind::physical) both = wrong_accelerometers(recording, model);
  const std::string gyros = info.gyro_increment == IncrementKind::physical ? wrong_gyros(recording) : std::string();
  if (!both.empty() && !gyros.empty()) both += "; ";
  return both + gyros;
}

}  // namespace turncal
