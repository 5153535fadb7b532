#include "orchestrator/devices/operator_prompts.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/devices/stop_signals.h"

namespace turncal {

void OperatorPrompts::on_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  if (record.event == RunEvent::settled && record.from == RunState::settling) {
    // Settling without a turn follows a rest or a repeated dwell.
    if (turning_) {
      beyond_plan_s_ += std::max(0.0, (at.time_s - began_s_) - (planned_left_s_ - at.eta_s));
      ++turns_done_;
    }
    turning_ = false;
  }
  if (record.event == RunEvent::pause_wanted) pause_comes_ = true;
  const OperatorTexts& texts = table_.texts();
  if (record.event == RunEvent::connected) return table_.set_reason(texts.say("reason.first"));
  if (record.event != RunEvent::move_next) return;
  turning_ = true;
  began_s_ = at.time_s;
  planned_left_s_ = at.eta_s;
  table_.set_reason(step_words(at, texts) + ". " + left_words(at, left_s(at), texts) + ".");
}

std::optional<double> OperatorPrompts::left_s(const RunSnapshot& at) const {
  if (table_.rehearsed()) return {};
  return at.eta_s + (turns_done_ > 0 ? beyond_plan_s_ / turns_done_ : first_turn_s_) * double(at.moves_left);
}

void OperatorPrompts::on_progress(const RunSnapshot& at) {
  at_ = at;
  show();
}

void OperatorPrompts::show_on(std::function<void(const OperatorScreen&)> show, bool lines) {
  show_ = std::move(show);
  table_.watch(show_ ? [this] { this->show(); } : std::function<void()>(), lines);
}

void OperatorPrompts::show() {
  OperatorScreen screen = operator_screen(table_.task(), at_, left_s(at_), table_.texts());
  if (pause_comes_ && screen.task.kind == OperatorTask::Kind::nothing && screen.note.empty())
    screen.note = table_.texts().say("screen.pause_comes");
  const bool measures = screen.measures && !screen.big.empty();
  if (measures && !measured_) table_.say(table_.texts().say("hands_off", {{"left", screen.big}}));
  measured_ = measures;
  if (show_) show_(screen);
}

namespace {

constexpr int look_ms = 200;  // to notice a request to stop between two polls

Error not_mounted(const std::string& unit, const std::string& why) {
  return {ErrorKind::interrupted, "unit " + unit + " is not mounted: " + why + "; the same command goes on with it"};
}

// Reads a line without its end; empty: the input has ended, or a stop was requested.
std::optional<std::string> read_line(int input) {
  std::string line;
  while (!StopSignals::any()) {
    pollfd which{input, POLLIN, 0};
    if (::poll(&which, 1, look_ms) <= 0) continue;
    char c = 0;
    const ssize_t got = ::read(input, &c, 1);
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (got <= 0) return {};
    if (c == '\n') return std::string(trimmed(line));
    line += c;
  }
  return {};
}

Result<Mounted> ask(const OperatorTexts& texts, const std::string& unit, int input, std::ostream& out,
                    const std::string& tag) {
  for (;;) {
    out << tag << texts.say("mount.ask", {{"unit", unit}}) << " \a" << std::flush;
    const std::optional<std::string> line = read_line(input);
    if (!line) {
      out << std::endl;
      return not_mounted(unit, StopSignals::any() ? "interrupted" : "the input ended");
    }
    if (line->empty()) return Mounted{};
    if (*line == "quit") return not_mounted(unit, "the operator quit");
    const std::size_t blank = std::min(line->find(' '), line->size());
    const std::string reason(trimmed(std::string_view(*line).substr(blank)));
    const bool skips = texts.means(line->substr(0, blank), "skip");
    if (skips && !reason.empty() && is_plain_text(reason)) return Mounted{reason};
    out << tag
        << (skips && reason.empty() ? texts.say("wrong.why")
                                    : texts.say("mount.expected", {{"text", turncal::quoted(*line)}}))
        << std::endl;
  }
}

}  // namespace

void call_operator(const HookCommands& hooks, HookCall call, const Error& why, std::ostream& out,
                   const std::string& tag) {
  call.event = "needs_operator";
  call.message = why.message;
  if (const Status status = run_hook(hooks, call); !status) out << tag << status.error().message << std::endl;
}

Result<Mounted> mount_unit(const StationConfig& station, const HookCall& call, bool stays, int input, std::ostream& out,
                           const std::string& tag) {
  const StopSignals signals(FirstInterrupt::pauses);
  const std::string head = tag + "unit " + call.unit + ": ";
  if (!stays && !call.message.empty()) out << head << call.message << std::endl;
  std::string why = "nobody to ask: expected a terminal, or hook.mount in the station file";
  if (!station.hooks.mount.empty()) {
    out << head << "mounting" << std::endl;
    const Status mounted = run_hook(station.hooks, call, station.hooks.mount_time_s, &StopSignals::any);
    if (mounted) return Mounted{};
    why = mounted.error().message;
  } else if (::isatty(input) == 1) {
    if (!stays) return ask(OperatorTexts::of(station.table.manual.language), call.unit, input, out, tag);
    out << head << call.message << " (--mount-again asks for it)" << std::endl;
    return Mounted{};
  }
  const Error error = not_mounted(call.unit, why);
  call_operator(station.hooks, call, error, out, tag);
  return error;
}

}  // namespace turncal
