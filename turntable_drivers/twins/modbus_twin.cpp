#include "turntable_drivers/twins/modbus_twin.h"

#include <algorithm>
#include <cmath>

namespace turncal {

namespace {

// Returns the status code closest to these flags.
std::uint16_t code_of(const MapAxis& axis, const StatusBit& first, const DriveFlags& state) {
  const auto alike = [&](const std::optional<StatusBit>& bit) {
    return bit && !bit->codes.empty() && bit->address == first.address && bit->mask == first.mask;
  };
  const auto says = [](const StatusBit& bit, std::uint16_t code) {
    return std::ranges::find(bit.codes, code) != bit.codes.end();
  };
  std::vector<std::uint16_t> candidates{0};  // the first code that no list has
  while (std::ranges::any_of(axis.bits, [&](const auto& bit) { return alike(bit) && says(*bit, candidates[0]); }))
    ++candidates[0];
  for (const auto& bit : axis.bits)
    if (alike(bit)) candidates.insert(candidates.end(), bit->codes.begin(), bit->codes.end());
  const auto score_of = [&](std::uint16_t code) {
    return likeness(state, [&](std::size_t i) {
      return alike(axis.bits[i]) ? std::optional(says(*axis.bits[i], code)) : std::nullopt;
    });
  };
  const auto best = std::ranges::max_element(candidates, [&](auto a, auto b) { return score_of(a) < score_of(b); });
  return std::uint16_t(*best << first.shift());
}

// Returns the alarm of a drive whose master was lost, or an unlisted one if the map has no text for it.
double watchdog_alarm(const std::map<long, std::string>& texts) {
  for (const auto& [code, text] : texts)
    if (text.find("communication") != std::string::npos) return double(code);
  return texts.empty() ? 1.0 : double(texts.rbegin()->first + 1);
}

constexpr int addressed = 3;  // Operands: the axis that is written to
constexpr int illegal_function = 1, illegal_address = 2, illegal_value = 3, device_failure = 4;

}  // namespace

Status ModbusTwin::power_on() { return table_.power_on(map_.list(TableOperation::enable).empty()); }

void ModbusTwin::tick() {
  for (const Axis axis : all_axes) {
    std::optional<double>& last_s = heartbeat_s_[index(axis)];
    if (!last_s || clock_.now_s() - *last_s <= map_.watchdog_s) continue;
    last_s.reset();
    const Result<AxisStatus> now = table_.status(axis);
    if (now && !now->enabled) continue;
    tripped_[index(axis)] = true;
    // If this fails, a watchdog cannot report it.
    static_cast<void>(table_.carry_out(TableOperation::stop, axis, true).ok());
  }
}

ModbusTwin::Answer ModbusTwin::handle(const ModbusRequest& request) {
  tick();
  if (!request.well_formed) return {illegal_value, {}};
  if (request.function == 3 || request.function == 4) return read(request);
  if (request.function == 6 || request.function == 16) return write(request);
  return {illegal_function, {}};
}

// Returns a block of an axis. Axes with the same block each add their own values.
std::optional<std::vector<std::uint16_t>> ModbusTwin::registers_of(const StatusBlock& block, Axis axis) {
  std::vector<std::uint16_t> registers(std::size_t(block.count));
  for (const Axis which : all_axes) {
    const MapAxis& scale = map_.of(which);
    if (scale.unit != map_.of(axis).unit || block.read_at(scale) != block.read_at(map_.of(axis))) continue;
    const Result<AxisStatus> now = table_.status(which);
    if (!now) return {};
    const auto put = [&](const RegisterField& field, double value) {
      const std::optional<Words> words = encode_words(value, field.type, map_.layout);
      if (!words || !block.holds(field.address)) return;
      std::copy(words->span().begin(), words->span().end(), registers.begin() + field.address - block.address);
    };
    double counts = scale.units_of(now->position_deg);
    if (scale.modulo_deg > 0.0) {
      const double circle = scale.modulo_deg * scale.units_per_degree;
      counts -= circle * std::floor(counts / circle);
    }
    put(scale.position, counts);
    if (scale.rate) put(*scale.rate, scale.sign * scale.measured_rate_scale * now->rate_degps);
    DriveFlags state = flags_of(*now);
    bool& fault = state[std::size_t(DriveBit::fault)];
    fault = fault || tripped_[index(which)];
    if (scale.alarm && fault)
      put(*scale.alarm, tripped_[index(which)]    ? watchdog_alarm(map_.alarm_text)
                        : map_.alarm_text.empty() ? 1.0
                                                  : double(map_.alarm_text.begin()->first));
    for (std::size_t i = 0; i < scale.bits.size(); ++i) {
      const std::optional<StatusBit>& bit = scale.bits[i];
      if (!bit || !block.holds(bit->address)) continue;
      std::uint16_t& word = registers[std::size_t(bit->address - block.address)];
      if (!bit->codes.empty())
        word = std::uint16_t((word & ~bit->mask) | code_of(scale, *bit, state));
      else if (state[i] == bit->active_high)
        word |= bit->mask;
    }
  }
  return registers;
}

ModbusTwin::Answer ModbusTwin::read(const ModbusRequest& request) {
  for (const Axis axis : all_axes) {
    const MapAxis& place = map_.of(axis);
    if (place.unit != request.unit || request.function != map_.status_function) continue;
    for (const StatusBlock& block : map_.blocks()) {
      const int first = block.read_at(place);
      // Two registers more than in the map: the driver reads blocks of different lengths.
      if (request.address < first || request.address + request.count > first + block.count + 2) continue;
      auto registers = registers_of(block, axis);
      if (!registers) return {device_failure, {}};
      registers->resize(std::size_t(block.count + 2));
      const auto begin = registers->begin() + request.address - first;
      return {0, {begin, begin + request.count}};
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

bool ModbusTwin::matches(const WriteStep& step, TableOperation operation, Axis axis, const ModbusRequest& request,
                         Operands& operands) const {
  if (request.unit != map_.unit_of(operation, axis) || request.address != map_.address_of(step, operation, axis) ||
      request.count != step.length())
    return false;
  std::size_t at = 0;
  for (const WriteOperand& operand : step.operands) {
    const double value = decode_words(std::span(request.values).subspan(at), operand.type, map_.layout);
    at += std::size_t(register_count(operand.type));
    if (operand.kind == WriteOperand::Kind::quantity) {
      operands[{operand.quantity, operand.of_axis ? int(*operand.of_axis) : addressed}] = value;
      continue;
    }
    const double expected =
        operand.kind == WriteOperand::Kind::axis ? map_.of(operand.of_axis.value_or(axis)).code : operand.constant;
    const std::optional<Words> constant = encode_words(expected, operand.type, map_.layout);
    if (!constant || decode_words(constant->span(), operand.type, map_.layout) != value) return false;
  }
  return true;
}

// A value that the map does not list, or the same one as before, shows a hung master and does not count.
bool ModbusTwin::beats(const ModbusRequest& request, Axis axis) {
  if (!map_.heartbeat_address || request.count != 1 || request.address != map_.heartbeat_at(axis)) return false;
  const std::uint16_t value = request.values.front();
  const auto& known = map_.heartbeat_values;
  const bool good = known.empty() || (std::ranges::find(known, value) != known.end() &&
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
    if ((map_.heartbeat_of_table ? map_.of(Axis::heading).unit : place.unit) == request.unit)
      known = beats(request, axis) || known;
    for (int i = 0; i < table_operation_count; ++i) {
      const auto operation = static_cast<TableOperation>(i);
      WriteList list = map_.list(operation);
      std::erase_if(list, [](const WriteStep& step) { return step.operands.empty(); });
      if (list.empty() || (map_.once(operation) && axis != Axis::heading)) continue;
      Progress& progress = progress_[index(axis)][std::size_t(i)];
      Operands operands = progress.operands;
      if (!matches(list[progress.step], operation, axis, request, operands)) {
        operands.clear();
        if (!matches(list[0], operation, axis, request, operands)) {
          for (const WriteStep& step : list)
            known = known || (request.unit == map_.unit_of(operation, axis) &&
                              request.address == map_.address_of(step, operation, axis));
          continue;
        }
        progress.step = 0;
      }
      known = true;
      progress.operands = operands;
      if (++progress.step < list.size()) continue;
      progress = {};
      if (Status done = carry_out(axis, operation, operands); !done) answer.exception = device_failure;
    }
  }
  if (!known) return {illegal_address, {}};
  for (std::size_t i = 0; i < request.values.size(); ++i)
    written_[{request.unit, request.address + int(i)}] = request.values[i];
  return answer;
}

Status ModbusTwin::carry_out(Axis axis, TableOperation operation, const Operands& operands) {
  const bool of_table = map_.once(operation);
  if (operation == TableOperation::clear_fault) {
    if (of_table) tripped_ = {};
    tripped_[index(axis)] = false;
  }
  if (operation == TableOperation::enable)  // for all, since a Turntable enables all axes together
    for (std::optional<double>& last_s : heartbeat_s_)
      if (last_s) last_s = clock_.now_s();
  if (operation != TableOperation::move) return table_.carry_out(operation, axis, of_table);
  for (const Axis which : all_axes) {
    if (!of_table && which != axis) continue;
    if (tripped_[index(which)]) return device_error("the watchdog has tripped");
    const MapAxis& scale = map_.of(which);
    Told told;
    for (const auto& [operand, value] : operands)
      if (operand.second == (of_table ? int(which) : addressed)) told.take(operand.first, value, scale);
    TRY(table_.move(which, scale, told, of_table, 2.0 / scale.units_per_degree));
  }
  return {};
}

std::optional<AnswerPlan> ModbusTwin::next_answer(std::vector<std::uint8_t>& bytes) {
  const bool header = tcp() && !map_.link.rtu_frames;
  const std::optional<ModbusRequest> request = next_request(bytes, header);
  if (!request) return {};
  const bool ours = std::ranges::any_of(map_.axis, [&](const MapAxis& axis) { return axis.unit == request->unit; });
  if (!ours) return AnswerPlan();  // another drive on the bus: no answer
  const Answer answer = [&] {
    const std::lock_guard lock(mutex);
    return handle(*request);
  }();
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
