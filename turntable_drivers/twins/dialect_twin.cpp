#include "turntable_drivers/twins/dialect_twin.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {
namespace {

// The order in which operations are searched for a sentence: if several share it, the gentlest comes first.
constexpr std::array<TableOperation, table_operation_count> search_order = {
    TableOperation::status, TableOperation::stop,     TableOperation::abort,
    TableOperation::move,   TableOperation::home,     TableOperation::enable,
    TableOperation::setup,  TableOperation::identify, TableOperation::clear_fault};

// Returns the status word closest to these flags. A device that knows only moving and done says done after a stop.
std::string word_of(const DialectStatus& status, const DriveFlags& flags) {
  if (status.by_bits) {
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < flags.size(); ++i)
      if (flags[i] != status.active_low[i]) bits |= status.mask[i];
    return status.base == 16 ? fmt::format("{:x}", bits) : std::to_string(bits);
  }
  std::string best;
  int best_score = std::numeric_limits<int>::min();
  for (const auto& [code, named] : status.codes) {
    const int score = likeness(flags, [&, &named = named](std::size_t i) -> std::optional<bool> {
      const auto bit = static_cast<DriveBit>(i);
      if (!status.reports(bit)) return {};
      return std::ranges::find(named, bit) != named.end();
    });
    if (score <= best_score) continue;
    best_score = score;
    best = code;
  }
  return best;
}

}  // namespace

Status DialectTwin::power_on() { return table_.power_on(dialect_.of(TableOperation::enable).exchanges.empty()); }

std::optional<std::string> DialectTwin::refusal() const {
  if (dialect_.errors.empty()) return {};
  return dialect_.errors.front();
}

std::optional<std::string> DialectTwin::answer(const std::string& body) {
  std::optional<std::string> said;
  bool known = false;
  for (const TableOperation operation : search_order) {
    const std::vector<Exchange>& exchanges = dialect_.of(operation).exchanges;
    std::size_t& progress = progress_[std::size_t(operation)];
    for (std::size_t i = 0; i < exchanges.size(); ++i) {
      if (i != 0 && i != progress) continue;
      const std::optional<Values> values = exchanges[i].send.match(body);
      // The end of one list may be a step of another: that one continues, and only the first is carried out.
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

std::optional<std::string> DialectTwin::answer_of(TableOperation operation, std::size_t step, const Values& values) {
  Values& pending = pending_[std::size_t(operation)];
  if (step == 0) pending.clear();
  for (const auto& [name, value] : values) pending[name] = value;
  Axis axis = Axis::heading;
  if (const auto named = pending.find("axis"); named != pending.end()) {
    const auto place = std::ranges::find_if(all_axes, [&](Axis a) { return dialect_.of(a).name == named->second; });
    if (place == all_axes.end()) return refusal();
    axis = *place;
  }
  const std::vector<Exchange>& exchanges = dialect_.of(operation).exchanges;
  if (step + 1 == exchanges.size()) {
    const Status done = operation == TableOperation::move
                            ? move(axis, pending)
                            : table_.carry_out(operation, axis, !dialect_.of(operation).each_axis);
    if (!done) return refusal();
  }
  if (!exchanges[step].expect) return {};
  return exchanges[step].expect->fill([&](const std::string& name) { return value_of(name, axis); });
}

std::string DialectTwin::value_of(const std::string& name, Axis axis) {
  if (name == "*") return "0";
  if (name == "axis") return dialect_.of(axis).name;
  const Asked asked = asked_by(name, axis);
  const Result<AxisStatus> now = table_.status(asked.axis);
  if (!now) return "?";
  if (asked.status) return word_of(dialect_.status, flags_of(*now));
  const DialectAxis& scale = dialect_.of(asked.axis);
  double value = scale.measured_rate_scale * now->rate_degps;
  if (asked.number == MoveQuantity::position) {
    double angle_deg = scale.sign * (now->position_deg - scale.zero_deg);
    if (scale.modulo_deg > 0.0) angle_deg -= scale.modulo_deg * std::floor(angle_deg / scale.modulo_deg);
    value = scale.signed_units() * angle_deg;
  }
  value *= scale.sign;
  return dialect_.plus ? fmt::format("{:+.{}f}", value, dialect_.decimals)
                       : fmt::format("{:.{}f}", value, dialect_.decimals);
}

Status DialectTwin::move(Axis axis, const Values& values) {
  for (const Axis which : all_axes) {
    const DialectAxis& scale = dialect_.of(which);
    Told told;
    for (const auto& [name, text] : values) {
      const Asked asked = asked_by(name, axis);
      const std::optional<double> number = device_number(text);
      if (asked.number && asked.axis == which && number) told.take(*asked.number, *number, scale);
    }
    TRY(table_.move(which, scale, told, values.count("position") + values.count("distance") == 0, 1e-3));
  }
  return {};
}

std::optional<AnswerPlan> answer_sentence(
    const DialectLink& link, std::vector<std::uint8_t>& bytes,
    const std::function<std::optional<std::string>(const std::string& body)>& answer_of) {
  const auto end = std::search(bytes.begin(), bytes.end(), link.terminator_out.begin(), link.terminator_out.end());
  if (end == bytes.end()) return {};
  const std::string frame(bytes.begin(), end);
  bytes.erase(bytes.begin(), end + std::ptrdiff_t(link.terminator_out.size()));
  AnswerPlan plan;
  const Result<std::string> body = body_of(link, frame);
  if (!body) return plan;
  const std::optional<std::string> answer = answer_of(*body);
  std::string text = link.echo ? frame + link.echo_terminator : "";
  for (std::string_view remaining = answer ? *answer : std::string_view(); answer;) {
    const std::size_t line_end = remaining.find('\n');
    text += frame_of(link, std::string(remaining.substr(0, line_end))) + link.terminator_in;
    if (line_end == std::string_view::npos) break;
    remaining.remove_prefix(line_end + 1);
  }
  text += link.prompt;
  if (!text.empty()) plan.pieces.push_back({{text.begin(), text.end()}, 0.0});
  return plan;
}

std::optional<AnswerPlan> DialectTwin::next_answer(std::vector<std::uint8_t>& bytes) {
  std::optional<std::string> heard;
  std::optional<AnswerPlan> plan = answer_sentence(dialect_.link, bytes, [&](const std::string& body) {
    const std::lock_guard lock(mutex);
    heard = body;
    return answer(body);
  });
  if (heard && disturb) disturb(*heard, *plan);
  return plan;
}

}  // namespace turncal
