#include "turntable_drivers/modbus/write_step.h"

#include <charconv>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

// position, rate.pitch, ...
bool read_quantity(std::string_view text, WriteOperand& operand) {
  for (const Axis axis : all_axes) {
    const std::string suffix = std::string(".") + to_string(axis);
    if (!text.ends_with(suffix)) continue;
    operand.of_axis = axis;
    text.remove_suffix(suffix.size());
    break;
  }
  constexpr std::pair<std::string_view, WriteOperand::Kind> names[] = {
      {"position", WriteOperand::Kind::position},
      {"distance", WriteOperand::Kind::distance},
      {"rate", WriteOperand::Kind::rate},
      {"acceleration", WriteOperand::Kind::acceleration}};
  for (const auto& [name, kind] : names) {
    if (text != name) continue;
    operand.kind = kind;
    return true;
  }
  return false;
}

// TYPE VALUE
std::optional<WriteOperand> operand_of(std::string_view text) {
  const auto words = split_words(text);
  if (words.size() != 2) return {};
  const std::optional<WordType> type = word_type_of(words[0]);
  if (!type) return {};
  WriteOperand operand;
  operand.type = *type;
  if (words[1] == "axis") {
    operand.kind = WriteOperand::Kind::axis;
  } else if (read_quantity(words[1], operand)) {
    return operand;
  } else if (const auto number = whole_number(words[1])) {
    operand.constant = static_cast<double>(*number);
  } else if (const auto real = parse_number(words[1])) {
    operand.constant = *real;
  } else {
    return {};
  }
  return operand;
}

}  // namespace

int WriteStep::length() const {
  int count = 0;
  for (const WriteOperand& operand : operands) count += register_count(operand.type);
  return count;
}

std::optional<long> whole_number(std::string_view text) {
  int base = 10;
  if (text.starts_with("0x") || text.starts_with("0X")) {
    text.remove_prefix(2);
    base = 16;
  }
  long value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (text.empty() || result.ec != std::errc{} || result.ptr != text.data() + text.size()) return {};
  return value;
}

std::optional<WriteStep> parse_write_step(std::string_view text) {
  WriteStep step;
  auto words = split_words(text);
  if (words.size() == 2 && words[0] == "wait") {
    const auto seconds = parse_number(words[1]);
    if (!seconds || !(*seconds > 0.0 && *seconds <= longest_pause_s)) return {};
    step.wait_s = *seconds;
    return step;
  }
  step.of_table = !words.empty() && words[0] == "table";
  if (step.of_table) {
    text = trimmed(text.substr(words[0].size()));
    words.erase(words.begin());
  }
  if (words.empty()) return {};
  const auto address = whole_number(words[0]);
  if (!address || *address < 0 || *address > 65535) return {};
  step.address = static_cast<int>(*address);
  for (const std::string_view part : split(text.substr(words[0].size()), '+')) {
    const auto operand = operand_of(part);
    if (!operand) return {};
    step.operands.push_back(*operand);
  }
  if (step.length() > longest_block || step.address + step.length() > 65536) return {};
  return step;
}

}  // namespace turncal
