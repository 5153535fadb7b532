// What a ModbusTurntable reads: the status block of an axis, what is believed of it, and the heartbeat that goes with it.
#include <cmath>

#include "imu_io/base/format_number.h"
#include "turntable_drivers/modbus/modbus_turntable.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

double ModbusTurntable::raw_counts(Axis axis, const std::vector<std::uint16_t>& block, WordLayout layout) const {
  const RegisterField& position = map_.of(axis).position;
  return decode_words(std::span(block).subspan(map_.place_of(position.address)), position.type, layout);
}

std::optional<bool> ModbusTurntable::bit(Axis axis, const std::vector<std::uint16_t>& block, DriveBit which) const {
  const std::optional<StatusBit>& described = map_.of(axis).bit(which);
  if (!described) return {};
  return described->is_set(block[map_.place_of(described->address)]);
}

Result<std::vector<std::uint16_t>> ModbusTurntable::read_block(Axis axis) {
  const MapAxis& place = map_.of(axis);
  std::vector<std::uint16_t> block;
  const auto append = [&](int address, int count, bool of_table) -> Status {
    if (count == 0) return {};
    // Longer by the axis, so that no two requests have the same length; what is beyond is thrown away.
    std::vector<std::uint16_t> registers(static_cast<std::size_t>(count) + index(axis));
    const int first = address + (of_table ? 0 : place.address_offset);
    if (Status status = link_.read(place.unit, map_.status_function, first, registers); !status) {
      return Error{status.error().kind, axis_error(axis, status.error().message).message};
    }
    block.insert(block.end(), registers.begin(), registers.begin() + count);
    return {};
  };
  TRY(append(map_.status_address, map_.status_count, map_.status_of_table));
  if (Status status = append(map_.status2_address, map_.status2_count, map_.status2_of_table); !status) {
    return status.error();
  }
  return block;
}

std::optional<double> ModbusTurntable::believed_position(Axis axis, const std::vector<std::uint16_t>& block) const {
  const MapAxis& scale = map_.of(axis);
  double position_deg = angle_of(scale, raw_counts(axis, block, map_.layout));
  if (scale.modulo_deg > 0.0 && std::isfinite(position_deg)) {
    position_deg = unwrapped_deg(position_deg, memory_[index(axis)].position_deg.value_or(0.0), scale.modulo_deg);
  }
  if (!believable(axis, position_deg)) return {};
  return position_deg;
}

AxisStatus ModbusTurntable::status_from(Axis axis, const std::vector<std::uint16_t>& block, double position_deg,
                                        double now_s) {
  AxisMemory& memory = memory_[index(axis)];
  const MapAxis& scale = map_.of(axis);
  AxisStatus report;
  report.position_deg = position_deg;
  memory.note(position_deg, now_s);
  report.rate_degps = memory.rate_degps;
  report.rate_told = scale.rate.has_value();
  if (scale.rate) {
    const auto from = map_.place_of(scale.rate->address);
    report.rate_degps = scale.sign * decode_words(std::span(block).subspan(from), scale.rate->type, map_.layout) /
                        scale.measured_rate_scale;
  }

  report.drive_on = bit(axis, block, DriveBit::enabled).value_or(true);
  memory.drive_on = report.drive_on;
  report.enabled = enable_called_ && report.drive_on;
  report.moving = bit(axis, block, DriveBit::moving).value_or(!(std::abs(report.rate_degps) <= map_.moving_rate_degps));
  report.in_position = bit(axis, block, DriveBit::in_position).value_or(false);
  if (scale.bit(DriveBit::in_position)->pulse) {
    memory.arrived_seen = memory.arrived_seen || report.in_position;
    report.in_position = memory.arrived_seen && !report.moving;
  }
  const bool drive_homed =
      map_.home_by_encoder ? memory.home_called : bit(axis, block, DriveBit::homed).value_or(false);
  // A device that knows only a circle has forgotten the turns after a lost link: it has to be homed again.
  const bool turns_known = scale.modulo_deg == 0.0 || memory.home_called;
  report.homed = memory.judge_homed(drive_homed && turns_known, report.moving);
  report.limit = bit(axis, block, DriveBit::limit_positive).value_or(false) ||
                 bit(axis, block, DriveBit::limit_negative).value_or(false);
  report.fault = bit(axis, block, DriveBit::fault).value_or(true);
  report.emergency_stop = bit(axis, block, DriveBit::emergency_stop).value_or(false);
  report.remote = bit(axis, block, DriveBit::remote).value_or(true);
  for (int i = 0; i < drive_bit_count; ++i) {
    report.raw |= bit(axis, block, static_cast<DriveBit>(i)).value_or(false) ? 1u << i : 0u;
  }
  if (scale.alarm) {
    const auto from = map_.place_of(scale.alarm->address);
    const double code = decode_words(std::span(block).subspan(from), scale.alarm->type, map_.layout);
    if (code != 0.0) {
      report.text = "alarm " + format_number(code);
      const auto text = map_.alarm_text.find(static_cast<long>(code));
      if (text != map_.alarm_text.end()) report.text += " (" + text->second + ")";
    }
  }
  report.time_s = now_s;
  return report;
}

Status ModbusTurntable::beat() {
  if (!map_.heartbeat_address) return {};
  const double now_s = clock_.now_s();
  Status first_failure;
  for (const Axis axis : all_axes) {
    AxisMemory& memory = memory_[index(axis)];
    if (now_s - memory.heartbeat_s < map_.heartbeat_period_s) continue;
    if (map_.heartbeat_of_table && axis != Axis::heading) break;
    const MapAxis& place = map_.of(axis);
    // Another value each time, so that a drive can tell it from one that is stuck.
    std::size_t& beats = beats_[index(axis)];
    const std::vector<std::uint16_t>& values = map_.heartbeat_values;
    const std::uint16_t value =
        values.empty() ? static_cast<std::uint16_t>(1 + beats % 0xFFFF) : values[beats % values.size()];
    const int offset = map_.heartbeat_of_table ? 0 : place.address_offset;
    const Status status =
        link_.write(place.unit, map_.write_function, *map_.heartbeat_address + offset, std::span(&value, 1));
    if (status) {
      memory.heartbeat_s = now_s;
      ++beats;
    } else if (first_failure) {
      first_failure = Error{status.error().kind, axis_error(axis, "heartbeat: " + status.error().message).message};
    }
  }
  return first_failure;
}

Result<AxisStatus> ModbusTurntable::status(Axis axis) {
  TRY(connected());
  // A heartbeat that was not acknowledged is due again; the reading says whether the drive is there.
  const Status heartbeat = beat();
  double seen_deg = 0.0;
  for (int i = 0; i <= map_.link.read_retries; ++i) {
    const std::vector<std::uint16_t> block = TRY(read_block(axis));
    if (const std::optional<double> position_deg = believed_position(axis, block)) {
      if (!heartbeat && heartbeat.error().kind == ErrorKind::input) return heartbeat.error();
      return status_from(axis, block, *position_deg, clock_.now_s());
    }
    seen_deg = angle_of(map_.of(axis), raw_counts(axis, block, map_.layout));
  }
  return not_believed(axis, seen_deg);
}

Status ModbusTurntable::commission(const AxisTriple& known_deg, double tolerance_deg) {
  if (!connected_) {
    TRY(open_drives(false));
  }
  for (const Axis axis : all_axes) {
    const std::vector<std::uint16_t> block = TRY(read_block(axis));
    const MapAxis& scale = map_.of(axis);
    // How far the reading is from the known angle if words, bytes and sign were like this.
    const auto fits = [&](WordLayout layout, int sign) {
      MapAxis other = scale;
      other.sign = sign;
      double angle_deg = angle_of(other, raw_counts(axis, block, layout));
      if (scale.modulo_deg > 0.0 && std::isfinite(angle_deg)) {
        angle_deg = unwrapped_deg(angle_deg, known_deg[axis], scale.modulo_deg);
      }
      return std::abs(angle_deg - known_deg[axis]) <= tolerance_deg;
    };
    std::string others;
    for (const bool high_first : {true, false}) {
      for (const bool swap : {false, true}) {
        for (const int sign : {1, -1}) {
          const WordLayout layout{high_first, swap};
          const bool is_maps =
              high_first == map_.layout.high_word_first && swap == map_.layout.swap_bytes && sign == scale.sign;
          const bool one_word = register_count(scale.position.type) == 1;
          if (is_maps || (one_word && high_first != map_.layout.high_word_first) || !fits(layout, sign)) continue;
          others += std::string(others.empty() ? "" : "; ") +
                    "words.order = " + (high_first ? "high_first" : "low_first") +
                    ", words.swap_bytes = " + (swap ? "true" : "false") + ", sign = " + std::to_string(sign);
        }
      }
    }
    if (!fits(map_.layout, scale.sign)) {
      return input_error(axis_error(axis, "reads " + degrees(angle_of(scale, raw_counts(axis, block, map_.layout))) +
                                              ", stands at " + degrees(known_deg[axis]) +
                                              (others.empty() ? ": expected other counts_per_degree or zero_deg"
                                                              : ": expected " + others))
                             .message);
    }
    if (!others.empty()) {
      return input_error(axis_error(axis, "at " + degrees(known_deg[axis]) +
                                              " other settings fit as well: expected an angle that tells them apart")
                             .message);
    }
  }
  return {};
}

}  // namespace turncal
