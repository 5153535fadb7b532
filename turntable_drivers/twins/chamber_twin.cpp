#include "turntable_drivers/twins/chamber_twin.h"

#include <algorithm>

#include "imu_io/base/text.h"

namespace turncal {

double ChamberTwin::value_of(ChamberItem item, const ChamberStatus& now) const {
  const ChamberEntry& entry = *described_.of(item);
  if (item == ChamberItem::actual) return entry.scale * now.actual_c;
  if (item == ChamberItem::set_point) return entry.scale * now.set_point_c;
  return item == ChamberItem::on ? now.on : (item == ChamberItem::door ? now.door_open : now.alarm).value_or(false);
}

Status ChamberTwin::carry_out(ChamberItem item, double value) {
  if (item == ChamberItem::switch_on) return chamber_.on();
  if (item == ChamberItem::switch_off) return chamber_.off();
  value /= described_.of(item)->scale;
  if (item == ChamberItem::tell_set_point) return chamber_.set(value, ramp_c_per_min_);
  ramp_c_per_min_ = value;
  return {};
}

std::optional<AnswerPlan> ChamberTwin::next_registers(std::vector<std::uint8_t>& bytes) {
  const bool tcp = described_.modbus.header();
  const auto request = next_request(bytes, tcp);
  if (!request) return {};
  AnswerPlan plan;
  if (request->unit != described_.unit) return plan;
  const auto answers = [&](Frame frame) { plan.pieces.push_back({std::move(frame), 0.0}); };
  reads_ = request->function == described_.read_function;
  bool known = false;
  Status done;
  std::vector<std::uint16_t> values(std::size_t(request->count));
  const Result<ChamberStatus> now = chamber_.status();
  if (!now) done = now.error();
  for (std::size_t i = 0; i < described_.entries.size() && request->well_formed; ++i) {
    const auto item = static_cast<ChamberItem>(i);
    const auto& entry = described_.entries[i];
    if (!entry || is_read(item) != reads_ || (reads_ && !now)) continue;
    const RegisterField& field = entry->field;
    if (reads_) {
      const int at = field.address - request->address, count = register_count(field.type);
      if (at < 0 || at + count > request->count) continue;
      known = true;
      double value = value_of(item, *now);
      if (is_flag(item) && value != 0.0) {
        const double word =
            entry->true_values.empty() ? 1.0 : parse_whole<std::uint16_t>(entry->true_values[0]).value_or(1);
        value = word * double(entry->mask & -entry->mask);
      }
      if (const auto words = encode_words(value, field.type, described_.layout))
        for (int k = 0; k < count; ++k)  // several flags may share a register
          values[std::size_t(at + k)] |= words->value[std::size_t(k)];
    } else if (is_command(item)) {
      const auto same = [&](const WriteStep& step) {
        return step.address == request->address && words_of(described_, step) == request->values;
      };
      known = known || std::ranges::any_of(entry->writes, same);
      if (same(entry->writes.back())) done = carry_out(item, 0.0);
    } else if (field.address == request->address && register_count(field.type) == request->count) {
      known = true;
      done = carry_out(item, decode_words(request->values, field.type, described_.layout));
    }
  }
  if (!known || !done)
    answers(exception_reply(*request, done ? 2 : 4, tcp));
  else
    answers(reads_ ? read_reply(*request, values, tcp) : write_reply(*request, tcp));
  return plan;
}

std::optional<std::string> ChamberTwin::answer(const std::string& body) {
  for (std::size_t i = 0; i < described_.entries.size(); ++i) {
    const auto item = static_cast<ChamberItem>(i);
    const auto& entry = described_.entries[i];
    const auto told = entry ? entry->send.match(body) : std::nullopt;
    if (!told) continue;
    reads_ = is_read(item);
    const Result<ChamberStatus> now = chamber_.status();
    const auto value = told->find("value");
    const bool taken =
        reads_ ? now.ok()
               : carry_out(item, value != told->end() ? device_number(value->second).value_or(0.0) : 0.0).ok();
    if (!taken || !entry->expect) return {};
    return entry->expect->fill([&](const std::string& name) -> std::string {
      if (name != "value") return "0";
      const double number = value_of(item, *now);
      if (!is_flag(item)) return sentence_number(number, described_.decimals);
      return number != 0.0 ? entry->true_values.front() : "0";
    });
  }
  return {};
}

std::optional<AnswerPlan> ChamberTwin::next_answer(std::vector<std::uint8_t>& bytes) {
  std::optional<AnswerPlan> plan;
  {
    const std::lock_guard lock(held_);
    plan = described_.by_registers()
               ? next_registers(bytes)
               : answer_sentence(described_.ascii, bytes, [this](const std::string& body) { return answer(body); });
  }
  if (plan && disturb && !plan->pieces.empty()) disturb(reads_, *plan);
  return plan;
}

}  // namespace turncal
