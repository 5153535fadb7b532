#include "turntable_drivers/twins/dialect_twin.h"
#include "imu_io/base/text_pieces.h"
#include "turntable_drivers/table/drive_rules.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace turncal {
namespace {

// Operations in the order in which a sentence is looked for: what several share is the gentlest.
constexpr std::array<DialectOperation, dialect_operation_count> search_order = {
    DialectOperation::status,  DialectOperation::stop,     DialectOperation::abort,
    DialectOperation::move,    DialectOperation::home,     DialectOperation::enable,
    DialectOperation::prepare, DialectOperation::identify, DialectOperation::clear_fault};

}  // namespace

Status DialectTwin::power_on() {
  TRY(table_.connect());
  return dialect_.of(DialectOperation::enable).exchanges.empty() ? table_.enable() : Status();
}

std::optional<std::string> DialectTwin::refusal() const {
  if (dialect_.errors.empty()) return {};
  return dialect_.errors.front();
}

std::optional<std::string> DialectTwin::answer(const std::string& body) {
  std::optional<std::string> said;
  bool known = false;
  for (const DialectOperation operation : search_order) {
    const std::vector<Exchange>& exchanges = dialect_.of(operation).exchanges;
    std::size_t& progress = progress_[static_cast<std::size_t>(operation)];
    for (std::size_t i = 0; i < exchanges.size(); ++i) {
      if (i != 0 && i != progress) continue;
      const std::optional<Values> values = exchanges[i].send.match(body);
      // What ends one list may be on the way of another: that one goes on, and only the first is carried out.
      if (!values || (known && i + 1 == exchanges.size())) continue;
      progress = i + 1 == exchanges.size() ? 0 : i + 1;
      const std::optional<std::string> text = answer_of(operation, i, *values);
      if (!known) said = text;
      known = true;
      break;
    }
  }
  return known ? said : refusal();
}

std::optional<std::string> DialectTwin::answer_of(DialectOperation operation, std::size_t step, const Values& values) {
  Values& pending = pending_[static_cast<std::size_t>(operation)];
  if (step == 0) pending.clear();
  for (const auto& [name, value] : values) pending[name] = value;
  Axis axis = Axis::heading;
  if (const auto named = pending.find("axis"); named != pending.end()) {
    const auto place =
        std::find_if(all_axes.begin(), all_axes.end(), [&](Axis a) { return dialect_.of(a).name == named->second; });
    if (place == all_axes.end()) return refusal();
    axis = *place;
  }
  const std::vector<Exchange>& exchanges = dialect_.of(operation).exchanges;
  if (step + 1 == exchanges.size()) {
    if (Status done = carry_out(operation, axis, pending); !done) return refusal();
  }
  if (!exchanges[step].expect) return {};
  return exchanges[step].expect->fill([&](const std::string& name) { return value_of(name, axis); });
}

std::string DialectTwin::value_of(const std::string& name, Axis axis) {
  if (name == "*") return "0";
  if (name == "axis") return dialect_.of(axis).name;
  std::string quantity = name;
  for (const Axis other : all_axes) {
    const std::string suffix = std::string(".") + to_string(other);
    if (!name.ends_with(suffix)) continue;
    axis = other;
    quantity = name.substr(0, name.size() - suffix.size());
  }
  const Result<AxisStatus> now = table_.status(axis);
  if (!now) return "?";
  const DialectAxis& scale = dialect_.of(axis);
  char text[64];
  if (quantity == "status") {
    return word_of(dialect_.status, {now->enabled, now->in_position, now->fault, now->moving, now->homed, now->limit,
                                     now->limit, now->emergency_stop, now->remote});
  }
  double value = scale.measured_rate_scale * now->rate_degps;
  if (quantity == "position") {
    double angle_deg = scale.sign * (now->position_deg - scale.zero_deg);
    if (scale.modulo_deg > 0.0) angle_deg -= scale.modulo_deg * std::floor(angle_deg / scale.modulo_deg);
    value = scale.sign * scale.units_per_degree * angle_deg;
  }
  std::snprintf(text, sizeof text, dialect_.plus ? "%+.*f" : "%.*f", dialect_.decimals, scale.sign * value);
  return text;
}

Status DialectTwin::carry_out(DialectOperation operation, Axis axis, const Values& values) {
  switch (operation) {
    case DialectOperation::prepare:
    case DialectOperation::identify:
    case DialectOperation::status: return {};
    case DialectOperation::enable: return table_.enable();
    case DialectOperation::stop: target_deg_ = {}; return table_.stop_all();
    case DialectOperation::abort: target_deg_ = {}; return table_.abort_all();
    case DialectOperation::clear_fault: return table_.clear_fault();
    case DialectOperation::home: {
      target_deg_ = {};
      if (!dialect_.of(DialectOperation::home).each_axis) return table_.home();
      // The first axis of a round starts them all.
      bool& done = homed_round_[index(axis)];
      if (done) homed_round_ = {};
      const bool begins = homed_round_ == std::array<bool, 3>{};
      done = true;
      return begins ? table_.home() : Status();
    }
    case DialectOperation::move: return move(axis, values);
  }
  return {};
}

Status DialectTwin::move(Axis axis, const Values& values) {
  for (const Axis which : all_axes) {
    const std::string suffix = std::string(".") + to_string(which);
    const auto number = [&](const std::string& quantity) -> std::optional<double> {
      auto place = values.find(quantity + suffix);
      if (place == values.end() && which == axis) place = values.find(quantity);
      if (place == values.end()) return {};
      return device_number(place->second);
    };
    const DialectAxis& scale = dialect_.of(which);
    const std::optional<double> position = number("position"), distance = number("distance");
    if (!position && (!distance || *distance == 0.0)) continue;
    // A sentence for all three axes leaves those alone that are there, or on their way.
    const AxisStatus now = TRY(table_.status(which));
    double target_deg = position ? scale.sign * *position / scale.units_per_degree + scale.zero_deg
                                 : now.position_deg + scale.sign * *distance / scale.units_per_degree;
    if (position && scale.shorter_way) target_deg = unwrapped_deg(target_deg, now.position_deg, scale.modulo_deg);
    const bool for_all_axes = position && values.count("position") == 0;
    const double from_deg = target_deg_[index(which)].value_or(now.position_deg);
    if (for_all_axes && (std::abs(from_deg - target_deg) < 1e-3 || std::abs(now.position_deg - target_deg) < 1e-3))
      continue;
    target_deg_[index(which)] = target_deg;
    const double rate_degps = number("rate").value_or(10.0 * scale.rate_scale) / scale.rate_scale;
    const double acceleration_degps2 =
        number("acceleration").value_or(20.0 * scale.acceleration_scale) / scale.acceleration_scale;
    TRY(table_.move_absolute(which, target_deg, rate_degps, acceleration_degps2));
  }
  return {};
}

std::optional<AnswerPlan> DialectServer::next_answer(std::vector<std::uint8_t>& bytes) {
  const DialectLink& link = twin_.dialect().link;
  const auto end = std::search(bytes.begin(), bytes.end(), link.terminator_out.begin(), link.terminator_out.end());
  if (end == bytes.end()) return {};
  const std::string frame(bytes.begin(), end);
  bytes.erase(bytes.begin(), end + static_cast<std::ptrdiff_t>(link.terminator_out.size()));
  AnswerPlan plan;
  if (!frame.starts_with(link.prefix)) return plan;
  std::string body = frame.substr(link.prefix.size());
  if (link.check != SentenceCheck::none) {
    const std::size_t digit_count = link.check == SentenceCheck::crc16 ? 4 : 2;
    const std::size_t tail = link.check_mark.size() + digit_count;
    if (body.size() < tail) return plan;
    const std::string digits = body.substr(body.size() - digit_count);
    body.resize(body.size() - tail);
    if (digits != check_digits(body, link.check, link.crc)) return plan;
  }
  std::optional<std::string> answer;
  {
    const std::lock_guard lock(mutex);
    answer = twin_.answer(body);
  }
  std::string text = link.echo ? frame + link.echo_terminator : "";
  for (std::string_view remaining = answer ? *answer : std::string_view(); answer;) {
    const std::size_t line_end = remaining.find('\n');
    const std::string line(remaining.substr(0, line_end));
    text += link.prefix + line;
    if (link.check != SentenceCheck::none) text += link.check_mark + check_digits(line, link.check, link.crc);
    text += link.terminator_in;
    if (line_end == std::string_view::npos) break;
    remaining.remove_prefix(line_end + 1);
  }
  text += link.prompt;
  if (!text.empty()) plan.pieces.push_back({{text.begin(), text.end()}, 0.0});
  if (disturb) disturb(body, plan);
  return plan;
}

}  // namespace turncal
