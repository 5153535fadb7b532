#include "turntable_drivers/twins/modbus_twin.h"

#include <algorithm>
#include <cmath>

namespace turncal {

namespace {

// The code in one register that says these flags, or comes closest: faults count most, then what the station waits for.
std::uint16_t code_of(const MapAxis& axis, const StatusBit& first, const std::array<bool, drive_bit_count>& state) {
  const auto alike = [&](const std::optional<StatusBit>& bit) {
    return bit && !bit->codes.empty() && bit->address == first.address && bit->mask == first.mask;
  };
  std::vector<std::uint16_t> candidates;
  for (std::uint16_t unlisted = 0; candidates.empty(); ++unlisted) {
    bool listed = false;
    for (const auto& bit : axis.bits) {
      listed = listed || (alike(bit) && std::find(bit->codes.begin(), bit->codes.end(), unlisted) != bit->codes.end());
    }
    if (!listed) candidates.push_back(unlisted);
  }
  for (const auto& bit : axis.bits) {
    if (alike(bit)) candidates.insert(candidates.end(), bit->codes.begin(), bit->codes.end());
  }
  int best_score = -1000000;
  std::uint16_t best = 0;
  for (const std::uint16_t code : candidates) {
    int score = 0;
    for (std::size_t i = 0; i < axis.bits.size(); ++i) {
      if (!alike(axis.bits[i])) continue;
      const auto which = static_cast<DriveBit>(i);
      const auto& codes = axis.bits[i]->codes;
      const bool says = std::find(codes.begin(), codes.end(), code) != codes.end();
      const bool grave = which == DriveBit::fault || which == DriveBit::emergency_stop;
      const int weight = grave                            ? 100
                         : which == DriveBit::moving      ? 20
                         : which == DriveBit::enabled     ? 15
                         : which == DriveBit::in_position ? 10
                                                          : 5;
      score += says == state[i] ? weight : -weight;
    }
    if (score > best_score) {
      best_score = score;
      best = code;
    }
  }
  return static_cast<std::uint16_t>(best << first.shift());
}

constexpr int addressed = 3;  // of Operands: the axis that is written to
constexpr int illegal_function = 1, illegal_address = 2, illegal_value = 3, device_failure = 4;

}  // namespace

ModbusTwin::ModbusTwin(RegisterMap map, Turntable& table, const Clock& clock)
    : map_(std::move(map)), table_(table), clock_(clock) {}

Status ModbusTwin::power_on() {
  TRY(table_.connect());
  return map_.list(DriveOperation::enable).empty() ? table_.enable() : Status();
}

void ModbusTwin::tick() {
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

ModbusTwin::Answer ModbusTwin::handle(const ModbusRequest& request) {
  tick();
  if (!request.well_formed) return {illegal_value, {}};
  if (request.function == 3 || request.function == 4) return read(request);
  if (request.function == 6 || request.function == 16) return write(request);
  return {illegal_function, {}};
}

std::optional<std::vector<std::uint16_t>> ModbusTwin::blocks(Axis axis) {
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
  double counts = counts_of(scale, now->position_deg);
  if (scale.modulo_deg > 0.0) {
    const double circle = scale.modulo_deg * scale.counts_per_degree;
    counts -= circle * std::floor(counts / circle);
  }
  put(scale.position, counts);
  if (scale.rate) put(*scale.rate, scale.sign * scale.measured_rate_scale * now->rate_degps);
  const bool fault = now->fault || tripped_[index(axis)];
  if (scale.alarm)
    put(*scale.alarm, !fault                    ? 0.0
                      : map_.alarm_text.empty() ? 1.0
                                                : static_cast<double>(map_.alarm_text.begin()->first));
  const std::array<bool, drive_bit_count> state = {now->enabled, now->in_position,    fault,
                                                   now->moving,  now->homed,          now->limit,
                                                   now->limit,   now->emergency_stop, now->remote};
  for (int i = 0; i < drive_bit_count; ++i) {
    const std::optional<StatusBit>& bit = scale.bits[static_cast<std::size_t>(i)];
    if (!bit) continue;
    const auto at = map_.place_of(bit->address);
    if (at >= registers.size()) continue;
    if (!bit->codes.empty()) {
      registers[at] = static_cast<std::uint16_t>((registers[at] & ~bit->mask) | code_of(scale, *bit, state));
    } else if (at < registers.size() && state[static_cast<std::size_t>(i)] == bit->active_high)
      registers[at] |= bit->mask;
  }
  return registers;
}

// Where several axes have the same place, each puts what is its own into it.
std::optional<std::vector<std::uint16_t>> ModbusTwin::shared_blocks(Axis axis, bool of_table) {
  auto registers = blocks(axis);
  const MapAxis& own = map_.of(axis);
  for (const Axis other : all_axes) {
    const MapAxis& place = map_.of(other);
    const bool same = place.unit == own.unit && (of_table || place.address_offset == own.address_offset);
    if (other == axis || !same || !registers) continue;
    const auto its = blocks(other);
    if (!its) return {};
    for (std::size_t i = 0; i < registers->size(); ++i) (*registers)[i] |= (*its)[i];
  }
  return registers;
}

ModbusTwin::Answer ModbusTwin::read(const ModbusRequest& request) {
  struct Block {
    int address, count;
    bool of_table;
  };
  for (const Axis axis : all_axes) {
    const MapAxis& place = map_.of(axis);
    if (place.unit != request.unit || request.function != map_.status_function) continue;
    for (const Block& block : {Block{map_.status_address, map_.status_count, map_.status_of_table},
                               Block{map_.status2_address, map_.status2_count, map_.status2_of_table}}) {
      const int first = block.address + (block.of_table ? 0 : place.address_offset);
      const int count = block.count;
      // Two registers more than the map tells: the driver reads blocks of different lengths.
      if (count == 0 || request.address < first || request.address + request.count > first + count + 2) continue;
      const auto registers = shared_blocks(axis, block.of_table);
      if (!registers) return {device_failure, {}};
      Answer answer;
      for (int i = 0; i < request.count; ++i) {
        const int at = request.address - first + i;
        answer.values.push_back(at < count ? (*registers)[map_.place_of(block.address + at)] : std::uint16_t{0});
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

bool ModbusTwin::matches(const WriteStep& step, DriveOperation operation, Axis axis, const ModbusRequest& request,
                         Operands& operands) const {
  if (request.unit != map_.unit_of(operation, axis) || request.address != map_.address_of(step, operation, axis) ||
      request.count != step.length()) {
    return false;
  }
  std::size_t at = 0;
  for (const WriteOperand& operand : step.operands) {
    const double value = decode_words(std::span(request.values).subspan(at), operand.type, map_.layout);
    at += static_cast<std::size_t>(register_count(operand.type));
    const bool is_code = operand.kind == WriteOperand::Kind::axis;
    if (operand.kind != WriteOperand::Kind::constant && !is_code) {
      operands[{operand.kind, operand.of_axis ? static_cast<int>(*operand.of_axis) : addressed}] = value;
      continue;
    }
    const double expected = is_code ? map_.of(operand.of_axis.value_or(axis)).code : operand.constant;
    const std::optional<Words> constant = encode_words(expected, operand.type, map_.layout);
    if (!constant || decode_words(constant->span(), operand.type, map_.layout) != value) return false;
  }
  return true;
}

// A value that the map does not list, or the same one as before, shows that the other side hangs: it does not count.
bool ModbusTwin::beats(const ModbusRequest& request, Axis axis) {
  if (!map_.heartbeat_address || request.count != 1) return false;
  const int offset = map_.heartbeat_of_table ? 0 : map_.of(axis).address_offset;
  if (request.address != *map_.heartbeat_address + offset) return false;
  const std::uint16_t value = request.values.front();
  const auto& known = map_.heartbeat_values;
  const bool good = known.empty() || (std::find(known.begin(), known.end(), value) != known.end() &&
                                      (known.size() == 1 || heartbeat_value_[index(axis)] != value));
  heartbeat_value_[index(axis)] = value;
  if (good) heartbeat_s_[index(axis)] = clock_.now_s();
  return true;
}

ModbusTwin::Answer ModbusTwin::write(const ModbusRequest& request) {
  bool known = false;
  Answer answer;
  for (const Axis axis : all_axes) {
    const MapAxis& place = map_.of(axis);
    if ((map_.heartbeat_of_table ? map_.of(Axis::heading).unit : place.unit) == request.unit) {
      known = beats(request, axis) || known;
    }
    for (int i = 0; i < drive_operation_count; ++i) {
      const auto operation = static_cast<DriveOperation>(i);
      WriteList list;
      for (const WriteStep& step : map_.list(operation)) {
        if (!step.operands.empty()) list.push_back(step);
      }
      if (list.empty() || (map_.once(operation) && axis != Axis::heading)) continue;
      Progress& progress = progress_[index(axis)][static_cast<std::size_t>(i)];
      Operands operands = progress.operands;
      if (!matches(list[progress.step], operation, axis, request, operands)) {
        operands.clear();
        const bool of_list = matches(list[0], operation, axis, request, operands);
        if (of_list) progress.step = 0;
        if (!of_list) {
          for (const WriteStep& step : list) {
            known = known || (request.unit == map_.unit_of(operation, axis) &&
                              request.address == map_.address_of(step, operation, axis));
          }
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

Status ModbusTwin::carry_out(Axis axis, DriveOperation operation, const Operands& operands) {
  if (operation != DriveOperation::move && operation != DriveOperation::setup) target_deg_ = {};
  switch (operation) {
    case DriveOperation::setup: return {};
    case DriveOperation::enable: return table_.enable();
    case DriveOperation::stop: return table_.stop_all();
    case DriveOperation::abort: return table_.abort_all();
    case DriveOperation::clear_fault:
      if (map_.once(operation)) tripped_ = {};
      tripped_[index(axis)] = false;
      return table_.clear_fault();
    case DriveOperation::home: {
      if (map_.once(operation)) return table_.home();
      // The first drive of a round starts them all.
      bool& done = homed_round_[index(axis)];
      if (done) homed_round_ = {};
      const bool begins = homed_round_ == std::array<bool, 3>{};
      done = true;
      return begins ? table_.home() : Status();
    }
    case DriveOperation::move: break;
  }
  if (!map_.once(operation)) return move(axis, addressed, operands);
  for (const Axis which : all_axes) {
    TRY(move(which, static_cast<int>(which), operands));
  }
  return {};
}

Status ModbusTwin::move(Axis axis, int operand_axis, const Operands& operands) {
  if (tripped_[index(axis)]) return device_error("the watchdog has tripped");
  using Kind = WriteOperand::Kind;
  const auto has = [&](Kind kind) { return operands.count({kind, operand_axis}) != 0; };
  const auto number = [&](Kind kind, double otherwise) {
    const auto place = operands.find({kind, operand_axis});
    return place == operands.end() ? otherwise : place->second;
  };
  if (!has(Kind::position) && !has(Kind::distance)) return {};
  const MapAxis& scale = map_.of(axis);
  const double rate_degps = number(Kind::rate, 0.0) / scale.rate_scale;
  double acceleration_degps2 = 20.0;  // of a drive that is not told
  if (has(Kind::acceleration)) {
    const double value = number(Kind::acceleration, 0.0);
    acceleration_degps2 =
        map_.acceleration_is_ramp_time ? scale.acceleration_scale / value : value / scale.acceleration_scale;
  }
  const AxisStatus now = TRY(table_.status(axis));
  double target_deg = angle_of(scale, number(Kind::position, 0.0));
  if (has(Kind::distance)) {
    const double distance = number(Kind::distance, 0.0);
    if (operand_axis != addressed && distance == 0.0) return {};
    target_deg = now.position_deg + distance / scale.signed_counts_per_degree();
  } else if (operand_axis != addressed) {
    // Told of all three, those stay alone that are there, or on their way.
    const double from_deg = target_deg_[index(axis)].value_or(now.position_deg);
    const double step_deg = 2.0 / std::abs(scale.counts_per_degree);
    if (std::abs(from_deg - target_deg) < step_deg || std::abs(now.position_deg - target_deg) < step_deg) return {};
    target_deg_[index(axis)] = target_deg;
  }
  return table_.move_absolute(axis, target_deg, rate_degps, acceleration_degps2);
}

std::optional<AnswerPlan> ModbusServer::next_answer(std::vector<std::uint8_t>& bytes) {
  const bool header = tcp() && !twin_.map().link.rtu_frames;
  const std::optional<ModbusRequest> request = next_request(bytes, header);
  if (!request) return {};
  const auto& axes = twin_.map().axis;
  const bool ours =
      std::any_of(axes.begin(), axes.end(), [&](const MapAxis& axis) { return axis.unit == request->unit; });
  if (!ours) return AnswerPlan();  // another drive on the bus: silence
  ModbusTwin::Answer answer;
  {
    const std::lock_guard lock(mutex);
    answer = twin_.handle(*request);
  }
  const bool is_read = request->function == 3 || request->function == 4;
  AnswerPlan plan;
  plan.pieces.push_back({answer.exception != 0 ? exception_reply(*request, answer.exception, header)
                         : is_read             ? read_reply(*request, answer.values, header)
                                               : write_reply(*request, header),
                         0.0});
  if (disturb) disturb(*request, plan);
  return plan;
}

}  // namespace turncal
