#include "orchestrator/devices/operator_prompts.h"

#include <algorithm>

namespace turncal {

void OperatorPrompts::on_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  if (record.event == RunEvent::settled && record.from == RunState::settling) {
    // Settling without a turn comes after a rest and after a dwell that is repeated.
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
  const double a_turn_s = turns_done_ > 0 ? beyond_plan_s_ / turns_done_ : first_turn_s_;
  return at.eta_s + a_turn_s * static_cast<double>(at.moves_left);
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

}  // namespace turncal
