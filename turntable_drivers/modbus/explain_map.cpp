#include "turntable_drivers/modbus/explain_map.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include "imu_io/base/format_number.h"
#include "turntable_drivers/modbus/move_words.h"

namespace turncal {
namespace {

std::string hexadecimal(unsigned value) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "0x%04X", value);
  return text.data();
}

std::string register_text(int address) {
  return std::to_string(address) + " (" + hexadecimal(static_cast<unsigned>(address)) + ")";
}

std::string request(int unit, int function, int address, std::size_t count) {
  return "unit " + std::to_string(unit) + ", function " + std::to_string(function) + ", register " +
         register_text(address) + (count > 1 ? ", " + std::to_string(count) + " registers" : "");
}

std::string per(double scale, const char* unit) { return format_number(scale) + " per " + unit; }

// What a number of a write is made of; empty: it stands in the file.
std::string meaning_of(const RegisterMap& map, const WriteOperand& operand, Axis axis) {
  const MapAxis& scale = map.of(operand.of_axis.value_or(axis));
  const std::string whose = operand.of_axis ? std::string(".") + to_string(*operand.of_axis) : "";
  switch (operand.kind) {
    case WriteOperand::Kind::constant: return "";
    case WriteOperand::Kind::axis: return ", the axis's code";
    case WriteOperand::Kind::position:
      return ", position" + whose + ": " + per(scale.signed_counts_per_degree(), "deg") + ", 0 at " +
             format_number(scale.zero_deg) + " deg";
    case WriteOperand::Kind::distance:
      return ", distance" + whose + ": " + per(scale.signed_counts_per_degree(), "deg");
    case WriteOperand::Kind::rate: return ", rate" + whose + ": " + per(scale.rate_scale, "deg/s");
    case WriteOperand::Kind::acceleration:
      return ", acceleration" + whose + ": " +
             (map.acceleration_is_ramp_time ? format_number(scale.acceleration_scale) + " / (deg/s^2), a ramp time"
                                            : per(scale.acceleration_scale, "deg/s^2"));
  }
  return "";
}

void explain_writes(const RegisterMap& map, DriveOperation operation, const std::string& name,
                    std::vector<TableRow>& rows) {
  const std::string source = source_of(map, "write." + std::string(to_string(operation)));
  for (const Axis axis : all_axes) {
    if (map.once(operation) && operation != DriveOperation::move && axis != Axis::heading) break;
    const std::string whose =
        map.once(operation) && operation != DriveOperation::move ? "table" : std::string(to_string(axis));
    Moves moves{};
    if (map.once(operation)) moves.fill({0.0, 0.0, shown_move.rate_degps, shown_move.acceleration_degps2});
    moves[index(axis)] = shown_move;
    for (const WriteStep& step : map.list(operation)) {
      if (step.operands.empty()) {
        rows.push_back({name, whose, "", "a pause of " + format_number(step.wait_s) + " s", "", source});
        continue;
      }
      const int first = map.address_of(step, operation, axis);
      const auto count = static_cast<std::size_t>(step.length());
      const int function = count > 1 ? 16 : map.write_function;
      const std::string answer = function == 6 ? "the same" : request(map.unit_of(operation, axis), 16, first, count);
      const auto words = words_of(map, step, axis, moves);
      int at = 0;
      for (const WriteOperand& operand : step.operands) {
        std::string says = std::string(to_string(operand.type)) + " ";
        if (words) {
          const auto part = std::span(*words).subspan(static_cast<std::size_t>(at),
                                                      static_cast<std::size_t>(register_count(operand.type)));
          says += format_number(decode_words(part, operand.type, map.layout)) + " (";
          for (const std::uint16_t& word : part) says += hexadecimal(word) + (&word == &part.back() ? ")" : " ");
        }
        says += words ? meaning_of(map, operand, axis) : ": " + words.error().message;
        rows.push_back({name, whose,
                        at == 0 ? request(map.unit_of(operation, axis), function, first, count)
                                : "  its register " + register_text(first + at),
                        says, at == 0 ? answer : "", source});
        at += register_count(operand.type);
      }
    }
  }
}

std::string bit_text(const StatusBit& bit, const std::string& flag) {
  std::string text = flag + ": ";
  if (bit.codes.empty())
    return text + "mask " + hexadecimal(bit.mask) + (bit.active_high ? ", set" : ", clear") +
           (bit.pulse ? ", a pulse" : "");
  text += "mask " + hexadecimal(bit.mask) + " shifted down is";
  for (const std::uint16_t code : bit.codes) text += (code == bit.codes.front() ? " " : " or ") + std::to_string(code);
  return text;
}

void explain_status(const RegisterMap& map, std::vector<TableRow>& rows) {
  for (const Axis axis : all_axes) {
    const MapAxis& scale = map.of(axis);
    const std::string whose = to_string(axis), own = "axis." + whose + ".";
    const auto source = [&](const std::string& key) {
      const std::string of_axis = source_of(map, own + key);
      return of_axis.empty() ? source_of(map, key) : of_axis;
    };
    const auto block = [&](const std::string& name, int address, int count, bool of_table) {
      const auto asked = static_cast<std::size_t>(count) + index(axis);
      const int first = address + (of_table ? 0 : scale.address_offset);
      rows.push_back({"status", whose, request(scale.unit, map.status_function, first, asked), "",
                      std::to_string(2 * asked) + " bytes", source(name + ".address")});
    };
    const auto field = [&](int address, const std::string& says, const std::string& key) {
      rows.push_back(
          {"status", whose, "  its register " + register_text(map.read_at(address, axis)), says, "", source(key)});
    };
    block("status", map.status_address, map.status_count, map.status_of_table);
    if (map.status2_count > 0) block("status2", map.status2_address, map.status2_count, map.status2_of_table);
    field(scale.position.address,
          std::string(to_string(scale.position.type)) + " position: " + per(scale.signed_counts_per_degree(), "deg") +
              ", 0 at " + format_number(scale.zero_deg) + " deg" +
              (scale.modulo_deg > 0.0 ? ", a circle of " + format_number(scale.modulo_deg) + " deg" : ""),
          "position.address");
    if (scale.rate)
      field(scale.rate->address,
            std::string(to_string(scale.rate->type)) + " rate: " + per(scale.sign * scale.measured_rate_scale, "deg/s"),
            "rate.address");
    if (scale.alarm) field(scale.alarm->address, std::string(to_string(scale.alarm->type)) + " alarm", "alarm.address");
    for (int i = 0; i < drive_bit_count; ++i) {
      const std::string flag = to_string(static_cast<DriveBit>(i));
      if (const auto& bit = scale.bits[static_cast<std::size_t>(i)])
        field(bit->address, bit_text(*bit, flag), "bit." + flag + (bit->codes.empty() ? ".mask" : ".codes"));
    }
  }
}

void explain_heartbeat(const RegisterMap& map, std::vector<TableRow>& rows) {
  if (!map.heartbeat_address) return;
  for (const Axis axis : all_axes) {
    if (map.heartbeat_of_table && axis != Axis::heading) break;
    const int address = *map.heartbeat_address + (map.heartbeat_of_table ? 0 : map.of(axis).address_offset);
    std::string says = map.heartbeat_values.empty() ? "u16, another number each time" : "u16, in turn";
    for (const std::uint16_t value : map.heartbeat_values)
      says += " " + std::to_string(value) + " (" + hexadecimal(value) + ")";
    says += ", every " + format_number(map.heartbeat_period_s) + " s";
    rows.push_back({"heartbeat", map.heartbeat_of_table ? "table" : to_string(axis),
                    request(map.of(axis).unit, map.write_function, address, 1), says, "the same",
                    source_of(map, "heartbeat.address")});
  }
}

}  // namespace

std::vector<TableRow> explain(const RegisterMap& map) {
  std::vector<TableRow> rows;
  constexpr std::pair<DriveOperation, const char*> before_status[] = {
      {DriveOperation::setup, "connect"}, {DriveOperation::enable, "enable"}, {DriveOperation::home, "home"},
      {DriveOperation::move, "move"},     {DriveOperation::stop, "stop"},     {DriveOperation::abort, "abort"}};
  for (const auto& [operation, name] : before_status) explain_writes(map, operation, name, rows);
  explain_status(map, rows);
  explain_writes(map, DriveOperation::clear_fault, "fault reset", rows);
  explain_heartbeat(map, rows);
  return rows;
}

}  // namespace turncal
