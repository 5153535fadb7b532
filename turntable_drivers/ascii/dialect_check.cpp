// Checks that a dialect can express what a run needs, and that no sentence has an unintended effect.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <iterator>

#include "imu_io/base/text.h"
#include "turntable_drivers/ascii/dialect.h"

namespace turncal {
namespace {

bool agrees(const DialectStatus& status, const std::vector<DriveBit>& code, const DriveState& state) {
  for (const DriveBit bit : all_drive_bits) {
    if (!status.reports(bit) || !state[bit]) continue;
    if ((std::ranges::find(code, bit) != code.end()) != *state[bit]) return false;
  }
  return true;
}

// Returns the flag that cannot have the value required by a state, because another flag has the same bit.
std::optional<DriveBit> crossed(const DialectStatus& status, const DriveState& state) {
  std::uint32_t set = 0, clear = 0;
  for (const DriveBit bit : all_drive_bits) {
    const std::size_t at = index(bit);
    if (status.mask[at] == 0 || !state.flags[at]) continue;
    (*state.flags[at] != status.active_low[at] ? set : clear) |= status.mask[at];
    if ((set & clear) != 0) return bit;
  }
  return {};
}

void check_status(KeyValueFile& file, const DialectStatus& status) {
  for (const DriveState& state : drive_states(status.reports(DriveBit::homed))) {
    if (status.by_bits) {
      if (const auto bit = crossed(status, state))
        file.reject(std::string("status.bit.") + to_string(*bit), state.expected);
      continue;
    }
    if (std::ranges::none_of(status.codes, [&](const auto& code) { return agrees(status, code.second, state); }))
      file.reject("status.kind", state.expected);
  }
}

// True for text that may be a number or part of one.
bool may_be_number(const std::string& text) {
  return !text.empty() && text.find_first_not_of("+-.0123456789") == std::string::npos;
}

// Checks that every text of the device arrives intact: no number may look like the end of an answer or like an error.
void check_texts(KeyValueFile& file, const Dialect& dialect) {
  for (const std::string& error : dialect.errors)
    if (may_be_number(error)) file.reject("error.texts", "texts that no number holds");
  if (may_be_number(dialect.link.terminator_in)) file.reject("link.terminator_in", "a text that no number holds");
  if (may_be_number(dialect.link.prompt)) file.reject("link.prompt", "a text that no number holds");
  for (const TableOperation operation : all_operations) {
    const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
    for (std::size_t k = 0; k < exchanges.size(); ++k) {
      const std::string key = fmt::format("{}.{}", key_of(operation), k + 1);
      const auto& expect = exchanges[k].expect;
      const std::string literal = expect ? expect->fill([](const std::string&) { return ""; }) : "";
      if (literal.find(dialect.link.terminator_in) != std::string::npos && expect->lines() == 1)
        file.reject(key + ".expect", "an answer without link.terminator_in, which ends it");
      for (const std::string& error : dialect.errors)
        if (literal.find(error) != std::string::npos)
          file.reject(key + ".expect", "an answer without '" + error + "', which is one of error.texts");
      for (const SentenceTemplate* sentence : {&exchanges[k].send, expect ? &*expect : nullptr}) {
        const std::size_t room = sentence != nullptr ? sentence->width_of("axis") : 0;
        for (const DialectAxis& axis : dialect.axis)
          if (room > 0 && axis.name.size() > room)
            file.reject(sentence == &exchanges[k].send ? key : key + ".expect",
                        "a column that the name of an axis fits: '" + axis.name + "'");
      }
    }
  }
}

// Checks that status reports the position and status of every axis, and that a move sends its rate.
void check_quantities(KeyValueFile& file, const Dialect& dialect) {
  const auto says = [&](TableOperation operation, bool answer, const std::string& quantity) {
    std::size_t axes = 0;
    for (const Exchange& exchange : dialect.of(operation).exchanges) {
      const SentenceTemplate* const sentence = !answer ? &exchange.send : exchange.expect ? &*exchange.expect : nullptr;
      if (sentence == nullptr) continue;
      if (sentence->has(quantity)) return true;
      for (const Axis axis : all_axes) axes += sentence->has(quantity + "." + to_string(axis)) ? 1 : 0;
    }
    return axes >= all_axes.size();
  };
  for (const char* const quantity : {"position", "status"}) {
    const std::string name = quantity;
    if (!says(TableOperation::status, true, name))
      file.reject("status.1",
                  "an answer (status.1.expect) with {" + name + "}, or with {" + name + ".heading}, .pitch and .roll");
  }
  if (!says(TableOperation::move, false, "rate")) file.reject("move.1", "{rate} in a sentence of a move");
}

// ---- sentences ----

constexpr TableOperation harmless[] = {TableOperation::setup, TableOperation::identify, TableOperation::status,
                                       TableOperation::stop,  TableOperation::abort,    TableOperation::clear_fault};

// Normalises a command as controllers read it: capitals, single blanks, numbers without plus, leading zeros or a zero fraction. Placeholders stay.
std::string plain(std::string_view command) {
  std::string text;
  bool inside = false;
  for (std::size_t k = 0; k < command.size(); ++k) {
    const unsigned char c = static_cast<unsigned char>(command[k]);
    if (c == '{') inside = true;
    if (inside) {
      text += command[k];
      if (c == '}') inside = false;
      continue;
    }
    const bool after_number =
        !text.empty() && (std::isdigit(static_cast<unsigned char>(text.back())) || text.back() == '.');
    const bool more_digits = k + 1 < command.size() && std::isdigit(static_cast<unsigned char>(command[k + 1]));
    if (c == '0' && !after_number && more_digits) continue;
    if (c == '+' && more_digits && (text.empty() || !std::isalnum(static_cast<unsigned char>(text.back())))) continue;
    if (c == '.' && after_number) {
      const std::size_t end = std::min(command.find_first_not_of('0', k + 1), command.size());
      if (end == command.size() || !std::isdigit(static_cast<unsigned char>(command[end]))) {
        k = end - 1;
        continue;
      }
    }
    if (std::isspace(c)) {
      const bool needless = text.empty() || text.back() == ' ' || text.back() == ',';
      if (!needless) text += ' ';
      continue;
    }
    if (c == ',' && !text.empty() && text.back() == ' ') text.pop_back();
    text += char(std::toupper(c));
  }
  return text;
}

// Returns the commands of a sentence for an axis; quantities of a move stay placeholders.
std::vector<std::string> commands_of(const Exchange& exchange, const std::string& axis_name) {
  std::string text = exchange.send.text();
  const std::string placeholder = "{axis";
  for (std::size_t at = text.find(placeholder); at != std::string::npos; at = text.find(placeholder, at)) {
    text.replace(at, text.find('}', at) + 1 - at, axis_name);
    at += axis_name.size();
  }
  std::vector<std::string> commands;
  for (std::size_t from = 0; from <= text.size();) {
    const std::size_t end = std::min(text.find(';', from), text.size());
    const std::string command = plain(trimmed(std::string_view(text).substr(from, end - from)));
    if (!command.empty()) commands.push_back(command);
    from = end + 1;
  }
  return commands;
}

bool goes_somewhere(const std::string& command) {
  return command.find("{position") != std::string::npos || command.find("{distance") != std::string::npos;
}

std::vector<std::string> triggers_of(const Dialect& dialect, TableOperation operation, const std::string& axis_name) {
  std::vector<std::string> triggers, last;
  for (const Exchange& exchange : dialect.of(operation).exchanges) {
    const std::vector<std::string> commands = commands_of(exchange, axis_name);
    if (exchange.send.text().find('?') == std::string::npos) last = commands;
    if (operation != TableOperation::move) continue;
    std::ranges::copy_if(commands, std::back_inserter(triggers), goes_somewhere);
  }
  triggers.insert(triggers.end(), last.begin(), last.end());
  return triggers;
}

bool sends(const std::string& command, const std::string& trigger) {
  if (command == trigger) return true;
  const auto pattern = SentenceTemplate::parse(trigger);
  return pattern && pattern->match(command).has_value();
}

// Rejects a target anywhere but in a move.
std::optional<Clash> place_in(const Dialect& dialect, Axis axis) {
  for (const TableOperation operation : harmless) {
    const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
    for (std::size_t i = 0; i < exchanges.size(); ++i)
      for (const std::string& command : commands_of(exchanges[i], dialect.of(axis).name))
        if (goes_somewhere(command))
          return Clash{fmt::format("{}.{}", key_of(operation), i + 1),
                       "no {position} or {distance}: where to go is for the sentences of move to say, another could "
                       "start a motion"};
  }
  return std::nullopt;
}

std::optional<Clash> clash_of(const Dialect& dialect, Axis of_starting, Axis of_harmless) {
  for (const TableOperation starts : starting_operations) {
    for (const std::string& trigger : triggers_of(dialect, starts, dialect.of(of_starting).name)) {
      for (const TableOperation operation : harmless) {
        const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
        for (std::size_t i = 0; i < exchanges.size(); ++i) {
          for (const std::string& command : commands_of(exchanges[i], dialect.of(of_harmless).name)) {
            if (!sends(command, trigger)) continue;
            return Clash{fmt::format("{}.{}", key_of(operation), i + 1),
                         fmt::format("no '{}', which is {} of axis.{}: it would {}; send it in {} alone", command,
                                     to_string(starts), to_string(of_starting), harm_of(starts), to_string(starts))};
          }
        }
      }
    }
  }
  return std::nullopt;
}

}  // namespace

void check_dialect(KeyValueFile& file, const Dialect& dialect) {
  check_quantities(file, dialect);
  check_status(file, dialect.status);
  check_texts(file, dialect);
}

bool moves_all(const Dialect& dialect) {
  const std::vector<Exchange>& move = dialect.of(TableOperation::move).exchanges;
  return std::ranges::any_of(move, [](const Exchange& exchange) {
    return exchange.send.has("position.roll") || exchange.send.has("distance.roll");
  });
}

std::optional<Clash> sentence_clash(const Dialect& dialect) {
  for (const Axis one : all_axes) {
    if (auto clash = place_in(dialect, one)) return clash;
    for (const Axis other : all_axes) {
      if (index(one) < index(other) && plain(dialect.of(one).name) == plain(dialect.of(other).name) &&
          !moves_all(dialect)) {
        return Clash{
            "axis." + std::string(to_string(other)) + ".name",
            "a name of its own, not that of axis." + std::string(to_string(one)) + ": one move would move both"};
      }
      if (auto clash = clash_of(dialect, one, other)) return clash;
    }
  }
  return std::nullopt;
}

}  // namespace turncal
