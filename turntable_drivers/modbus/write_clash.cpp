#include "turntable_drivers/modbus/write_clash.h"

#include <algorithm>
#include <utility>

#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

using Register = std::pair<int, int>;  // unit, address

// One register that a list writes, in its order: a number of several registers is as many of these, since that is what the drive gets.
struct Written {
  Register place;
  std::optional<double> value;  // none: what a move asks for
  std::vector<std::uint16_t> words;
  int registers = 1;
  bool target = false;  // where a move goes
  int number = 0;       // of the list's numbers
};

// A release: 0 after another value.
bool releases(const std::vector<Written>& before, const Written& now) {
  return now.value == 0.0 && std::any_of(before.begin(), before.end(), [&](const Written& earlier) {
           return earlier.place == now.place && earlier.value != 0.0;
         });
}

std::vector<Written> written_by(const RegisterMap& map, DriveOperation operation, Axis axis) {
  std::vector<Written> all;
  int number = 0;
  for (const WriteStep& step : map.list(operation)) {
    int address = map.address_of(step, operation, axis);
    for (const WriteOperand& operand : step.operands) {
      Written now{{map.unit_of(operation, axis), address}, {}, {}};
      if (operand.kind == WriteOperand::Kind::constant) now.value = operand.constant;
      if (operand.kind == WriteOperand::Kind::axis) now.value = map.of(operand.of_axis.value_or(axis)).code;
      now.registers = register_count(operand.type);
      now.target = operand.kind == WriteOperand::Kind::position || operand.kind == WriteOperand::Kind::distance;
      now.number = ++number;
      const int first = std::exchange(address, address + now.registers);
      const auto words = now.value ? encode_words(*now.value, operand.type, map.layout) : std::nullopt;
      if (!words) {
        all.push_back(std::move(now));
        continue;
      }
      int at = first;
      for (const std::uint16_t word : words->span()) {
        const Written one{{now.place.first, at++}, static_cast<double>(word), {word}, 1, false, number};
        if (!releases(all, one)) all.push_back(one);
      }
    }
  }
  return all;
}

// What starts an operation, as it stands in its list.
std::vector<Written> triggers_of(const std::vector<Written>& list, DriveOperation operation) {
  if (list.empty()) return {};
  std::vector<Written> last;  // the registers of the last number; of several those that are not 0
  for (const Written& written : list)
    if (written.number == list.back().number) last.push_back(written);
  if (last.size() > 1) std::erase_if(last, [](const Written& written) { return written.value == 0.0; });
  if (last.empty()) last.push_back(list.back());
  if (operation == DriveOperation::enable) return last;
  std::vector<Written> found;
  for (const Written& written : list) {
    const bool there =
        std::any_of(last.begin(), last.end(), [&](const Written& l) { return l.place == written.place; });
    if (there && (written.value != 0.0 || last.size() == 1)) found.push_back(written);
  }
  return found;
}

bool holds_bits(const Written& written, const Written& trigger) {
  if (written.place != trigger.place || written.words.empty() || trigger.value.value_or(0.0) == 0.0) return false;
  return (written.words[0] & trigger.words[0]) == trigger.words[0];
}

// What a list leaves in the register that enables; null: it does not write there.
const Written* left_in(const std::vector<Written>& list, const Written& trigger) {
  const auto last =
      std::find_if(list.rbegin(), list.rend(), [&](const Written& w) { return w.place == trigger.place; });
  return last == list.rend() ? nullptr : &*last;
}

// An abort that takes the enabling bits away, and gives them back.
std::optional<WriteClash> on_again(const RegisterMap& map, Axis axis) {
  const std::vector<Written> abort = written_by(map, DriveOperation::abort, axis);
  for (const Written& trigger : triggers_of(written_by(map, DriveOperation::enable, axis), DriveOperation::enable)) {
    const Written* const left = left_in(abort, trigger);
    const bool taken_away = std::any_of(abort.begin(), abort.end(), [&](const Written& written) {
      return written.place == trigger.place && !holds_bits(written, trigger);
    });
    if (!map.can_switch_off || left == nullptr || !taken_away || !holds_bits(*left, trigger)) continue;
    return WriteClash{"write.abort", "that it does not end with the bits of write.enable, which switch on again"};
  }
  return std::nullopt;
}

// Another register that both write with different values before: another command.
bool differ(const std::vector<Written>& one, const std::vector<Written>& other, const Register& trigger) {
  for (const Written& a : one) {
    if (a.place == trigger || !a.value) continue;
    const auto same_place = [&](const Written& b) { return b.place == a.place; };
    if (std::none_of(other.begin(), other.end(), same_place)) continue;
    if (std::none_of(other.begin(), other.end(),
                     [&](const Written& b) { return same_place(b) && b.words == a.words; })) {
      return true;
    }
  }
  return false;
}

bool holds(const Written& written, const Written& trigger) {
  return trigger.value && written.place == trigger.place && written.words == trigger.words;
}

bool overlaps(const Register& place, int registers, const Written& target) {
  return place.first == target.place.first && place.second < target.place.second + target.registers &&
         target.place.second < place.second + registers;
}

std::string said(const Register& place) { return "register " + std::to_string(place.second); }

Register heartbeat_of(const RegisterMap& map, Axis axis) {
  return {map.of(axis).unit, *map.heartbeat_address + (map.heartbeat_of_table ? 0 : map.of(axis).address_offset)};
}

constexpr DriveOperation starting[] = {DriveOperation::enable, DriveOperation::home, DriveOperation::move};
constexpr DriveOperation harmless[] = {DriveOperation::setup, DriveOperation::stop, DriveOperation::abort,
                                       DriveOperation::clear_fault};

// A drive that is on may follow its target register without any other command.
std::optional<WriteClash> target_clash_of(const RegisterMap& map, Axis of_move, Axis of_harmless) {
  const std::vector<Written> move = written_by(map, DriveOperation::move, of_move);
  for (const Written& target : move) {
    if (!target.target) continue;
    const std::string expected = "no write to " + said(target.place) + ", where write.move says where to go";
    for (const DriveOperation operation : harmless) {
      const std::vector<Written> other = written_by(map, operation, of_harmless);
      for (const Written& written : other) {
        if (overlaps(written.place, written.registers, target) && !differ(move, other, written.place))
          return WriteClash{"write." + std::string(to_string(operation)), expected};
      }
    }
    if (map.heartbeat_address && overlaps(heartbeat_of(map, of_harmless), 1, target))
      return WriteClash{"heartbeat.address", expected};
  }
  return std::nullopt;
}

std::optional<WriteClash> clash_of(const RegisterMap& map, Axis of_starting, Axis of_harmless) {
  for (const DriveOperation starts : starting) {
    const std::vector<Written> list = written_by(map, starts, of_starting);
    for (const Written& trigger : triggers_of(list, starts)) {
      if (!trigger.value) continue;
      for (const DriveOperation operation : harmless) {
        const std::vector<Written> other = written_by(map, operation, of_harmless);
        for (const Written& written : other) {
          if (!holds(written, trigger) || differ(list, other, trigger.place)) continue;
          return WriteClash{"write." + std::string(to_string(operation)),
                            "no write of " + format_number(*trigger.value) + " to " + said(trigger.place) +
                                ", which is write." + to_string(starts)};
        }
      }
      if (!map.heartbeat_address) continue;
      const Register beat = heartbeat_of(map, of_harmless);
      const int first = trigger.place.second, length = static_cast<int>(trigger.words.size());
      const bool inside = beat.first == trigger.place.first && beat.second >= first && beat.second < first + length;
      if (!inside) continue;
      const std::vector<std::uint16_t>& values = map.heartbeat_values;
      const std::uint16_t word = trigger.words[static_cast<std::size_t>(beat.second - first)];
      if (values.empty() || std::find(values.begin(), values.end(), word) != values.end()) {
        return WriteClash{values.empty() ? "heartbeat.address" : "heartbeat.values",
                          "another register or value than that of write." + std::string(to_string(starts))};
      }
    }
  }
  return std::nullopt;
}

std::optional<WriteClash> same_axis(const RegisterMap& map, Axis one, Axis other) {
  const auto read_at = [&](Axis axis) {
    const int address = map.of(axis).position.address;
    const bool in_first = address >= map.status_address && address < map.status_address + map.status_count;
    const bool of_table = in_first ? map.status_of_table : map.status2_of_table;
    return Register{map.of(axis).unit, address + (of_table ? 0 : map.of(axis).address_offset)};
  };
  const std::string key = "axis." + std::string(to_string(other)) + ".unit";
  const std::string apart =
      "a unit or an address_offset of its own, not those of axis." + std::string(to_string(one)) + ": ";
  if (read_at(one) == read_at(other)) return WriteClash{key, apart + "both read one position"};
  if (map.once(DriveOperation::move)) return std::nullopt;
  const std::vector<Written> moves = written_by(map, DriveOperation::move, one);
  const std::vector<Written> others = written_by(map, DriveOperation::move, other);
  const bool alike =
      std::equal(moves.begin(), moves.end(), others.begin(), others.end(),
                 [](const Written& a, const Written& b) { return a.place == b.place && a.words == b.words; });
  return alike ? std::optional(WriteClash{key, apart + "one write.move moves both"}) : std::nullopt;
}

}  // namespace

std::optional<WriteClash> write_clash(const RegisterMap& map) {
  for (const Axis one : all_axes) {
    if (auto clash = on_again(map, one)) return clash;
    for (const Axis other : all_axes) {
      if (index(one) < index(other)) {
        if (auto clash = same_axis(map, one, other)) return clash;
      }
      if (auto clash = clash_of(map, one, other)) return clash;
      if (auto clash = target_clash_of(map, one, other)) return clash;
    }
  }
  return std::nullopt;
}

bool stop_holds_enable(const RegisterMap& map) {
  const std::vector<Written> stop = written_by(map, DriveOperation::stop, Axis::heading);
  const auto triggers = triggers_of(written_by(map, DriveOperation::enable, Axis::heading), DriveOperation::enable);
  return std::any_of(triggers.begin(), triggers.end(), [&](const Written& trigger) {
    const Written* const left = left_in(stop, trigger);
    return left != nullptr && holds_bits(*left, trigger);
  });
}

}  // namespace turncal
