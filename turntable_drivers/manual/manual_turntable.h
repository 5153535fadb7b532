// ManualTurntable: a table turned by hand. The operator is told which axis to turn to which angle and why, turns it, and types the
// angle reached.
//
// - A typed angle is accepted if it is within tolerance_deg of the target (modulo whole turns: a dial shows 90 for
//   450) and if gravity, as the unit senses it in the seconds after the answer, agrees with the resulting tilt (which shows neither heading
//   nor whole turns). Any other answer gets a reply, and the question is asked again.
// - If the integrated gyro rates are known (feel_turns), a turn that the gyros did not sense is asked for again: one that was typed but
//   not made, or made in the wrong direction. At first their scale may be off by half or more. After a turn confirmed by gravity it is known, and
//   the gyros must agree within a quarter turn, in heading within half the turn, by that scale or the nominal one.
// - Homing asks for the positions of all three axes: 0, or any angle read off. Pitch is checked together with roll.
// - Nothing is assumed: without an answer within answer_timeout_s the run pauses, until the operator types `continue`. A pause that
//   holds up a question for longer than pause_limit_s ends the run, which can be resumed.
// - Other answers: `repeat` shows the question again, `skip REASON`, `pause`, `continue`, `leave`, `abort`, `help`. The first letter
//   is enough, except for `abort`.
// - `skip`, a pause that is too long, `leave`, and the end of the input are errors of kind interrupted, returned by every call that asks for
//   something, and by status() while something is asked. A dwell, which needs nobody, is thus completed first. `abort` is an
//   error of kind aborted, returned by every call. All of this is safe, because nothing moves by itself. After stop_all() status()
//   answers again, so that the stop can be verified.
// - Several moves may be commanded at once; the operator is asked for them one after another.
// - After a stop during a turn the angle is unknown: the axis is not in position until another move is answered.
//
// The expected specific force in body axes at rest, from C_nb = Ry(-H) Rz(P) Rx(R) and f_n = (0, g, 0):
//   f_b / g = (sin P, cos P cos R, -cos P sin R)
// Calls do not block; status() reads the input. Single-threaded.
//
// A rehearsal (rehearse_on) turns a simulated table to the typed angle, at the rate of the move. Its time stands still while somebody
// thinks. Therefore status() waits for an answer (up to 1 s of the wall clock, and again at the next call), time limits
// use the wall clock, and a line is read only when it is needed, so that answers can come from a file. Operator errors can
// be rehearsed, too: `turn AXIS ANGLE` turns any axis without answering, `say ANGLE` answers without turning.
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

// All texts for the operator of a manual table, one file per language: texts/en.conf, de.conf, zh.conf, compiled in. Texts for
// engineers (log, journal, errors) are English and not here. A text has {places}; every language has those of the English one.

inline constexpr std::array<std::string_view, 3> operator_languages = {"en", "de", "zh"};

class OperatorTexts {
 public:
  // REQUIRES: one of operator_languages.
  static const OperatorTexts& of(std::string_view language);

  using Places = std::initializer_list<std::pair<std::string_view, std::string>>;
  // REQUIRES: a key of en.conf, and all its places.
  std::string say(std::string_view key, Places places = {}) const;
  // Format an angle with this language's decimal point: with four digits, or exactly.
  std::string shown(double angle_deg) const;
  std::string exact(double angle_deg) const;
  // True if `typed` is this word: "pause" is the English word of word.pause, the word in this language, or the first letter of either. Only
  // `abort` must be typed in full.
  bool means(const std::string& typed, std::string_view english) const;
  bool first_letter(const std::string& typed, std::string_view english) const;
  const std::map<std::string, std::string, std::less<>>& all() const { return texts_; }

 private:
  explicit OperatorTexts(std::string_view language);
  std::string number(std::string text) const;
  std::map<std::string, std::string, std::less<>> texts_;
};

// ---- the table ----

// What the operator of a manual table has to do now, as plain data for the terminal and the page
// (orchestrator/watch/operator_screen.h). Degrees.
struct OperatorTask {
  enum class Kind {
    nothing,  // no task: hands off the table
    where,    // type where an axis stands
    turn,     // turn an axis, and type the angle reached
    compare,  // the answer is compared with gravity and gyros: hands off the table
    paused
  };
  Kind kind = Kind::nothing;
  Axis axis = Axis::heading;
  std::optional<double> from_deg;  // empty: unknown
  double target_deg = 0.0;
  std::string note;    // the last message that still applies, in the operator's language
  bool wrong = false;  // the note rejects an answer
  long answers = 0;    // lines typed so far
};

struct ManualSettings {
  double tolerance_deg = 0.1;
  // For an uncalibrated unit: scale factors 8 % apart tilt the sensed gravity by 2.2 deg at 45 deg, and not at all at a quarter turn.
  double gravity_tolerance_deg = 5.0;
  double answer_timeout_s = 600.0;
  double pause_limit_s = 3600.0;
  std::string language = "en";  // of operator_languages
};

// Returns the mean specific force in body axes over the last second, in any unit; empty if unknown (no samples, or the unit moves).
using GravitySense = std::function<std::optional<std::array<double, 3>>()>;

// Returns the integral of the gyro rates since some start, in body axes and in degrees of nominal scale; empty if unknown.
using TurnSense = std::function<std::optional<std::array<double, 3>>()>;

// The table that a rehearsal turns instead of a person.
struct RehearsedTable {
  std::function<void(Axis axis, double angle_deg, double rate_degps, double acceleration_degps2)> turn;
  std::function<bool()> moving;  // true while any axis moves
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

  // Sets the reason and progress shown in a line above the next question.
  void set_reason(const std::string& reason) {
    reason_ = reason;
    reason_told_ = false;
  }
  bool paused() const { return paused_; }
  bool rehearsed() const { return rehearsed_.has_value(); }  // its time is simulated

  // Returns the present task. watch() sets `changed`, called for every new task and typed line. lines: tasks are also printed.
  OperatorTask task() const;
  void watch(std::function<void()> changed, bool lines) {
    changed_ = std::move(changed);
    lines_ = lines;
  }
  const OperatorTexts& texts() const { return texts_; }
  void say(const std::string& text);  // prints a line if lines are printed

 private:
  struct Wanted {
    Axis axis = Axis::heading;
    double target_deg = 0.0;
    bool homing = false;  // any angle is accepted
    double rate_degps = 10.0;
    double acceleration_degps2 = 20.0;
  };
  struct Hand {
    double position_deg = 0.0;
    bool known = false;  // an answer was accepted, and no later stop interrupted a turn
    bool homed = false;
  };
  struct Answer {  // accepted once gravity agrees
    double angle_deg = 0.0;
    double since_s = 0.0;  // no turn since this time
  };
  Status usable();  // connected, and the question can still be answered
  void look_at_input();
  bool read_input(bool wait);  // false: no more input now
  void handle_lines();
  void keep_limits();
  void answer(const std::string& line);
  void handle_angle(const std::string& text, bool turned);
  void turn_rehearsed(const std::string& axis_and_angle);
  void check_answer();
  std::optional<std::string> gravity_objection(Axis axis, double angle_deg) const;
  std::optional<std::string> turn_objection(const Wanted& now, double angle_deg) const;
  std::optional<double> felt_deg(Axis axis) const;  // the sensed part of the present turn, about that axis
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
  double patience_s() const;  // the clock for time limits
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
  std::optional<std::array<double, 3>> felt_before_;  // at the start of the present question
  std::optional<double> felt_of_a_degree_;            // learned from turns confirmed by gravity
  std::optional<RehearsedTable> rehearsed_;
  std::string reason_;
  bool reason_told_ = false;
  std::string typed_;  // lines not handled yet, and an incomplete one
  std::deque<Wanted> queue_;
  std::optional<Answer> answered_;  // to the question at the front of the queue
  std::array<Hand, 3> hands_;
  double asked_s_ = 0.0;
  double paused_s_ = 0.0;
  bool connected_ = false;
  bool enabled_ = false;
  bool paused_ = false;
  bool input_ended_ = false;
  bool stopped_ = false;      // and nothing was commanded since
  std::optional<Error> end_;  // set: no more questions
};

}  // namespace turncal
