#include "turntable_drivers/twins/drive_twin.h"

#include <cmath>

namespace turncal {
namespace {

constexpr int illegal_function = 1, illegal_address = 2, illegal_value = 3, device_failure = 4;

}  // namespace

DriveTwin::DriveTwin(RegisterMap map, Turntable& table, const Clock& clock)
    : map_(std::move(map)), table_(table), clock_(clock) {}

Status DriveTwin::power_on() {
  if (Status status = table_.connect(); !status) return status;
  if (map_.home_by_encoder) {
    // An absolute encoder knows its zero from the start.
    if (Status status = table_.enable(); !status) return status;
    if (Status status = table_.home(); !status) return status;
  }
  return map_.list(DriveOperation::enable).empty() ? table_.enable() : Status();
}

void DriveTwin::tick() {
  for (const Axis axis : all_axes) {
    std::optional<double>& last_s = heartbeat_s_[index(axis)];
    if (!last_s || clock_.now_s() - *last_s <= map_.watchdog_s) continue;
    last_s.reset();
    const Result<AxisStatus> now = table_.status(axis);
    if (now && !now->enabled) continue;
    tripped_[index(axis)] = true;
    // A watchdog has nobody to tell if this fails.
    if (Status status = table_.stop_all(); !status) continue;
  }
}

DriveTwin::Answer DriveTwin::handle(const ModbusRequest& request) {
  tick();
  if (!request.well_formed) return {illegal_value, {}};
  if (request.function == 3 || request.function == 4) return read(request);
  if (request.function == 6 || request.function == 16) return write(request);
  return {illegal_function, {}};
}

std::optional<std::vector<std::uint16_t>> DriveTwin::blocks(Axis axis) {
  const Result<AxisStatus> now = table_.status(axis);
  if (!now) return {};
  std::vector<std::uint16_t> registers(static_cast<std::size_t>(map_.status_count + map_.status2_count));
  const auto put = [&](const RegisterField& field, double value) {
    const auto at = map_.place_of(field.address);
    const std::optional<Words> words = encode_words(value, field.type, map_.layout);
    if (!words) return;
    for (std::size_t i = 0; i < words->span().size() && at + i < registers.size(); ++i)
      registers[at + i] = words->value[i];
  };
  const MapAxis& scale = map_.of(axis);
  double position_deg = now->position_deg;
  if (scale.modulo_deg > 0.0) {
    const double above_zero_deg = position_deg - scale.zero_deg;
    position_deg = scale.zero_deg + above_zero_deg - scale.modulo_deg * std::floor(above_zero_deg / scale.modulo_deg);
  }
  put(map_.position, counts_of(scale, position_deg));
  if (map_.rate) put(*map_.rate, scale.sign * scale.measured_rate_scale * now->rate_degps);
  const bool fault = now->fault || tripped_[index(axis)];
  if (map_.alarm)
    put(*map_.alarm, !fault                    ? 0.0
                     : map_.alarm_text.empty() ? 1.0
                                               : static_cast<double>(map_.alarm_text.begin()->first));
  const std::array<bool, drive_bit_count> state = {now->enabled, now->in_position,    fault,
                                                   now->moving,  now->homed,          now->limit,
                                                   now->limit,   now->emergency_stop, now->remote};
  for (int i = 0; i < drive_bit_count; ++i) {
    const std::optional<StatusBit>& bit = map_.bits[static_cast<std::size_t>(i)];
    if (!bit) continue;
    const auto at = map_.place_of(bit->address);
    if (at < registers.size() && state[static_cast<std::size_t>(i)] == bit->active_high) registers[at] |= bit->mask;
  }
  return registers;
}

DriveTwin::Answer DriveTwin::read(const ModbusRequest& request) {
  for (const Axis axis : all_axes) {
    const MapAxis& place = map_.of(axis);
    if (place.unit != request.unit || request.function != map_.status_function) continue;
    for (const auto& [address, count] :
         {std::pair(map_.status_address, map_.status_count), std::pair(map_.status2_address, map_.status2_count)}) {
      const int first = address + place.address_offset;
      // Two registers more than the map tells: the driver reads blocks of different lengths.
      if (count == 0 || request.address < first || request.address + request.count > first + count + 2) continue;
      const auto registers = blocks(axis);
      if (!registers) return {device_failure, {}};
      Answer answer;
      for (int i = 0; i < request.count; ++i) {
        const int at = request.address - first + i;
        answer.values.push_back(at < count ? (*registers)[map_.place_of(address + at)] : std::uint16_t{0});
      }
      return answer;
    }
  }
  Answer answer;
  for (int i = 0; i < request.count; ++i) {
    const auto place = written_.find({request.unit, request.address + i});
    if (place == written_.end()) return {illegal_address, {}};
    answer.values.push_back(place->second);
  }
  return answer;
}

bool DriveTwin::matches(const WriteStep& step, const MapAxis& axis, const ModbusRequest& request,
                        std::map<WriteOperand::Kind, double>& operands) const {
  if (request.unit != axis.unit || request.address != step.address + axis.address_offset ||
      request.count != step.length()) {
    return false;
  }
  std::size_t at = 0;
  for (const WriteOperand& operand : step.operands) {
    const double value = decode_words(std::span(request.values).subspan(at), operand.type, map_.layout);
    at += static_cast<std::size_t>(register_count(operand.type));
    if (operand.kind != WriteOperand::Kind::constant) {
      operands[operand.kind] = value;
      continue;
    }
    const std::optional<Words> constant = encode_words(operand.constant, operand.type, map_.layout);
    if (!constant || decode_words(constant->span(), operand.type, map_.layout) != value) return false;
  }
  return true;
}

DriveTwin::Answer DriveTwin::write(const ModbusRequest& request) {
  bool known = false;
  Answer answer;
  for (const Axis axis : all_axes) {
    const MapAxis& place = map_.of(axis);
    if (place.unit != request.unit) continue;
    if (map_.heartbeat_address && request.address == *map_.heartbeat_address + place.address_offset &&
        request.count == 1) {
      known = true;
      heartbeat_s_[index(axis)] = clock_.now_s();
    }
    for (int i = 0; i < drive_operation_count; ++i) {
      const auto operation = static_cast<DriveOperation>(i);
      WriteList list;
      for (const WriteStep& step : map_.list(operation)) {
        if (!step.operands.empty()) list.push_back(step);
      }
      if (list.empty()) continue;
      Progress& progress = progress_[index(axis)][static_cast<std::size_t>(i)];
      std::map<WriteOperand::Kind, double> operands = progress.operands;
      if (!matches(list[progress.step], place, request, operands)) {
        operands.clear();
        const bool of_list = matches(list[0], place, request, operands);
        if (of_list) progress.step = 0;
        if (!of_list) {
          for (const WriteStep& step : list) known = known || request.address == step.address + place.address_offset;
          continue;
        }
      }
      known = true;
      progress.operands = operands;
      if (++progress.step < list.size()) continue;
      progress = {};
      if (Status done = carry_out(axis, operation, operands); !done) answer.exception = device_failure;
    }
  }
  if (!known) return {illegal_address, {}};
  for (std::size_t i = 0; i < request.values.size(); ++i) {
    written_[{request.unit, request.address + static_cast<int>(i)}] = request.values[i];
  }
  return answer;
}

Status DriveTwin::carry_out(Axis axis, DriveOperation operation, const std::map<WriteOperand::Kind, double>& operands) {
  switch (operation) {
    case DriveOperation::setup: return {};
    case DriveOperation::enable: return table_.enable();
    case DriveOperation::stop: return table_.stop_all();
    case DriveOperation::abort: return table_.abort_all();
    case DriveOperation::clear_fault: tripped_[index(axis)] = false; return table_.clear_fault();
    case DriveOperation::home: {
      // The first drive of a round starts them all.
      bool& done = homed_round_[index(axis)];
      if (done) homed_round_ = {};
      const bool begins = homed_round_ == std::array<bool, 3>{};
      done = true;
      return begins ? table_.home() : Status();
    }
    case DriveOperation::move: break;
  }
  if (tripped_[index(axis)]) return device_error("the watchdog has tripped");
  const auto number = [&](WriteOperand::Kind kind, double otherwise) {
    const auto place = operands.find(kind);
    return place == operands.end() ? otherwise : place->second;
  };
  using Kind = WriteOperand::Kind;
  const MapAxis& scale = map_.of(axis);
  const double rate_degps = number(Kind::rate, 0.0) / scale.rate_scale;
  double acceleration_degps2 = 20.0;  // of a drive that is not told
  if (operands.count(Kind::acceleration) != 0) {
    const double value = number(Kind::acceleration, 0.0);
    acceleration_degps2 =
        map_.acceleration_is_ramp_time ? scale.acceleration_scale / value : value / scale.acceleration_scale;
  }
  if (operands.count(Kind::position) != 0) {
    return table_.move_absolute(axis, angle_of(scale, number(Kind::position, 0.0)), rate_degps, acceleration_degps2);
  }
  const Result<AxisStatus> now = table_.status(axis);
  if (!now) return now.error();
  const double target_deg = now->position_deg + number(Kind::distance, 0.0) / scale.signed_counts_per_degree();
  return table_.move_absolute(axis, target_deg, rate_degps, acceleration_degps2);
}

}  // namespace turncal
