#include "turntable_drivers/modbus/register_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "imu_io/base/file_kind.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr NumberRange pause_range{0.001, 1.0};  // in s; a stop interrupts it
constexpr double longest_stop_pause_s = 0.05;   // sum of all waits of a stop

// Parses "TYPE VALUE".
std::optional<WriteOperand> operand_of(std::string_view text) {
  const auto words = split_words(text);
  const std::optional<WordType> type = words.size() == 2 ? enum_from<WordType>(words[0]) : std::nullopt;
  if (!type) return {};
  WriteOperand operand;
  operand.type = *type;
  std::string_view value = words[1];
  if (const auto number = parse_whole<long>(value)) {
    operand.constant = double(*number);
  } else if (const auto real = parse_number(value)) {
    operand.constant = *real;
  } else if (value == "axis") {
    operand.kind = WriteOperand::Kind::axis;
  } else {
    operand.kind = WriteOperand::Kind::quantity;
    operand.of_axis = take_axis(value);
    const std::optional<MoveQuantity> quantity = enum_from<MoveQuantity>(value);
    if (!quantity) return {};
    operand.quantity = *quantity;
  }
  return operand;
}

// `otherwise`: default of an optional key.
long hex_or_decimal(KeyValueFile& file, const std::string& key, long min, long max,
                    std::optional<long> otherwise = {}) {
  if (otherwise && !file.has(key)) return *otherwise;
  const std::string text = file.text(key);
  const std::optional<long> value = parse_whole<long>(text);
  if (value && *value >= min && *value <= max) return *value;
  if (!text.empty()) file.reject(key, fmt::format("a whole number between {} and {}, decimal or with 0x", min, max));
  return min;
}

std::vector<std::uint16_t> words_in(KeyValueFile& file, const std::string& key, long most,
                                    const std::string& expected) {
  std::vector<std::uint16_t> words;
  for (const std::string& text : file.has(key) ? file.list(key) : std::vector<std::string>()) {
    const auto value = parse_whole<long>(text);
    if (!value || *value < 0 || *value > most) file.reject(key, expected);
    words.push_back(std::uint16_t(value.value_or(0)));
  }
  return words;
}

std::vector<WriteOperand> operands_of(const WriteList& list) {
  std::vector<WriteOperand> operands;
  for (const WriteStep& step : list) operands.insert(operands.end(), step.operands.begin(), step.operands.end());
  return operands;
}

WriteList write_list(KeyValueFile& file, const std::string& key, const WordLayout& layout) {
  WriteList list;
  if (!file.has(key)) return list;
  for (const std::string& text : file.list(key)) {
    const auto step = parse_write_step(trimmed(text));
    if (!step) {
      file.reject(
          key,
          "steps 'ADDRESS TYPE VALUE' or 'ADDRESS TYPE VALUE + TYPE VALUE ...' or 'wait SECONDS' (at most " +
              format_number(pause_range.max) +
              "), VALUE a number, axis, position, distance, rate or acceleration, the last four also with .heading "
              ".pitch .roll, 'table' before an ADDRESS without offset; wrong is " +
              quoted(text));
      return {};
    }
    for (const WriteOperand& operand : step->operands) {
      if (operand.kind == WriteOperand::Kind::constant && !encode_words(operand.constant, operand.type, layout)) {
        file.reject(key, "numbers that fit their type; wrong is " + quoted(text));
        return {};
      }
    }
    list.push_back(*step);
  }
  return list;
}

void read_axes(KeyValueFile& file, RegisterMap& map) {
  for (const Axis which : all_axes) {
    MapAxis& axis = map.axis[index(which)];
    const std::string prefix = fmt::format("axis.{}.", to_string(which));
    axis.unit = int(file.integer(prefix + "unit", 1, 247));
    axis.address_offset = int(hex_or_decimal(file, prefix + "address_offset", 0, 65535, 0));
    read_axis_scale(file, which, axis, "counts_per_degree", false);
    axis.code = int(file.integer_or(prefix + "code", int(which) + 1, 0, 65535));
  }
}

void read_status_block(KeyValueFile& file, RegisterMap& map) {
  KeyTable keys(file);
  keys.whole("status.function", map.status_function, 3, 4);
  const auto read_block = [&](StatusBlock& block, const std::string& name) {
    block.address = int(hex_or_decimal(file, name + ".address", 0, 65535));
    block.count = int(file.integer(name + ".count", 1, longest_block));
  };
  StatusBlock& first = map.status[0];
  StatusBlock& second = map.status[1];
  read_block(first, "status");
  if (file.has("status2.address")) {
    read_block(second, "status2");
    if (std::abs(second.count - first.count) < 3)
      file.reject("status2.count", "at least 3 more or less than status.count: every request has its own length");
  }
  const auto inside = [&](const std::string& key, int address, int length) {
    const auto within = [&](const StatusBlock& block) {
      return block.holds(address) && address + length <= block.address + block.count;
    };
    if (!within(first) && !within(second))
      file.reject(key, "an address inside the status block (status.address, status.count, status2.*)");
  };
  keys.chosen("status.scope", first.of_table, {"axis", "table"});
  if (second.count > 0) keys.chosen("status2.scope", second.of_table, {"axis", "table"});
  for (const std::string& key : file.keys_with_prefix("alarm.text.")) {
    const auto code = parse_whole<long>(std::string_view(key).substr(11));
    if (!code) file.reject(key, "a key alarm.text.NUMBER");
    map.alarm_text[code.value_or(0)] = file.text(key);
  }
  for (const Axis which : all_axes) {
    MapAxis& axis = map.axis[index(which)];
    const std::string own = fmt::format("axis.{}.", to_string(which));
    // An axis's own key takes precedence over the common one.
    const auto key = [&](const std::string& name) { return file.has(own + name) ? own + name : name; };
    const auto has = [&](const std::string& name) { return file.has(key(name)); };
    const auto block_field = [&](const std::string& prefix) {
      RegisterField result;
      result.address = int(hex_or_decimal(file, key(prefix + ".address"), 0, 65535));
      result.type =
          enum_from<WordType>(file.one_of_or(prefix + ".type", "s32", words_of<WordType>())).value_or(WordType::s32);
      inside(key(prefix + ".address"), result.address, register_count(result.type));
      return result;
    };
    axis.position = block_field("position");
    if (has("rate.address")) axis.rate = block_field("rate");
    if (has("alarm.address")) axis.alarm = block_field("alarm");
    for (const DriveBit bit_of : all_drive_bits) {
      const std::string prefix = "bit." + std::string(to_string(bit_of));
      const bool required = bit_of == DriveBit::enabled || bit_of == DriveBit::in_position || bit_of == DriveBit::fault;
      if (!required && !has(prefix + ".address")) continue;
      StatusBit bit;
      bit.address = int(hex_or_decimal(file, key(prefix + ".address"), 0, 65535));
      inside(key(prefix + ".address"), bit.address, 1);
      if (has(prefix + ".codes")) {
        bit.mask = std::uint16_t(hex_or_decimal(file, key(prefix + ".mask"), 1, 65535, 0xFFFF));
        const int most = bit.mask >> bit.shift();
        bit.codes = words_in(file, key(prefix + ".codes"), most,
                             fmt::format("numbers from 0 to {}, what the mask leaves", most));
        if (bit.codes.empty()) file.reject(key(prefix + ".codes"), "at least one number");
      } else {
        bit.mask = std::uint16_t(hex_or_decimal(file, key(prefix + ".mask"), 1, 65535));
        bit.active_high = file.one_of_or(key(prefix + ".active"), "high", {"high", "low"}) == "high";
      }
      bool pulse = false;
      keys.chosen(key(prefix + ".kind"), pulse, {"level", "pulse"});
      if (bit_of == DriveBit::in_position) axis.arrives_in_a_pulse = pulse;
      if (pulse && bit_of != DriveBit::in_position)
        file.reject(key(prefix + ".kind"), "level: only in_position can be a pulse");
      axis.bits[index(bit_of)] = bit;
    }
  }
}

void read_writes(KeyValueFile& file, RegisterMap& map) {
  using Kind = WriteOperand::Kind;
  map.write_function = file.one_of_or("write.function", "6", {"6", "16"}) == "6" ? 6 : 16;
  map.code_registers = words_in(file, "write.codes", 0xFFFF, "registers from 0 to 65535");
  for (const TableOperation operation : all_operations) {
    if (operation == TableOperation::identify || operation == TableOperation::status) continue;
    const std::string key = fmt::format("write.{}", to_string(operation));
    map.writes[index(operation)] = write_list(file, key, map.layout);
    if (!map.list(operation).empty())
      map.of_table[index(operation)] = file.one_of_or(key + ".scope", "axis", {"axis", "table"}) == "table";
    const bool is_stop = operation == TableOperation::stop || operation == TableOperation::abort;
    double waits_s = 0.0;
    for (const WriteStep& step : map.list(operation)) waits_s += step.wait_s;
    if (is_stop && waits_s > longest_stop_pause_s + 1e-9)
      file.reject(key, fmt::format("waits of at most {} s together, not {}: it must be out within 0.1 s",
                                   format_number(longest_stop_pause_s), format_number(waits_s)));
    const bool optional = operation == TableOperation::setup || operation == TableOperation::clear_fault ||
                          operation == TableOperation::enable ||
                          (operation == TableOperation::home && map.home_by_encoder);
    if (!optional && !file.has(key)) file.text(key);  // reports that the key is missing
    const std::vector<WriteOperand> operands = operands_of(map.list(operation));
    if (file.has(key) && operands.empty()) file.reject(key, "at least one write of a register");
    for (const WriteOperand& operand : operands)
      if (operation != TableOperation::move && operand.kind == Kind::quantity)
        file.reject(key, "numbers: position, distance, rate and acceleration belong to write.move");
  }
  const std::vector<WriteOperand> move = operands_of(map.list(TableOperation::move));
  const auto asks_for = [&](MoveQuantity quantity) {
    return std::ranges::any_of(move, [=](const WriteOperand& operand) { return operand.asks_for(quantity); });
  };
  if (map.once(TableOperation::stop) != map.once(TableOperation::abort))
    file.reject("write.stop.scope", "the same scope as write.abort: an axis that is off is sent that instead");
  const bool of_all = map.once(TableOperation::move);
  for (const WriteOperand& operand : move) {
    if (operand.kind == Kind::constant) continue;
    if (operand.kind == Kind::axis ? of_all : operand.of_axis.has_value() != of_all)
      file.reject("write.move",
                  "position.heading, rate.pitch and the like with write.move.scope = table, else without an axis");
  }
  if (asks_for(MoveQuantity::position) == asks_for(MoveQuantity::distance) || !asks_for(MoveQuantity::rate))
    file.reject("write.move", "either position or distance in it, and rate");
  for (const MapAxis& axis : map.axis)
    if (axis.modulo_deg > 0.0 && asks_for(MoveQuantity::position))
      file.reject("write.move", "distance: with modulo_deg a position does not say how many turns to go");
  KeyTable keys(file);
  if (map.can_switch_off && !map.list(TableOperation::stop).empty() &&
      map.list(TableOperation::stop) == map.list(TableOperation::abort)) {
    file.reject("write.abort",
                "writes that switch the drive off, unlike write.stop; or switch_off = false where none does");
  }
  if (file.has("heartbeat.address")) {
    map.heartbeat_address = int(hex_or_decimal(file, "heartbeat.address", 0, 65535));
    map.heartbeat_of_table = file.one_of_or("heartbeat.scope", "axis", {"axis", "table"}) == "table";
    map.heartbeat_values = words_in(file, "heartbeat.values", 0xFFFF, "numbers from 0 to 65535");
    if (file.has("heartbeat.values") && map.heartbeat_values.empty())
      file.reject("heartbeat.values", "at least one number");
    keys.number("heartbeat.period_s", map.heartbeat_period_s, between(0.001, 60.0));
    keys.number("heartbeat.watchdog_s", map.watchdog_s, between(0.01, 600.0));
    if (map.watchdog_s < 2.0 * map.heartbeat_period_s)
      file.reject(file.has("heartbeat.watchdog_s") ? "heartbeat.watchdog_s" : "heartbeat.period_s",
                  "heartbeat.watchdog_s at least twice heartbeat.period_s");
  }
}

Result<RegisterMap> map_from(KeyValueFile& file) {
  RegisterMap map;
  KeyTable keys(file);
  read_table_description(file, map);
  map.layout.high_word_first = file.one_of("words.order", {"high_first", "low_first"}) == "high_first";
  keys.flag("words.swap_bytes", map.layout.swap_bytes);
  bool ramp_time = false;
  keys.chosen("acceleration.kind", ramp_time, {"proportional", "ramp_time"});
  for (MapAxis& axis : map.axis) axis.ramp_time = ramp_time;
  keys.chosen("home.kind", map.home_by_encoder, {"search", "encoder"});
  read_modbus_link(file, map.link);
  read_axes(file, map);
  read_status_block(file, map);
  read_writes(file, map);
  for (const MapAxis& axis : map.axis)
    if (!map.home_by_encoder && !axis.bit(DriveBit::homed))
      file.text("bit.homed.address");  // reports that the key is missing
  // A misspelt key is reported first; it would look like a missing one.
  TRY(file.check_all_used());
  check_map(file, map);
  TRY(file.status());
  if (const std::optional<Clash> clash = write_clash(map)) {
    file.reject(clash->key, clash->expected);
    TRY(file.check_all_used());
  }
  return map;
}

}  // namespace

void read_modbus_link(KeyValueFile& file, ModbusLinkSettings& link) {
  const std::string kind = file.one_of("link.kind", {"tcp", "rtu", "rtu_tcp"});
  link.tcp = kind != "rtu";
  link.rtu_frames = kind == "rtu_tcp";
  link.byte_timeout_s = 0.1;
  link.serial.parity = SerialParity::even;
  KeyTable keys(file);
  keys.text("link.address", link.address);
  read_serial_keys(keys, "link", link.serial, !link.tcp);
  if (link.serial.data_bits != 8) file.reject("link.data_bits", "8, as RTU has it");
  read_link_times(keys, link, "link.response_timeout_s");
  keys.number("link.byte_timeout_s", link.byte_timeout_s, link_wait_range);
}

int StatusBit::shift() const { return std::countr_zero(mask); }

bool StatusBit::is_set(std::uint16_t word) const {
  if (codes.empty()) return ((word & mask) != 0) == active_high;
  return std::ranges::find(codes, (word & mask) >> shift()) != codes.end();
}

Result<RegisterMap> read_register_map(const std::string& path) {
  TRY(expect_file(path, FileKind::register_map));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return map_from(file);
}

Result<RegisterMap> parse_register_map(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return map_from(file);
}

std::string caution_of(const RegisterMap& map) {
  if (!map.can_switch_off) return "switch_off = false: its drives stay on after every run, with nobody to watch them";
  return stop_holds_enable(map) ? "write.stop holds the bits of write.enable: it switches a drive on that was off" : "";
}

int WriteStep::length() const {
  int count = 0;
  for (const WriteOperand& operand : operands) count += register_count(operand.type);
  return count;
}

std::optional<WriteStep> parse_write_step(std::string_view text) {
  WriteStep step;
  auto words = split_words(text);
  if (words.size() == 2 && words[0] == "wait") {
    const auto seconds = parse_number(words[1]);
    if (!seconds || !pause_range.contains(*seconds)) return {};
    step.wait_s = *seconds;
    return step;
  }
  step.of_table = !words.empty() && words[0] == "table";
  if (step.of_table) {
    text = trimmed(text.substr(words[0].size()));
    words.erase(words.begin());
  }
  if (words.empty()) return {};
  const auto address = parse_whole<long>(words[0]);
  if (!address || *address < 0 || *address > 65535) return {};
  step.address = int(*address);
  for (const std::string_view part : split(text.substr(words[0].size()), '+')) {
    const auto operand = operand_of(part);
    if (!operand) return {};
    step.operands.push_back(*operand);
  }
  if (step.length() > longest_block || step.address + step.length() > 65536) return {};
  return step;
}

Result<Words> words_of(const RegisterMap& map, const WriteOperand& operand, int at, Axis axis, const Moves& moves) {
  const Axis which = operand.of_axis.value_or(axis);
  const MapAxis& scale = map.of(which);
  using Kind = WriteOperand::Kind;
  const double value = operand.kind == Kind::constant ? operand.constant
                       : operand.kind == Kind::axis   ? scale.code
                                                      : scale.units_of(operand.quantity, moves[index(which)]);
  const bool of_rate = operand.asks_for(MoveQuantity::rate),
             of_acceleration = operand.asks_for(MoveQuantity::acceleration);
  const char* const key = of_rate ? "rate_scale" : of_acceleration ? "acceleration_scale" : "counts_per_degree";
  const std::optional<Words> encoded = encode_words(value, operand.type, map.layout);
  if (encoded && !((of_rate || of_acceleration) &&
                   is_told_coarsely(decode_words(encoded->span(), operand.type, map.layout), value)))
    return *encoded;
  return input_error("register {} cannot hold {}{}: expected another type than {}, or another axis.{}.{}{}", at,
                     format_number(value), encoded ? " to 5 %" : "", to_string(operand.type), to_string(which), key,
                     of_rate ? ", or another rate" : "");
}

Result<std::vector<std::uint16_t>> words_of(const RegisterMap& map, const WriteStep& step, Axis axis,
                                            const Moves& moves) {
  std::vector<std::uint16_t> words;
  for (const WriteOperand& operand : step.operands) {
    const Words some = TRY(words_of(map, operand, step.address + int(words.size()), axis, moves));
    words.insert(words.end(), some.span().begin(), some.span().end());
  }
  return words;
}

Status check_move(const RegisterMap& map, Axis axis, const Moves& moves) {
  for (const WriteStep& step : map.list(TableOperation::move))
    if (const auto words = words_of(map, step, axis, moves); !words)
      return input_error(source_of(map, "write.move") + ": write.move: " + words.error().message);
  const MapAxis& scale = map.of(axis);
  const MoveNumbers& numbers = moves[index(axis)];
  const auto reads = [&](const RegisterField& field, double value) {
    return encode_words(value, field.type, map.layout).has_value();
  };
  const double counts = scale.units_of(numbers.position_deg), rate = scale.measured_rate_scale * numbers.rate_degps;
  if (scale.modulo_deg == 0.0 && !reads(scale.position, counts))
    return input_error("position.type: its register cannot read " + format_number(counts));
  if (scale.rate && !reads(*scale.rate, rate))
    return input_error("rate.type: its register cannot read " + format_number(rate));
  return {};
}

// ---- explain(): each operation, request by request ----

std::string register_text(int address) { return fmt::format("{} (0x{:04X})", address, address); }

namespace {

std::string hexadecimal(unsigned value) { return fmt::format("0x{:04X}", value); }

std::string request(int unit, int function, int address, std::size_t count) {
  return fmt::format("unit {}, function {}, register {}{}", unit, function, register_text(address),
                     count > 1 ? fmt::format(", {} registers", count) : "");
}

// Returns the source of a written number; empty for a constant of the file.
std::string meaning_of(const RegisterMap& map, const WriteOperand& operand, Axis axis) {
  if (operand.kind == WriteOperand::Kind::constant) return "";
  if (operand.kind == WriteOperand::Kind::axis) return ", the axis's code";
  return fmt::format(", {}{}: {}", to_string(operand.quantity),
                     operand.of_axis ? std::string(".") + to_string(*operand.of_axis) : "",
                     scale_text(map.of(operand.of_axis.value_or(axis)), operand.quantity, true));
}

void explain_writes(const RegisterMap& map, TableOperation operation, const std::string& name,
                    std::vector<TableRow>& rows) {
  const std::string source = source_of(map, "write." + std::string(to_string(operation)));
  const bool of_table = map.once(operation) && operation != TableOperation::move;
  for (const Axis axis : axes_for(of_table)) {
    const std::string whose = of_table ? "table" : to_string(axis);
    Moves moves{};
    if (map.once(operation)) moves.fill({0.0, 0.0, shown_move.rate_degps, shown_move.acceleration_degps2});
    moves[index(axis)] = shown_move;
    for (const WriteStep& step : map.list(operation)) {
      if (step.operands.empty()) {
        rows.push_back({name, whose, "", "a pause of " + format_number(step.wait_s) + " s", "", source});
        continue;
      }
      const int first = map.address_of(step, operation, axis);
      const auto count = std::size_t(step.length());
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
      const std::size_t asked = std::size_t(block.count) + index(axis);
      rows.push_back({"status", whose, request(scale.unit, map.status_function, block.read_at(scale), asked), "",
                      std::to_string(2 * asked) + " bytes",
                      source(&block == &map.status[0] ? "status.address" : "status2.address")});
    }
    const auto field = [&](int address, const std::string& says, const std::string& key) {
      rows.push_back(
          {"status", whose, "  its register " + register_text(map.read_at(address, axis)), says, "", source(key)});
    };
    const auto number = [&](const RegisterField& read, MoveQuantity quantity) {
      const std::string name = to_string(quantity);
      field(read.address, fmt::format("{} {}: {}", to_string(read.type), name, scale_text(scale, quantity, false)),
            name + ".address");
    };
    number(scale.position, MoveQuantity::position);
    if (scale.rate) number(*scale.rate, MoveQuantity::rate);
    if (scale.alarm) field(scale.alarm->address, std::string(to_string(scale.alarm->type)) + " alarm", "alarm.address");
    for (const DriveBit which : all_drive_bits)
      if (const auto& bit = scale.bit(which))
        field(bit->address, bit_text(*bit, which, scale.arrives_in_a_pulse),
              fmt::format("bit.{}{}", to_string(which), bit->codes.empty() ? ".mask" : ".codes"));
  }
}

void explain_heartbeat(const RegisterMap& map, std::vector<TableRow>& rows) {
  if (!map.heartbeat_address) return;
  for (const Axis axis : axes_for(map.heartbeat_of_table)) {
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
