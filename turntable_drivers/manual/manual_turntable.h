// ManualTurntable: the table is turned by hand. The operator is told which axis to turn to which angle and why, turns it, and types the
// angle reached.
//
// - A typed angle is taken when it lies within tolerance_deg of the one wanted (whole turns are understood: a dial shows 90 where
//   450 is meant) and when gravity, as the unit senses it in the seconds after the answer, agrees with the tilt that follows (heading
//   cannot be seen by it, nor whole turns). Anything else is answered and asked again.
// - Where the gyros' sum is known (feel_turns), a turn that they did not feel is asked for once more: whole turns that were typed and
//   not made, or made the other way round. Until a turn that gravity has seen shows what they feel of a degree, their scale may be off
//   by half and more; afterwards they have to agree to a quarter turn, by that scale or by the nominal one.
// - Homing asks where all three axes stand: 0, or any angle read off. Pitch is checked together with roll.
// - Nothing is ever assumed: no answer within answer_timeout_s pauses; a pause ends when the operator types `continue`. One that
//   holds a question up for longer than pause_limit_s ends the run, to be taken up again.
// - Besides an angle: `repeat` shows the question again, `skip REASON`, `pause`, `continue`, `leave`, `abort`, `help`. The first letter
//   will do, but of `abort`.
// - `skip`, a pause that is too long, `leave`, and the end of the input are errors of kind interrupted: of every call that asks for
//   something, and of status() while something is asked. A dwell, for which nobody is needed, is so completed first. `abort` is an
//   error of kind aborted of every call. Nothing moves by itself, so all of this is safe; once stop_all() was called status()
//   answers again, so that the stop can be verified.
// - Several moves may be asked for at once; they are put to the operator one after another.
// - After a stop in the middle of a turn the angle is not known: the axis is not in position until a move to somewhere is answered.
//
// Expected direction of gravity's reaction in the body, from C_nb = Ry(-H) Rz(P) Rx(R) and f_n = (0, g, 0):
//   f_b / g = (sin P, cos P cos R, -cos P sin R)
// Calls do not block: the input is looked at in status(). One thread.
//
// A rehearsal (rehearse_on): a simulated table is turned to the typed angle instead, at the rate of the move. Since nothing happens in its time
// while somebody thinks, status() then waits for an answer (up to 1 s of the wall clock, and again at the next call), time limits
// are those of the wall clock, and a line is read only when it is needed, so that answers can come from a file. What a person
// does wrong can be rehearsed: `turn AXIS ANGLE` turns any axis and answers nothing, `say ANGLE` answers and turns nothing.
#pragma once

#include <array>
#include <deque>
#include <functional>
#include <initializer_list>
#include <map>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>

#include "calib/types/axis.h"
#include "imu_io/base/clock.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// All that the operator of a table turned by hand reads, in one file a language: texts/en.conf, de.conf, zh.conf, compiled in. What
// engineers read (log, journal, errors) is English and not here. A text has {places}; every language has those of the English one.

inline constexpr std::array<std::string_view, 3> operator_languages = {"en", "de", "zh"};

class OperatorTexts {
 public:
  // REQUIRES: one of operator_languages.
  static const OperatorTexts& of(std::string_view language);

  using Places = std::initializer_list<std::pair<std::string_view, std::string>>;
  // REQUIRES: a key of en.conf, and its places.
  std::string say(std::string_view key, Places places = {}) const;
  // Angles, with this language's decimal point: to four digits, and as they are.
  std::string shown(double angle_deg) const;
  std::string exact(double angle_deg) const;
  // Whether somebody typed this: "pause" is the English word of word.pause, this language's own, or the first letter of either. What
  // gives the run up has to be the whole word.
  bool means(const std::string& typed, std::string_view english) const;
  bool first_letter(const std::string& typed, std::string_view english) const;
  const std::map<std::string, std::string, std::less<>>& all() const { return texts_; }

 private:
  explicit OperatorTexts(std::string_view language);
  std::string number(std::string text) const;
  std::map<std::string, std::string, std::less<>> texts_;
};

// ---- the table ----

// What the person at a table turned by hand has to do now, as plain data. Terminal and page both draw it
// (orchestrator/watch/operator_screen.h). Degrees.
struct OperatorTask {
  enum class Kind {
    nothing,  // the table is not theirs: hands off
    where,    // say where an axis stands
    turn,     // turn an axis, say the angle reached
    compare,  // the answer is compared with gravity and gyros: hands off
    paused
  };
  Kind kind = Kind::nothing;
  Axis axis = Axis::heading;
  std::optional<double> from_deg;  // empty: not known
  double target_deg = 0.0;
  std::string note;    // what was said last, and holds still, in the operator's language
  bool wrong = false;  // the note is of an answer that was not taken
  long answers = 0;    // lines that were typed so far
};

struct ManualSettings {
  double tolerance_deg = 0.1;
  // A unit not calibrated yet: scale factors 8 % apart turn gravity by 2.2 deg at 45 deg, and not at all at a quarter turn.
  double gravity_tolerance_deg = 5.0;
  double answer_timeout_s = 600.0;
  double pause_limit_s = 3600.0;
  std::string language = "en";  // of operator_languages
};

// Mean specific force in body axes over the last second, any unit; empty: not known (no samples, or the unit moves).
using GravitySense = std::function<std::optional<std::array<double, 3>>()>;

// What the gyros have added up to since some beginning, body axes, degrees by their nominal scale; empty: not known.
using TurnSense = std::function<std::optional<std::array<double, 3>>()>;

// The table that a rehearsal turns instead of a person.
struct RehearsedTable {
  std::function<void(Axis axis, double angle_deg, double rate_degps, double acceleration_degps2)> turn;
  std::function<bool()> moving;  // any axis
  std::function<void()> stop;
};

class ManualTurntable : public Turntable {
 public:
  // `input` is a file descriptor (0: the terminal); clock and stream must outlive the table.
  ManualTurntable(ManualSettings settings, const Clock& clock, int input, std::ostream& out, GravitySense sense = {});
  void rehearse_on(RehearsedTable rehearsed) { rehearsed_ = std::move(rehearsed); }
  void feel_turns(TurnSense sense) { turn_sense_ = std::move(sense); }

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override;
  Status abort_all() override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;
  bool needs_operator() const override { return true; }

  // Why, and how far the run is, for the questions from now on: a line above the first.
  void set_reason(const std::string& reason) {
    reason_ = reason;
    reason_told_ = false;
  }
  bool paused() const { return paused_; }
  bool rehearsed() const { return rehearsed_.has_value(); }  // its time is nobody's

  // What there is to do; `changed` is called whenever it is something else, or a line was typed. lines: it is printed, too.
  OperatorTask task() const;
  void watch(std::function<void()> changed, bool lines) {
    changed_ = std::move(changed);
    lines_ = lines;
  }
  const OperatorTexts& texts() const { return texts_; }
  void say(const std::string& text);  // a line, where lines are printed

 private:
  struct Wanted {
    Axis axis = Axis::heading;
    double target_deg = 0.0;
    bool homing = false;  // any angle will do
    double rate_degps = 10.0;
    double acceleration_degps2 = 20.0;
  };
  struct Hand {
    double position_deg = 0.0;
    bool known = false;  // an answer was taken, and no stop has interrupted a turn since
    bool homed = false;
  };
  struct Answer {  // taken once gravity agrees
    double angle_deg = 0.0;
    double since_s = 0.0;  // nothing has turned since
  };
  Status usable();  // connected, and what was asked for can still be answered
  void look_at_input();
  bool read_input(bool wait);  // whether there may be more
  void handle_lines();
  void keep_limits();
  void answer(const std::string& line);
  void handle_angle(const std::string& text, bool turned);
  void turn_rehearsed(const std::string& axis_and_angle);
  void check_answer();
  std::optional<std::string> gravity_objection(Axis axis, double angle_deg) const;
  std::optional<std::string> turn_objection(const Wanted& now, double angle_deg) const;
  std::optional<double> felt_deg(Axis axis) const;  // of the turn asked for, about that axis
  void object(const std::string& why);
  std::string name(Axis axis) const { return texts_.say(std::string("axis.") + to_string(axis)); }
  std::string sense_words(double way_deg) const {
    return texts_.say(way_deg < 0.0 ? "sense.backward" : "sense.forward");
  }
  void begin_question();
  void accept(double angle_deg);
  void pause(const std::string& why);
  void end(ErrorKind kind, const std::string& why);
  void ask();
  void note(const std::string& text, bool wrong);
  void tell_changed() {
    if (changed_) changed_();
  }
  double patience_s() const;  // the clock of time limits
  bool waits_for_answer() const { return !queue_.empty() && !answered_ && !end_; }

  ManualSettings settings_;
  const Clock& clock_;
  int input_;
  std::ostream& out_;
  GravitySense sense_;
  TurnSense turn_sense_;
  const OperatorTexts& texts_;
  std::function<void()> changed_;
  bool lines_ = true;
  std::string note_;
  bool wrong_ = false;
  long answers_ = 0;
  std::optional<std::array<double, 3>> felt_before_;  // when the first of the queue was asked for
  std::optional<double> felt_of_a_degree_;            // by turns that gravity has seen
  std::optional<RehearsedTable> rehearsed_;
  std::string reason_;
  bool reason_told_ = false;
  std::string typed_;  // lines not taken yet, and the one that is not complete
  std::deque<Wanted> queue_;
  std::optional<Answer> answered_;  // to the first of the queue
  std::array<Hand, 3> hands_;
  double asked_s_ = 0.0;
  double paused_s_ = 0.0;
  bool connected_ = false;
  bool enabled_ = false;
  bool paused_ = false;
  bool input_ended_ = false;
  bool stopped_ = false;      // and nothing was asked for since
  std::optional<Error> end_;  // nothing more can be asked for
};

}  // namespace turncal
