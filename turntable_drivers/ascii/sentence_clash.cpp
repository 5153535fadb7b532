#include "turntable_drivers/ascii/sentence_clash.h"

#include <algorithm>
#include <cctype>
#include <vector>

#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

constexpr DialectOperation starting[] = {DialectOperation::enable, DialectOperation::home, DialectOperation::move};
constexpr DialectOperation harmless[] = {DialectOperation::prepare, DialectOperation::identify,
                                         DialectOperation::status,  DialectOperation::stop,
                                         DialectOperation::abort,   DialectOperation::clear_fault};

// As controllers read it: capitals, one blank, numbers without plus, leading zeros and a fraction of zeros. Placeholders stay.
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
    text += static_cast<char>(std::toupper(c));
  }
  return text;
}

// The commands of a sentence for an axis; what is not known before a move stays a placeholder.
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

std::vector<std::string> triggers_of(const Dialect& dialect, DialectOperation operation, const std::string& axis_name) {
  std::vector<std::string> triggers, last;
  for (const Exchange& exchange : dialect.of(operation).exchanges) {
    const std::vector<std::string> commands = commands_of(exchange, axis_name);
    if (exchange.send.text().find('?') == std::string::npos) last = commands;
    if (operation != DialectOperation::move) continue;
    std::copy_if(commands.begin(), commands.end(), std::back_inserter(triggers), goes_somewhere);
  }
  triggers.insert(triggers.end(), last.begin(), last.end());
  return triggers;
}

bool sends(const std::string& command, const std::string& trigger) {
  if (command == trigger) return true;
  const auto pattern = SentenceTemplate::parse(trigger);
  return pattern && pattern->match(command).has_value();
}

// Where to go is a move's to say.
std::optional<SentenceClash> place_in(const Dialect& dialect, Axis axis) {
  for (const DialectOperation operation : harmless) {
    const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
    for (std::size_t i = 0; i < exchanges.size(); ++i)
      for (const std::string& command : commands_of(exchanges[i], dialect.of(axis).name))
        if (goes_somewhere(command))
          return SentenceClash{
              to_string(operation) + std::string(".") + std::to_string(i + 1),
              "no {position} or {distance}: where to go is for the sentences of move to say, another could "
              "start a motion"};
  }
  return std::nullopt;
}

std::optional<SentenceClash> clash_of(const Dialect& dialect, Axis of_starting, Axis of_harmless) {
  for (const DialectOperation starts : starting) {
    for (const std::string& trigger : triggers_of(dialect, starts, dialect.of(of_starting).name)) {
      for (const DialectOperation operation : harmless) {
        const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
        for (std::size_t i = 0; i < exchanges.size(); ++i) {
          for (const std::string& command : commands_of(exchanges[i], dialect.of(of_harmless).name)) {
            if (!sends(command, trigger)) continue;
            return SentenceClash{to_string(operation) + std::string(".") + std::to_string(i + 1),
                                 "no '" + command + "', which is " + to_string(starts) + " of axis." +
                                     to_string(of_starting) + ": it would " +
                                     (starts == DialectOperation::enable ? "switch the drive on"
                                      : starts == DialectOperation::home ? "start a homing"
                                                                         : "start a motion") +
                                     "; send it in " + to_string(starts) + " alone"};
          }
        }
      }
    }
  }
  return std::nullopt;
}

// A sentence that tells each axis its own place tells them apart, whatever they are called.
bool tells_of_all(const Dialect& dialect) {
  const std::vector<Exchange>& move = dialect.of(DialectOperation::move).exchanges;
  return std::any_of(move.begin(), move.end(), [](const Exchange& exchange) {
    return exchange.send.has("position.roll") || exchange.send.has("distance.roll");
  });
}

}  // namespace

std::optional<SentenceClash> sentence_clash(const Dialect& dialect) {
  for (const Axis one : all_axes) {
    if (auto clash = place_in(dialect, one)) return clash;
    for (const Axis other : all_axes) {
      if (index(one) < index(other) && plain(dialect.of(one).name) == plain(dialect.of(other).name) &&
          !tells_of_all(dialect)) {
        return SentenceClash{
            "axis." + std::string(to_string(other)) + ".name",
            "a name of its own, not that of axis." + std::string(to_string(one)) + ": one move would move both"};
      }
      if (auto clash = clash_of(dialect, one, other)) return clash;
    }
  }
  return std::nullopt;
}

}  // namespace turncal
