// Checks that a register map can express what a run needs, and that no write has an unintended effect.
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "turntable_drivers/modbus/register_map.h"

namespace turncal {
namespace {

// True if one value of the register can show the whole state through the axis's bits in it. Bits in other registers are ignored.
bool can_say(const MapAxis& axis, int address, const DriveState& state) {
  for (unsigned word = 0; word <= 0xFFFF; ++word) {
    bool says = true;
    for (const DriveBit which : all_drive_bits) {
      const std::optional<StatusBit>& bit = axis.bit(which);
      if (!bit || bit->address != address || !state[which]) continue;
      says = says && bit->is_set(std::uint16_t(word)) == *state[which];
    }
    if (says) return true;
  }
  return false;
}

// Two kinds of trouble may share a bit, and a done bit may mean in_position and, inverted, moving.
bool may_share(DriveBit one, const StatusBit& a, DriveBit other, const StatusBit& b) {
  using enum DriveBit;
  if (a.address != b.address || (a.mask & b.mask) == 0 || !a.codes.empty() || !b.codes.empty()) return true;
  const auto is_trouble = [](DriveBit bit) {
    return bit == fault || bit == emergency_stop || bit == limit_positive || bit == limit_negative;
  };
  const bool done = one == in_position && other == moving;
  return (is_trouble(one) && is_trouble(other)) || (done && a.active_high != b.active_high);
}

// Checks that the bits can express what a run needs, and overlap neither the position nor each other.
void check_status(KeyValueFile& file, const RegisterMap& map) {
  const auto reject = [&file](Axis which, const std::string& name, const std::string& expected) {
    const std::string own = "axis." + std::string(to_string(which)) + "." + name;
    file.reject(file.has(own) ? own : name, expected);
  };
  for (const Axis which : all_axes) {
    const MapAxis& axis = map.of(which);
    const auto in_position = [&](int address, int count) {
      return address < axis.position.address + register_count(axis.position.type) &&
             axis.position.address < address + count;
    };
    if (map.heartbeat_address && map.heartbeat_of_table == map.status[0].of_table &&
        in_position(*map.heartbeat_address, 1))
      file.reject("heartbeat.address", "a register of its own: the position is there");
    if (axis.rate && in_position(axis.rate->address, register_count(axis.rate->type)))
      reject(which, "rate.address", "a register of its own: the position is there");
    for (const DriveBit flag : all_drive_bits) {
      const std::optional<StatusBit>& bit = axis.bit(flag);
      if (!bit) continue;
      const std::string name = fmt::format("bit.{}", to_string(flag));
      if (in_position(bit->address, 1))
        reject(which, name + ".address", "a register of its own: the position is there");
      for (const DriveBit before : all_drive_bits) {
        if (before == flag) break;
        if (const auto& other = axis.bit(before); other && !may_share(before, *other, flag, *bit))
          reject(which, name + ".mask", fmt::format("bits of its own, not those of bit.{}", to_string(before)));
      }
    }
    for (const DriveBit flag : all_drive_bits) {
      const std::optional<StatusBit>& bit = axis.bit(flag);
      for (const DriveState& state : drive_states(!map.home_by_encoder))
        if (bit && state[flag] && !can_say(axis, bit->address, state))
          reject(which, fmt::format("bit.{}{}", to_string(flag), bit->codes.empty() ? ".mask" : ".codes"),
                 state.expected);
    }
  }
}

// With the offset of an axis every address must be below 65536.
void check_addresses(KeyValueFile& file, const RegisterMap& map) {
  for (const Axis which : all_axes) {
    int last = 0;
    for (const StatusBlock& block : map.blocks())
      if (!block.of_table) last = std::max(last, block.address + block.count);
    last += int(index(which));
    if (map.heartbeat_address && !map.heartbeat_of_table) last = std::max(last, *map.heartbeat_address + 1);
    for (const TableOperation operation : all_operations)
      for (const WriteStep& step : map.list(operation))
        if (!step.of_table && !map.once(operation)) last = std::max(last, step.address + step.length());
    if (last + map.of(which).address_offset <= 65536) continue;
    file.reject("axis." + std::string(to_string(which)) + ".address_offset",
                "at most " + std::to_string(65536 - last) + ": the last register used is " + std::to_string(last - 1) +
                    " without it");
  }
}

// ---- writes ----

using Register = std::pair<int, int>;  // unit, address
constexpr std::uint16_t whole_word = 0xFFFF;

// One register that a list writes, in its order. A number of several registers is split into these, as the drive receives it.
struct Written {
  Register place;
  std::optional<double> value;  // none: a quantity of a move
  std::vector<std::uint16_t> words;
  int registers = 1;
  bool target = false;    // target of a move
  int number = 0;         // index of the number in the list
  bool release = false;   // 0 after another value
  bool is_code = false;   // a command number, not bits
  bool of_table = false;  // at the same place for all axes
  std::uint16_t word() const { return words.empty() ? 0 : words[0]; }
};

bool released_by(const std::vector<Written>& before, const Written& now) {
  return now.value == 0.0 && std::ranges::any_of(before, [&](const Written& earlier) {
           return earlier.place == now.place && earlier.value != 0.0;
         });
}

// Returns all writes, including releases.
std::vector<Written> sent_by(const RegisterMap& map, TableOperation operation, Axis axis) {
  std::vector<Written> all;
  int number = 0;
  for (const WriteStep& step : map.list(operation)) {
    int address = map.address_of(step, operation, axis);
    for (const WriteOperand& operand : step.operands) {
      Written now{{map.unit_of(operation, axis), address}, {}, {}};
      if (operand.kind == WriteOperand::Kind::constant) now.value = operand.constant;
      if (operand.kind == WriteOperand::Kind::axis) now.value = map.of(operand.of_axis.value_or(axis)).code;
      now.registers = register_count(operand.type);
      now.target = operand.asks_for(MoveQuantity::position) || operand.asks_for(MoveQuantity::distance);
      now.number = ++number;
      now.of_table = step.of_table || map.once(operation);
      const int first = std::exchange(address, address + now.registers);
      const auto words = now.value ? encode_words(*now.value, operand.type, map.layout) : std::nullopt;
      if (!words) {
        all.push_back(std::move(now));
        continue;
      }
      int at = first;
      for (const std::uint16_t word : words->span()) {
        const bool is_code = std::ranges::count(map.code_registers, step.address + at - now.place.second) > 0;
        Written one{{now.place.first, at++}, double(word), {word}, 1, false, number, false, is_code, now.of_table};
        one.release = released_by(all, one);
        all.push_back(std::move(one));
      }
    }
  }
  return all;
}

std::vector<Written> written_by(const RegisterMap& map, TableOperation operation, Axis axis) {
  std::vector<Written> all = sent_by(map, operation, axis);
  std::erase_if(all, [](const Written& written) { return written.release; });
  return all;
}

// Returns the triggers of an operation, in the order of its list.
std::vector<Written> triggers_of(const std::vector<Written>& list, TableOperation operation) {
  if (list.empty()) return {};
  std::vector<Written> last;  // registers of the last number; if there are several, those that are not 0
  for (const Written& written : list)
    if (written.number == list.back().number) last.push_back(written);
  if (last.size() > 1) std::erase_if(last, [](const Written& written) { return written.value == 0.0; });
  if (last.empty()) last.push_back(list.back());
  if (operation == TableOperation::enable) return last;
  std::vector<Written> found;
  for (const Written& written : list) {
    const bool there = std::ranges::any_of(last, [&](const Written& l) { return l.place == written.place; });
    if (there && (written.value != 0.0 || last.size() == 1)) found.push_back(written);
  }
  return found;
}

// Returns the last write of a list to a register; null if there is none.
const Written* left_in(const std::vector<Written>& list, const Register& place) {
  const auto last = std::find_if(list.rbegin(), list.rend(), [&](const Written& w) { return w.place == place; });
  return last == list.rend() ? nullptr : &*last;
}

// A trigger, and the bits of its word that count. With all bits, only the exact value triggers.
struct Trigger {
  Written written;
  std::uint16_t mask = whole_word;
};

// The bits of a control word act independently. If a drive is enabled without any bit, the mask has the bits with which
// write.abort switches it off. A brake may keep the drive enabled: of a move, only bits beyond write.enable count against it.
std::vector<Trigger> triggers_of(const RegisterMap& map, TableOperation starts, Axis axis, bool of_brake = false) {
  std::vector<Trigger> found;
  const std::vector<Written> enable = written_by(map, TableOperation::enable, axis);
  const std::vector<Written> abort = sent_by(map, TableOperation::abort, axis);
  for (const Written& written : triggers_of(written_by(map, starts, axis), starts)) {
    if (!written.value) continue;
    const Written* const on = left_in(enable, written.place);
    const Written* const off = starts == TableOperation::enable ? left_in(abort, written.place) : nullptr;
    std::uint16_t mask = written.word();
    if (mask == 0 && off != nullptr) mask = off->word();
    if (of_brake && (starts == TableOperation::enable || (mask & ~(on != nullptr ? on->word() : 0)) == 0)) mask = 0;
    found.push_back({written, written.is_code || mask == 0 ? whole_word : mask});
  }
  return found;
}

bool does(const Written& written, const Trigger& trigger) {
  if (written.place != trigger.written.place) return false;
  if (written.words.empty()) return !written.value;  // matches any number
  if (written.release && trigger.mask == whole_word) return false;
  return (written.word() & trigger.mask) == (trigger.written.word() & trigger.mask);
}

// True if both lists write different values to another register: they are different commands.
bool differ(const std::vector<Written>& one, const std::vector<Written>& other, const Register& trigger) {
  for (const Written& a : one) {
    if (a.place == trigger || !a.value) continue;
    const auto same_place = [&](const Written& b) { return b.place == a.place; };
    if (std::ranges::none_of(other, same_place)) continue;
    if (std::ranges::none_of(other, [&](const Written& b) { return same_place(b) && b.words == a.words; })) return true;
  }
  return false;
}

bool overlaps(const Written& one, const Written& other) {
  return one.place.first == other.place.first && one.place.second < other.place.second + other.registers &&
         other.place.second < one.place.second + one.registers;
}

// Returns a register or value in both notations: 1568 (0x620).
std::string both(long value) { return fmt::format("{} (0x{:X})", value, value); }

std::string said(const Register& place) { return "register " + both(place.second); }

// Returns the axis, and the address in the file if an offset was added.
std::string of_axis(const RegisterMap& map, Axis axis, const Written& written) {
  const int offset = written.of_table ? 0 : map.of(axis).address_offset;
  return " of axis." + std::string(to_string(axis)) +
         (offset == 0 ? "" : ", " + both(written.place.second - offset) + " without its address_offset");
}

constexpr TableOperation harmless[] = {TableOperation::setup, TableOperation::stop, TableOperation::abort,
                                       TableOperation::clear_fault};

// Writes that must not start anything.
struct Harmless {
  std::string key;
  std::vector<Written> sent;
  bool brakes = false;  // stops with the drive enabled
};

std::vector<Harmless> harmless_of(const RegisterMap& map, Axis axis) {
  std::vector<Harmless> all;
  for (const TableOperation operation : harmless) {
    const bool brakes =
        operation == TableOperation::stop || (operation == TableOperation::abort && !map.can_switch_off);
    all.push_back({"write." + std::string(to_string(operation)), sent_by(map, operation, axis), brakes});
  }
  if (!map.heartbeat_address) return all;
  const Register beat{map.of(axis).unit, map.heartbeat_at(axis)};
  Harmless heartbeat{map.heartbeat_values.empty() ? "heartbeat.address" : "heartbeat.values", {}};
  for (const std::uint16_t value : map.heartbeat_values)
    heartbeat.sent.push_back({.place = beat, .value = value, .words = {value}});
  if (heartbeat.sent.empty()) heartbeat.sent.push_back({.place = beat, .value = {}, .words = {}});
  all.push_back(std::move(heartbeat));
  return all;
}

// An enabled drive may follow its target register without any other command.
std::optional<Clash> target_clash_of(const RegisterMap& map, Axis of_move, Axis of_harmless) {
  const std::vector<Written> move = written_by(map, TableOperation::move, of_move);
  for (const Written& target : move) {
    if (!target.target) continue;
    for (const Harmless& other : harmless_of(map, of_harmless)) {
      for (const Written& written : other.sent) {
        if (overlaps(written, target) && !differ(move, other.sent, written.place))
          return Clash{other.key.starts_with("heartbeat") ? "heartbeat.address" : other.key,
                       "no write to " + said(target.place) + of_axis(map, of_move, target) +
                           ", where write.move says where to go: a drive that is on would start a motion; write "
                           "to another register, and leave the place to write.move"};
      }
    }
  }
  return std::nullopt;
}

std::optional<Clash> clash_of(const RegisterMap& map, Axis of_starting, Axis of_harmless) {
  for (const TableOperation starts : starting_operations) {
    const std::vector<Written> list = written_by(map, starts, of_starting);
    for (const Harmless& other : harmless_of(map, of_harmless)) {
      for (const Trigger& trigger : triggers_of(map, starts, of_starting, other.brakes)) {
        for (const Written& written : other.sent) {
          if (!does(written, trigger) || differ(list, other.sent, trigger.written.place)) continue;
          const Written& trigger_value = trigger.written;
          const bool same = !written.value || written.words == trigger_value.words;
          const std::string name = std::string("write.") + to_string(starts);
          const std::string value = both(written.value ? written.word() : trigger_value.word());
          std::string advice = "another value, without the bits " + both(trigger.mask);
          if (trigger.mask == whole_word) advice = "another value";
          if (other.key.starts_with("heartbeat")) advice = "a register of its own, or heartbeat.values without it";
          return Clash{other.key,
                       "no write of " + value + " to " + said(trigger_value.place) +
                           of_axis(map, of_starting, trigger_value) +
                           (same ? ", which is " + name
                                 : ", which holds the bits of " + name + ", " + both(trigger_value.word())) +
                           ": it would " + harm_of(starts) + "; write " + advice +
                           (trigger.mask == whole_word
                                ? ""
                                : ", or, if it takes the numbers of commands and not bits, name it in write.codes")};
        }
      }
    }
  }
  return std::nullopt;
}

// A counting heartbeat writes any number and continues after a stop, so it could revoke the stop.
std::optional<Clash> beats_over_a_stop(const RegisterMap& map, Axis axis) {
  if (!map.heartbeat_address || !map.heartbeat_values.empty()) return std::nullopt;
  const Written beat = harmless_of(map, axis).back().sent.front();
  for (const TableOperation operation : {TableOperation::stop, TableOperation::abort})
    for (const Written& written : sent_by(map, operation, axis))
      if (overlaps(written, beat))
        return Clash{"heartbeat.address", "a register of its own, not " + said(written.place) + ", where write." +
                                              to_string(operation) +
                                              " writes: the count would take it back; or heartbeat.values"};
  return std::nullopt;
}

// A stop that writes only to a register of another axis does not stop this one.
std::optional<Clash> stops_another(const RegisterMap& map, Axis axis, Axis other) {
  for (const TableOperation operation : {TableOperation::stop, TableOperation::abort}) {
    const std::string key = "write." + std::string(to_string(operation));
    if (map.once(operation) && map.of(axis).unit != map.of(other).unit)
      return Clash{key + ".scope", "axis, where every axis has a unit of its own"};
    const auto writes_to = [&](Axis whose, const Written& place) {
      for (const TableOperation list : all_operations) {
        const std::vector<Written> sent = sent_by(map, list, whose);
        if (std::ranges::any_of(sent, [&](const Written& w) { return !w.of_table && overlaps(w, place); })) return true;
      }
      return false;
    };
    for (const Written& written : sent_by(map, operation, axis)) {
      if (writes_to(other, written) && !writes_to(axis, written))
        return Clash{
            key, "a write to each axis; " + said(written.place) + " is that of axis." + to_string(other) + " alone"};
    }
  }
  return std::nullopt;
}

std::optional<Clash> same_axis(const RegisterMap& map, Axis one, Axis other) {
  const auto read_at = [&](Axis axis) {
    const RegisterField& position = map.of(axis).position;
    return Written{.place = {map.of(axis).unit, map.read_at(position.address, axis)},
                   .value = {},
                   .words = {},
                   .registers = register_count(position.type)};
  };
  const std::string key = "axis." + std::string(to_string(other)) + ".unit";
  const std::string apart =
      "a unit or an address_offset of its own, not those of axis." + std::string(to_string(one)) + ": ";
  if (overlaps(read_at(one), read_at(other))) return Clash{key, apart + "both read one position"};
  if (map.once(TableOperation::move)) return std::nullopt;
  const std::vector<Written> moves = written_by(map, TableOperation::move, one);
  for (const TableOperation starts : starting_operations) {
    const std::vector<Written> others = written_by(map, starts, other);
    for (const Written& a : moves)
      for (const Written& b : others)
        if (overlaps(a, b) && !(a.value && b.value) && !differ(moves, others, a.place))
          return Clash{key, apart + "one write.move moves both"};
  }
  return std::nullopt;
}

}  // namespace

void check_map(KeyValueFile& file, const RegisterMap& map) {
  check_addresses(file, map);
  check_status(file, map);
}

std::optional<Clash> write_clash(const RegisterMap& map) {
  for (const Axis one : all_axes) {
    for (const Axis other : all_axes) {
      if (one != other) {
        if (auto clash = same_axis(map, std::min(one, other), std::max(one, other))) return clash;
        if (auto clash = stops_another(map, one, other)) return clash;
      }
      if (auto clash = beats_over_a_stop(map, one)) return clash;
      if (auto clash = clash_of(map, one, other)) return clash;
      if (auto clash = target_clash_of(map, one, other)) return clash;
    }
  }
  return std::nullopt;
}

bool stop_holds_enable(const RegisterMap& map) {
  const std::vector<Written> stop = sent_by(map, TableOperation::stop, Axis::heading);
  const auto triggers = triggers_of(map, TableOperation::enable, Axis::heading);
  return std::ranges::any_of(triggers, [&](const Trigger& trigger) {
    const Written* const left = left_in(stop, trigger.written.place);
    return left != nullptr && does(*left, trigger);
  });
}

}  // namespace turncal
