// What a register map makes of each operation, request by request.
#include <fmt/format.h>

#include "imu_io/base/format_number.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {
namespace {

std::string hexadecimal(unsigned value) { return fmt::format("0x{:04X}", value); }

std::string register_text(int address) { return fmt::format("{} (0x{:04X})", address, address); }

std::string request(int unit, int function, int address, std::size_t count) {
  return fmt::format("unit {}, function {}, register {}{}", unit, function, register_text(address),
                     count > 1 ? fmt::format(", {} registers", count) : "");
}

std::string per(double scale, const char* unit) { return format_number(scale) + " per " + unit; }

std::string position_text(const MapAxis& scale) {
  return fmt::format("{}, 0 at {} deg", per(scale.signed_units(), "deg"), format_number(scale.zero_deg));
}

// What a number of a write is made of; empty: it stands in the file.
std::string meaning_of(const RegisterMap& map, const WriteOperand& operand, Axis axis) {
  const MapAxis& scale = map.of(operand.of_axis.value_or(axis));
  const std::string whose = operand.of_axis ? std::string(".") + to_string(*operand.of_axis) : "";
  switch (operand.kind) {
    case WriteOperand::Kind::constant: return "";
    case WriteOperand::Kind::axis: return ", the axis's code";
    case WriteOperand::Kind::position: return fmt::format(", position{}: {}", whose, position_text(scale));
    case WriteOperand::Kind::distance: return fmt::format(", distance{}: {}", whose, per(scale.signed_units(), "deg"));
    case WriteOperand::Kind::rate: return fmt::format(", rate{}: {}", whose, per(scale.rate_scale, "deg/s"));
    case WriteOperand::Kind::acceleration:
      return fmt::format(", acceleration{}: {}", whose,
                         map.acceleration_is_ramp_time
                             ? format_number(scale.acceleration_scale) + " / (deg/s^2), a ramp time"
                             : per(scale.acceleration_scale, "deg/s^2"));
  }
  return "";
}

void explain_writes(const RegisterMap& map, TableOperation operation, const std::string& name,
                    std::vector<TableRow>& rows) {
  const std::string source = source_of(map, "write." + std::string(to_string(operation)));
  for (const Axis axis : all_axes) {
    if (map.once(operation) && operation != TableOperation::move && axis != Axis::heading) break;
    const std::string whose =
        map.once(operation) && operation != TableOperation::move ? "table" : std::string(to_string(axis));
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
      int at = 0;
      for (const WriteOperand& operand : step.operands) {
        std::string says = std::string(to_string(operand.type)) + " ";
        const auto words = words_of(map, operand, step.address + at, axis, moves);
        if (words)
          says += fmt::format("{} (0x{:04X})", format_number(decode_words(words->span(), operand.type, map.layout)),
                              fmt::join(words->span(), " 0x"));
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

std::string bit_text(const StatusBit& bit, DriveBit which, bool in_a_pulse) {
  std::string text = fmt::format("{}: mask {}", to_string(which), hexadecimal(bit.mask));
  if (bit.codes.empty()) {
    const bool pulse = in_a_pulse && which == DriveBit::in_position;
    return text + (bit.active_high ? ", set" : ", clear") + (pulse ? ", a pulse" : "");
  }
  return fmt::format("{} shifted down is {}", text, fmt::join(bit.codes, " or "));
}

void explain_status(const RegisterMap& map, std::vector<TableRow>& rows) {
  for (const Axis axis : all_axes) {
    const MapAxis& scale = map.of(axis);
    const std::string whose = to_string(axis), own = "axis." + whose + ".";
    const auto source = [&](const std::string& key) {
      const std::string of_axis = source_of(map, own + key);
      return of_axis.empty() ? source_of(map, key) : of_axis;
    };
    for (const StatusBlock& block : map.blocks()) {
      const std::size_t asked = static_cast<std::size_t>(block.count) + index(axis);
      rows.push_back({"status", whose, request(scale.unit, map.status_function, block.read_at(scale), asked), "",
                      std::to_string(2 * asked) + " bytes",
                      source(&block == &map.status[0] ? "status.address" : "status2.address")});
    }
    const auto field = [&](int address, const std::string& says, const std::string& key) {
      rows.push_back(
          {"status", whose, "  its register " + register_text(map.read_at(address, axis)), says, "", source(key)});
    };
    field(
        scale.position.address,
        fmt::format("{} position: {}{}", to_string(scale.position.type), position_text(scale),
                    scale.modulo_deg > 0.0 ? fmt::format(", a circle of {} deg", format_number(scale.modulo_deg)) : ""),
        "position.address");
    if (scale.rate)
      field(scale.rate->address,
            std::string(to_string(scale.rate->type)) + " rate: " + per(scale.sign * scale.measured_rate_scale, "deg/s"),
            "rate.address");
    if (scale.alarm) field(scale.alarm->address, std::string(to_string(scale.alarm->type)) + " alarm", "alarm.address");
    for (const DriveBit which : all_drive_bits) {
      if (const auto& bit = scale.bit(which))
        field(bit->address, bit_text(*bit, which, scale.arrives_in_a_pulse),
              fmt::format("bit.{}{}", to_string(which), bit->codes.empty() ? ".mask" : ".codes"));
    }
  }
}

void explain_heartbeat(const RegisterMap& map, std::vector<TableRow>& rows) {
  if (!map.heartbeat_address) return;
  for (const Axis axis : all_axes) {
    if (map.heartbeat_of_table && axis != Axis::heading) break;
    std::string says = map.heartbeat_values.empty() ? "u16, another number each time" : "u16, in turn";
    for (const std::uint16_t value : map.heartbeat_values)
      says += " " + std::to_string(value) + " (" + hexadecimal(value) + ")";
    says += ", every " + format_number(map.heartbeat_period_s) + " s";
    rows.push_back({"heartbeat", map.heartbeat_of_table ? "table" : to_string(axis),
                    request(map.of(axis).unit, map.write_function, map.heartbeat_at(axis), 1), says, "the same",
                    source_of(map, "heartbeat.address")});
  }
}

}  // namespace

std::vector<TableRow> explain(const RegisterMap& map) {
  std::vector<TableRow> rows;
  for (const auto& [operation, name] : shown_operations) {
    if (operation == TableOperation::status) explain_status(map, rows);
    explain_writes(map, operation, name, rows);
  }
  explain_heartbeat(map, rows);
  return rows;
}

}  // namespace turncal
