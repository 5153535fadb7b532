// What a SerialTurntable reads: the answers of an axis, and what is believed of them.
#include <cmath>

#include "imu_io/base/text_pieces.h"
#include "turntable_drivers/ascii/serial_turntable.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

Result<double> SerialTurntable::number(Axis axis, const Values& values, const std::string& quantity) const {
  auto place = values.find(quantity);
  if (place == values.end()) place = values.find(quantity + "." + to_string(axis));
  if (place == values.end()) return axis_error(axis, "no " + quantity + " in the answer");
  const std::optional<double> value = device_number(place->second);
  if (!value) return axis_error(axis, quantity + " '" + visible(place->second) + "': expected a number");
  return *value;
}

Result<SerialTurntable::Reading> SerialTurntable::read_once(Axis axis) {
  const DialectAxis& scale = dialect_.of(axis);
  const std::string suffix = std::string(".") + to_string(axis);
  std::optional<double> position_deg;
  Reading reading;
  bool status_read = false;
  for (const Exchange& exchange : dialect_.of(DialectOperation::status).exchanges) {
    const Values values = TRY(talk(exchange, axis, moves_));
    const auto answered = [&](const std::string& name) {
      return values.count(name) != 0 || values.count(name + suffix) != 0;
    };
    if (answered("position")) {
      const double value = TRY(number(axis, values, "position"));
      position_deg = scale.sign * value / scale.units_per_degree + scale.zero_deg;
    }
    if (answered("rate")) {
      const double value = TRY(number(axis, values, "rate"));
      reading.rate_degps = scale.sign * value / scale.measured_rate_scale;
    }
    if (answered("status")) {
      const auto place = values.find("status");
      reading.flags = flags_of(dialect_.status, place != values.end() ? place->second : values.at("status" + suffix));
      status_read = true;
    }
  }
  if (!position_deg || !status_read) return axis_error(axis, "no position or no status in the answers");
  reading.position_deg = *position_deg;
  if (scale.modulo_deg > 0.0) {
    reading.position_deg =
        unwrapped_deg(*position_deg, memory_[index(axis)].position_deg.value_or(0.0), scale.modulo_deg);
  }
  return reading;
}

Result<SerialTurntable::Reading> SerialTurntable::read(Axis axis, bool believed_only) {
  Error last;
  bool answered = false;
  for (int i = 0; i <= dialect_.link.read_retries; ++i) {
    Result<Reading> reading = read_once(axis);
    answered = reading.ok();
    if (!reading) {
      last = reading.error();
      lost_reason_ = last.message;
      if (last.kind == ErrorKind::aborted || !line_.is_open()) return last;
      continue;
    }
    if (!believed_only || believable(axis, reading->position_deg)) return reading;
    last = not_believed(axis, reading->position_deg);
  }
  lost_ = !answered;
  return last;
}

Result<AxisStatus> SerialTurntable::status(Axis axis) {
  TRY(connected());
  const Reading reading = TRY(read(axis, true));
  AxisMemory& memory = memory_[index(axis)];
  const double now_s = clock_.now_s();
  memory.note(reading.position_deg, now_s);
  const DialectFlags& flags = reading.flags;
  AxisStatus report;
  report.position_deg = reading.position_deg;
  report.rate_degps = reading.rate_degps.value_or(memory.rate_degps);
  report.rate_told = reading.rate_degps.has_value();
  report.in_position = flags[DriveBit::in_position].value_or(false);
  report.moving =
      flags[DriveBit::moving].value_or(!(std::abs(report.rate_degps) <= dialect_.moving_rate_degps)) || !flags.known;
  report.drive_on =
      flags[DriveBit::enabled].value_or(commanded_on_) || (!flags.known && dialect_.status.reports(DriveBit::enabled));
  memory.drive_on = report.drive_on;
  report.enabled = enable_called_ && flags.known && flags[DriveBit::enabled].value_or(true);
  const bool reports_homed = dialect_.status.reports(DriveBit::homed);
  // A device that knows only a circle has forgotten the turns after a lost link: it has to be homed again.
  const bool turns_known = dialect_.of(axis).modulo_deg == 0.0 || memory.home_called;
  const bool homed = reports_homed ? flags[DriveBit::homed].value_or(false)
                                   : memory.homed || (memory.home_called && report.in_position && !report.moving);
  // Without a flag of its own, "arrived" may be the old one: see described_turntable.h.
  report.homed = memory.judge_homed(homed && turns_known,
                                    report.moving || (!reports_homed && !report.in_position && !memory.homed));
  report.limit = flags[DriveBit::limit_positive].value_or(false) || flags[DriveBit::limit_negative].value_or(false);
  report.fault = flags[DriveBit::fault].value_or(false);
  report.emergency_stop = flags[DriveBit::emergency_stop].value_or(false);
  report.remote = flags[DriveBit::remote].value_or(true);
  report.raw = flags.raw;
  report.time_s = now_s;
  if (!flags.known) report.text = "unknown status";
  TRY(go_on(axis, report));
  return report;
}

Status SerialTurntable::commission(const AxisTriple& known_deg, double tolerance_deg) {
  TRY(connected());
  for (const Axis axis : all_axes) {
    const Reading reading = TRY(read(axis, false));
    const DialectAxis& scale = dialect_.of(axis);
    double read_deg = reading.position_deg;
    if (scale.modulo_deg > 0.0) read_deg = unwrapped_deg(read_deg, known_deg[axis], scale.modulo_deg);
    if (std::abs(read_deg - known_deg[axis]) <= tolerance_deg) {
      if (std::abs(2.0 * (known_deg[axis] - scale.zero_deg)) <= 2.0 * tolerance_deg) {
        return input_error(
            axis_error(axis, "at " + degrees(known_deg[axis]) + " the other sign fits as well: expected another angle")
                .message);
      }
      continue;
    }
    const double other_deg = 2.0 * scale.zero_deg - reading.position_deg;
    return input_error(axis_error(axis, "reads " + degrees(reading.position_deg) + ", stands at " +
                                            degrees(known_deg[axis]) +
                                            (std::abs(other_deg - known_deg[axis]) <= tolerance_deg
                                                 ? ": expected sign = " + std::to_string(-scale.sign)
                                                 : ": expected other units_per_degree or zero_deg"))
                           .message);
  }
  return {};
}

}  // namespace turncal
