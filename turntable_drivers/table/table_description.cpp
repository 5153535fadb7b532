#include "turntable_drivers/table/table_description.h"

#include <fmt/format.h>

#include <algorithm>
#include <initializer_list>

namespace turncal {

void read_device_description(KeyValueFile& file, DeviceDescription& description) {
  KeyTable keys(file);
  description.file = file.file_name();
  description.lines = read_line_sources(file);
  file.integer("format", 1, 1);
  description.name = file.text("name");
  keys.flag("verified_on_hardware", description.verified_on_hardware);
  keys.flag("commissioned", description.commissioned);
}

void read_table_description(KeyValueFile& file, TableDescription& description) {
  read_device_description(file, description);
  KeyTable keys(file);
  keys.flag("switch_off", description.can_switch_off);
  keys.number("moving.rate_degps", description.moving_rate_degps, between(1e-6, 1.0));
  keys.number("plausible.angle_deg", description.plausible_deg, between(1.0, 1e6));
  keys.number("plausible.rate_degps", description.plausible_rate_degps, between(1.0, 1e5));
}

bool decides_motion(std::string_view key) {
  if (key.starts_with("axis.")) key.remove_prefix(std::min(key.find('.', 5), key.size() - 1) + 1);
  if (key.starts_with("write.")) key.remove_prefix(6);
  const std::string_view first = key.substr(0, key.find('.'));
  return first.starts_with("status") || first == "bit" || first == "enable" || first == "home" || first == "move" ||
         first == "stop" || first == "abort";
}

void read_link_times(KeyTable& keys, TableLinkSettings& link, const std::string& timeout) {
  keys.number(timeout, link.reply_timeout_s, link_wait_range);
  keys.number("link.quiet_s", link.quiet_s, link_wait_range);
  keys.number("link.gap_s", link.gap_s, zero_or(1e-4, 0.05));
  keys.whole("link.read_retries", link.read_retries, 0, 10);
}

void read_axis_scale(KeyValueFile& file, Axis axis, AxisScale& scale, const std::string& units, bool has_default) {
  constexpr NumberRange range{1e-6, 1e9};  // a number outside is a mistake
  KeyTable keys(file);
  const std::string prefix = fmt::format("axis.{}.", to_string(axis));
  scale.units_per_degree =
      has_default ? file.number_or(prefix + units, 1.0, range) : file.number(prefix + units, range);
  scale.sign = file.one_of_or(prefix + "sign", "1", {"1", "-1"}) == "-1" ? -1 : 1;
  keys.number(prefix + "zero_deg", scale.zero_deg, between(-360.0, 360.0));
  keys.number(prefix + "modulo_deg", scale.modulo_deg, between(0.0, 3600.0));
  if (scale.modulo_deg != 0.0 && !(scale.modulo_deg >= 90.0))
    file.reject(prefix + "modulo_deg", "0, or a circle of 90 to 3600 deg");
  scale.rate_scale = file.number_or(prefix + "rate_scale", scale.units_per_degree, range);
  scale.measured_rate_scale = file.number_or(prefix + "measured_rate_scale", scale.rate_scale, range);
  scale.acceleration_scale = file.number_or(prefix + "acceleration_scale", scale.units_per_degree, range);
}

std::optional<Axis> take_axis(std::string_view& name) {
  for (const Axis axis : all_axes) {
    const std::string suffix = std::string(".") + to_string(axis);
    if (!name.ends_with(suffix)) continue;
    name.remove_suffix(suffix.size());
    return axis;
  }
  return {};
}

double AxisScale::units_of(MoveQuantity quantity, const MoveNumbers& move) const {
  switch (quantity) {
    case MoveQuantity::position: return units_of(move.position_deg);
    case MoveQuantity::distance: return signed_units() * move.distance_deg;
    case MoveQuantity::rate: return rate_scale * move.rate_degps;
    case MoveQuantity::acceleration: break;
  }
  return ramp_time ? acceleration_scale / move.acceleration_degps2 : acceleration_scale * move.acceleration_degps2;
}

std::string scale_text(const AxisScale& scale, MoveQuantity quantity, bool told) {
  const auto per = [](double factor, const char* unit) { return format_number(factor) + " per " + unit; };
  switch (quantity) {
    case MoveQuantity::position:
      return fmt::format("{}, 0 at {} deg{}{}", per(scale.signed_units(), "deg"), format_number(scale.zero_deg),
                         scale.modulo_deg > 0.0 ? ", a circle of " + format_number(scale.modulo_deg) + " deg" : "",
                         scale.shorter_way && told ? ", gone the shorter way" : "");
    case MoveQuantity::distance: return per(scale.signed_units(), "deg");
    case MoveQuantity::rate: return per(told ? scale.rate_scale : scale.sign * scale.measured_rate_scale, "deg/s");
    case MoveQuantity::acceleration: break;
  }
  return scale.ramp_time ? format_number(scale.acceleration_scale) + " / (deg/s^2), a ramp time"
                         : per(scale.acceleration_scale, "deg/s^2");
}

const char* harm_of(TableOperation starts) {
  return starts == TableOperation::enable ? "switch the drive on"
         : starts == TableOperation::home ? "start a homing"
                                          : "start a motion";
}

std::array<DriveState, 4> drive_states(bool searches) {
  const auto with = [](const char* expected, std::initializer_list<DriveBit> set,
                       std::initializer_list<DriveBit> clear) {
    DriveState state{expected};
    for (const DriveBit bit : set) state.flags[index(bit)] = true;
    for (const DriveBit bit : clear) state.flags[index(bit)] = false;
    return state;
  };
  using enum DriveBit;
  DriveState before_homing = with(
      "a status that can say of an axis that it is on and not homed: enabled and remote, without homed, "
      "moving, fault or emergency_stop",
      {enabled, remote}, {homed, moving, fault, emergency_stop});
  if (!searches) before_homing.flags = {};
  return {with("a status that can say of an axis that it has arrived: enabled, in_position, homed and remote, without "
               "moving, fault, a limit or emergency_stop",
               {enabled, in_position, homed, remote}, {fault, moving, limit_positive, limit_negative, emergency_stop}),
          with("a status that can say of an axis that it moves: enabled, moving, homed and remote, without "
               "in_position, fault, a limit or emergency_stop",
               {enabled, moving, homed, remote}, {in_position, fault, limit_positive, limit_negative, emergency_stop}),
          with("a status that can say of an axis that it is off and at rest: without enabled and moving", {},
               {enabled, moving}),
          before_homing};
}

std::string source_of(const DeviceDescription& device, const std::string& key) {
  for (const LineSource& line : device.lines)
    if (line.key == key) return fmt::format("line {}{}", line.line, line.mark.empty() ? "" : " [" + line.mark + "]");
  return "";
}

std::string format_rows(const std::vector<TableRow>& rows) {
  constexpr std::array<std::string TableRow::*, 6> columns = {
      &TableRow::operation, &TableRow::axis, &TableRow::sent, &TableRow::says, &TableRow::answer, &TableRow::source};
  std::vector<TableRow> all{{"operation", "axis", "sent or read", "what it says", "answer expected", "from"}};
  all.insert(all.end(), rows.begin(), rows.end());
  std::array<std::size_t, columns.size()> width{};
  for (const TableRow& row : all)
    for (std::size_t i = 0; i < columns.size(); ++i) width[i] = std::max(width[i], (row.*columns[i]).size());
  std::string text;
  for (const TableRow& row : all) {
    std::string line;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const std::string& cell = row.*columns[i];
      line += cell + std::string(width[i] + 2 - cell.size(), ' ');
    }
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string visible(std::string_view text, std::size_t most) {
  std::string result;
  for (const char c : text.substr(0, most)) {
    const auto code = static_cast<unsigned char>(c);
    result += c == '\r' ? "\\r" : c == '\n' ? "\\n" : std::string(1, code < 0x20 || code >= 0x7F ? '?' : c);
  }
  return result + (text.size() > most ? "..." : "");
}

}  // namespace turncal
