// What a dialect makes of each operation, sentence by sentence.
#include <fmt/format.h>

#include "imu_io/base/format_number.h"
#include "turntable_drivers/ascii/dialect.h"

namespace turncal {
namespace {

constexpr std::size_t whole = std::string::npos;

std::string quantity_text(const Dialect& dialect, const std::string& name, Axis axis, bool asked) {
  const auto& [quantity, whose] = asked_by(name, axis);
  const DialectAxis& scale = dialect.of(whose);
  const auto per = [&](double factor, const char* unit) {
    return name + ": " + format_number(factor) + " per " + unit;
  };
  if (quantity == "position")
    return per(scale.signed_units(), "deg") + ", 0 at " + format_number(scale.zero_deg) + " deg" +
           (scale.modulo_deg > 0.0 ? ", a circle of " + format_number(scale.modulo_deg) + " deg" : "") +
           (scale.shorter_way && asked ? ", gone the shorter way" : "");
  if (quantity == "distance") return per(scale.signed_units(), "deg");
  if (quantity == "rate") return per(asked ? scale.rate_scale : scale.sign * scale.measured_rate_scale, "deg/s");
  if (quantity == "acceleration") return per(scale.acceleration_scale, "deg/s^2");
  return "";
}

std::string quantities_of(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, bool asked) {
  std::string text;
  for (const std::string& name : sentence.names()) {
    const std::string one = quantity_text(dialect, name, axis, asked);
    if (!one.empty()) text += (text.empty() ? "" : "; ") + one;
  }
  return text;
}

std::string answer_of(const Dialect& dialect, const Exchange& exchange) {
  const DialectLink& link = dialect.link;
  std::string text = link.echo ? "its echo, " : "";
  if (exchange.expect) {
    const std::string digits = link.check == SentenceCheck::crc16 ? "CCCC" : "CC";
    const std::string open = link.prefix + exchange.expect->text() + link.check_mark + digits;
    const bool fixed = exchange.expect->names().empty() || link.check == SentenceCheck::none;
    text += visible((fixed ? frame_of(link, exchange.expect->text()) : open) + link.terminator_in, whole);
  } else {
    text += "nothing";
  }
  return text + (link.prompt.empty() ? "" : ", then '" + visible(link.prompt) + "'");
}

void explain_steps(const Dialect& dialect, TableOperation operation, const std::string& name,
                   std::vector<TableRow>& rows) {
  const DialectSteps& steps = dialect.of(operation);
  const bool once = !steps.each_axis && operation != TableOperation::move;
  for (const Axis axis : all_axes) {
    if (once && axis != Axis::heading) break;
    Moves moves{};
    moves[index(axis)] = shown_move;
    for (std::size_t i = 0; i < steps.exchanges.size(); ++i) {
      const Exchange& exchange = steps.exchanges[i];
      const std::string key = fmt::format("{}.{}", key_of(operation), i + 1);
      std::string says = quantities_of(dialect, exchange.send, axis, true);
      if (says.empty() && exchange.expect) says = quantities_of(dialect, *exchange.expect, axis, false);
      rows.push_back(
          {name, once ? "table" : to_string(axis),
           visible(frame_of(dialect.link, filled(dialect, exchange.send, axis, moves)) + dialect.link.terminator_out,
                   whole),
           says, answer_of(dialect, exchange), source_of(dialect, key)});
    }
  }
}

void explain_flags(const Dialect& dialect, std::vector<TableRow>& rows) {
  const DialectStatus& status = dialect.status;
  for (const DriveBit bit : all_drive_bits) {
    const std::size_t at = index(bit);
    if (!status.by_bits || status.mask[at] == 0) continue;
    const std::string flag = to_string(bit);
    const bool several = (status.mask[at] & (status.mask[at] - 1)) != 0;
    rows.push_back({"status", "each", fmt::format("  its status word, base {}", status.base),
                    fmt::format("{}: mask 0x{:08X}{} {}", flag, status.mask[at], several ? ", one of it" : ",",
                                status.active_low[at] ? "clear" : "set"),
                    "", source_of(dialect, "status.bit." + flag)});
  }
  for (const auto& [code, flags] : status.codes) {
    std::string names;
    for (const DriveBit flag : flags) names += (names.empty() ? "" : ", ") + std::string(to_string(flag));
    rows.push_back({"status", "each", "  its status word", visible(code) + ": " + (names.empty() ? "none" : names), "",
                    source_of(dialect, "status.code." + code)});
  }
}

}  // namespace

std::vector<TableRow> explain(const Dialect& dialect) {
  std::vector<TableRow> rows;
  for (const auto& [operation, name] : shown_operations) {
    explain_steps(dialect, operation, name, rows);
    if (operation == TableOperation::status) explain_flags(dialect, rows);
  }
  return rows;
}

}  // namespace turncal
