#include "orchestrator/devices/table_device.h"

#include <poll.h>

#include <algorithm>
#include <cassert>
#include <cmath>

#include "calib/model/parameters.h"
#include "turntable_drivers/ascii/sentence_codec.h"
#include "turntable_drivers/modbus/register_codec.h"
#include "turntable_drivers/table/described_turntable.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

Status TableDevice::leave() {
  if (left_) return {};
  left_ = true;
  const auto wait = [](double seconds) { ::poll(nullptr, 0, static_cast<int>(1e3 * seconds)); };
  return leave_off(limited_, {.now_s = monotonic_s, .wait = wait, .standing_rate_degps = standing_rate_degps_});
}

TableDevice::~TableDevice() {
  // Whoever could be told of a failure has read of it where the run's own stop failed.
  static_cast<void>(leave().ok());
}

Status TableDevice::commission(const AxisTriple& known_deg, double tolerance_deg) {
  if (auto* described = dynamic_cast<DescribedTurntable*>(driver_.get()))
    return described->commission(known_deg, tolerance_deg);
  return input_error("this table has nothing to commission");
}

Result<std::unique_ptr<TableDevice>> make_table(const StationConfig& station, const TableContext& context) {
  std::unique_ptr<Turntable> driver;
  switch (station.table.driver) {
    case TableDriver::mock:
      return input_error("station '" + station.name +
                         "': table.driver = mock has no table to turn: expected modbus, serial or manual");
    case TableDriver::modbus:
      assert(station.table.map);
      driver = std::make_unique<DescribedTurntable>(*station.table.map, context.clock, context.stop_requests);
      break;
    case TableDriver::serial:
      assert(station.table.dialect);
      driver = std::make_unique<DescribedTurntable>(*station.table.dialect, context.clock, context.stop_requests);
      break;
    case TableDriver::manual:
      assert(context.operator_output);
      driver = std::make_unique<ManualTurntable>(station.table.manual, context.clock, context.operator_input,
                                                 *context.operator_output, context.gravity);
      break;
  }
  return std::make_unique<TableDevice>(std::move(driver), station.axis, station.motion.settle_rate_degps);
}

namespace {

constexpr double half_s = 0.5;
constexpr std::int64_t longest_gap = 2000;  // samples; behind a longer one nobody knows
constexpr double still = 0.02;              // of the halves' mean

}  // namespace

GravityWatch::GravityWatch(ImuSource& source, double sample_period_s)
    : source_(source), half_samples_(std::max(1, static_cast<int>(std::lround(half_s / sample_period_s)))) {}

Status GravityWatch::open() {
  count_ = 0;
  sum_ = {};
  last_.reset();
  before_.reset();
  counter_.reset();
  RecordingInfo info;
  source_.describe(info);
  deg_per_count_ = nominal_gyro_rad(info) / rad_per_deg;
  return source_.open();
}

Result<std::size_t> GravityWatch::read(std::span<ImuSample> out, double timeout_s) {
  Result<std::size_t> got = source_.read(out, timeout_s);
  if (!got) return got;
  for (const ImuSample& sample : out.first(*got)) {
    const std::int64_t steps =
        counter_ ? std::clamp<std::int64_t>(sample.counter - *counter_, 1, longest_gap) : std::int64_t{1};
    counter_ = sample.counter;
    for (std::size_t i = 0; i < 3; ++i) {
      sum_[i] += sample.accel[i];
      turned_[i] += deg_per_count_ * sample.gyro[i] * static_cast<double>(steps);
    }
    if (++count_ < half_samples_) continue;
    for (double& value : sum_) value /= half_samples_;
    before_ = last_;
    last_ = sum_;
    sum_ = {};
    count_ = 0;
  }
  return got;
}

std::optional<std::array<double, 3>> GravityWatch::mean() const {
  if (!last_ || !before_) return {};
  std::array<double, 3> mean{};
  double size = 0.0, difference = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    mean[i] = 0.5 * ((*last_)[i] + (*before_)[i]);
    size += mean[i] * mean[i];
    difference += std::pow((*last_)[i] - (*before_)[i], 2);
  }
  if (!(std::sqrt(difference) <= still * std::sqrt(size))) return {};
  return mean;
}

}  // namespace turncal
