#include "turntable_drivers/ascii/dialect_check.h"

#include <algorithm>

namespace turncal {
namespace {

bool agrees(const DialectStatus& status, const std::vector<DriveBit>& code, const DriveState& state) {
  for (int i = 0; i < drive_bit_count; ++i) {
    const auto bit = static_cast<DriveBit>(i);
    if (!status.reports(bit) || !state[bit]) continue;
    if ((std::find(code.begin(), code.end(), bit) != code.end()) != *state[bit]) return false;
  }
  return true;
}

// The flag that cannot be as a state needs it, since another one has its bit.
std::optional<DriveBit> crossed(const DialectStatus& status, const DriveState& state) {
  std::uint32_t set = 0, clear = 0;
  for (int i = 0; i < drive_bit_count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (status.mask[at] == 0 || !state.flags[at]) continue;
    (*state.flags[at] != status.active_low[at] ? set : clear) |= status.mask[at];
    if ((set & clear) != 0) return static_cast<DriveBit>(i);
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
    if (std::none_of(status.codes.begin(), status.codes.end(),
                     [&](const auto& code) { return agrees(status, code.second, state); }))
      file.reject("status.kind", state.expected);
  }
}

// What could stand in a number, or be one.
bool may_be_number(const std::string& text) {
  return !text.empty() && text.find_first_not_of("+-.0123456789") == std::string::npos;
}

// Every text that the device says must come through whole: none is what ends an answer, or is taken for an error.
void check_texts(KeyValueFile& file, const Dialect& dialect) {
  for (const std::string& error : dialect.errors)
    if (may_be_number(error)) file.reject("error.texts", "texts that no number holds");
  if (may_be_number(dialect.link.terminator_in)) file.reject("link.terminator_in", "a text that no number holds");
  if (may_be_number(dialect.link.prompt)) file.reject("link.prompt", "a text that no number holds");
  for (int i = 0; i < dialect_operation_count; ++i) {
    const auto operation = static_cast<DialectOperation>(i);
    const std::vector<Exchange>& exchanges = dialect.of(operation).exchanges;
    for (std::size_t k = 0; k < exchanges.size(); ++k) {
      const std::string key = std::string(to_string(operation)) + "." + std::to_string(k + 1);
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

// Position and status of every axis, and a rate to be told.
void check_quantities(KeyValueFile& file, const Dialect& dialect) {
  const auto says = [&](DialectOperation operation, bool answer, const std::string& quantity) {
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
    if (!says(DialectOperation::status, true, name))
      file.reject("status.1",
                  "an answer (status.1.expect) with {" + name + "}, or with {" + name + ".heading}, .pitch and .roll");
  }
  if (!says(DialectOperation::move, false, "rate")) file.reject("move.1", "{rate} in a sentence of a move");
}

}  // namespace

void check_dialect(KeyValueFile& file, const Dialect& dialect) {
  check_quantities(file, dialect);
  check_status(file, dialect.status);
  check_texts(file, dialect);
}

}  // namespace turncal
