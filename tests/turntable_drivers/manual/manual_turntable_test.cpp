// The table turned by hand, with an operator made of a pipe: the contract, and every way of answering.
#include "turntable_drivers/manual/manual_turntable.h"

#include "imu_io/base/text.h"
#include "tests/turntable_drivers/table_contract.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {
namespace {

struct HandClock : Clock {
  double time_s = 0.0;
  double now_s() const override { return time_s; }
  double utc_s() const override { return time_s; }
};

struct Desk {
  explicit Desk(ManualSettings settings = {}, GravitySense sense = {}) : manual(make(settings, std::move(sense))) {}
  ~Desk() {
    ::close(pipe_[0]);
    hang_up();
  }
  void type(const std::string& line) {
    EXPECT_EQ(::write(pipe_[1], (line + "\n").data(), line.size() + 1), static_cast<ssize_t>(line.size() + 1));
  }
  void hang_up() {
    if (pipe_[1] >= 0) ::close(pipe_[1]);
    pipe_[1] = -1;
  }
  void begin() {
    ASSERT_OK(manual.connect());
    ASSERT_OK(manual.enable());
    ASSERT_OK(manual.home());
  }
  // Until gravity after an answer is known.
  void settle(double seconds = 2.0) {
    clock.time_s += seconds;
    EXPECT_TRUE(manual.status(Axis::roll).ok());
  }
  // What is typed, taken, and gravity after it.
  void answer(const std::string& line, double taken_s = 0.0) {
    type(line);
    settle(taken_s);
    settle();
  }
  std::string said() {
    const std::string text = out.str();
    out.str("");
    return text;
  }
  int pipe_[2] = {-1, -1};
  HandClock clock;
  std::ostringstream out;
  ManualTurntable manual;

 private:
  ManualTurntable make(ManualSettings settings, GravitySense sense) {
    EXPECT_EQ(::pipe(pipe_), 0);
    return ManualTurntable(settings, clock, pipe_[0], out, std::move(sense));
  }
};

// Turns at 20 deg/s and types what it is asked for when it is there.
struct ManualFactory {
  Desk desk;
  std::array<double, 3> hand_deg{};
  Turntable& table() { return desk.manual; }
  void pass(double seconds) {
    desk.clock.time_s += seconds;
    const OperatorTask task = desk.manual.task();
    if (task.kind == OperatorTask::Kind::nothing) return;
    double& hand = hand_deg[index(task.axis)];
    const double way_deg = task.target_deg - hand;
    hand += std::clamp(way_deg, -20.0 * seconds, 20.0 * seconds);
    if (std::abs(task.target_deg - hand) < 1e-9) desk.type(std::to_string(task.target_deg));
  }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 0.0;
  static constexpr bool silent_on_the_way = true;
};
INSTANTIATE_TYPED_TEST_SUITE_P(Manual, TableContract, ManualFactory);

struct ManualTable : testing::Test {
  void ready(Desk& desk) {
    desk.begin();
    for (int i = 0; i < 3; ++i) desk.type("0");
    for (const Axis axis : all_axes) ASSERT_TRUE(desk.manual.status(axis)->homed);
    desk.said();
  }
  // Ready, and asked for a turn.
  void turning(Desk& desk, Axis axis = Axis::roll, double to_deg = 90.0) {
    ready(desk);
    ask(desk, axis, to_deg);
  }
  void ask(Desk& desk, Axis axis, double to_deg) { ASSERT_OK(desk.manual.move_absolute(axis, to_deg, 10.0, 10.0)); }
  // What is typed, whether roll is then still to be turned, and what is said, at least.
  struct Line {
    std::string typed;
    bool moving;
    const char* says = "";
  };
  void talk(Desk& desk, const std::vector<Line>& lines) {
    for (const Line& line : lines) {
      desk.said();
      desk.type(line.typed);
      EXPECT_EQ(desk.manual.status(Axis::roll)->moving, line.moving) << line.typed;
      EXPECT_SAYS(desk.said(), line.says) << line.typed;
    }
  }
  // An error of every call until the stop; then the stop can be verified, and nothing more is asked for.
  void expect_end(Desk& desk, ErrorKind kind, const std::string& text) {
    for (int i = 0; i < 2; ++i) {
      const Result<AxisStatus> ended = desk.manual.status(Axis::roll);
      ASSERT_TRUE(fails(ended, kind));
      EXPECT_TRUE(fails(ended, text));
    }
    EXPECT_FALSE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
    EXPECT_TRUE(desk.manual.stop_all().ok());
    EXPECT_TRUE(desk.manual.abort_all().ok());
    for (const Axis axis : all_axes) {
      const Result<AxisStatus> status = good(desk.manual.status(axis));
      EXPECT_FALSE(status->moving || status->enabled);
      EXPECT_EQ(status->rate_degps, 0.0);
    }
    ASSERT_TRUE(fails(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0), kind));
  }
};

TEST_F(ManualTable, SaysAxisAngleWayAndReason) {
  Desk desk;
  ready(desk);
  desk.manual.set_reason("step 3 of 14");
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, -90.0, 10.0, 10.0).ok());
  EXPECT_EQ(
      desk.said().find("\nstep 3 of 14\nTurn pitch from 0 to -90 deg, 90 deg backward (its angle decreases); then "
                       "type the angle reached ("),
      0u);
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving);
  EXPECT_FALSE(desk.manual.status(Axis::pitch)->in_position);
  desk.type("-89.95");
  EXPECT_NEAR(desk.manual.status(Axis::pitch)->position_deg, -89.95, 1e-12) << "the angle reached, not the one wanted";
  EXPECT_TRUE(desk.manual.needs_operator());
}

TEST_F(ManualTable, RefusesBeyondToleranceAndNonsense) {
  Desk desk;
  turning(desk);
  for (const char* const bad : {"turn roll 90", "say 90", "89.89", "90.11", "-90", "0", "nan", "ninety", "90 deg",
                                "9 0", "1e999", "90.0.0", "9e1", "\u00b0", "9\u00b00"}) {
    talk(desk, {{bad, true}});
    desk.type(bad);
    static_cast<void>(desk.manual.status(Axis::roll));
    EXPECT_FALSE(desk.said().empty()) << bad;
  }
  talk(desk, {{"", true}, {"90.1", false}});
  // A decimal comma, and the signs of another keyboard; the degree that the screen shows; the wide digits of a Chinese keyboard; a dial knows
  // only a circle.
  ask(desk, Axis::roll, -0.5);
  talk(desk, {{"0,5", true}, {"1,2,3", true}, {"0.5,", true}, {",", true}, {"\u22120\uff0c5", false}});
  EXPECT_EQ(desk.manual.status(Axis::roll)->position_deg, -0.5);
  for (const auto& [typed, asked, meant] : {std::tuple{"0,5", 0.5, 0.5},
                                            {"12.5\u00b0", 12.5, 12.5},
                                            {"34 \u00b0", 34.0, 34.0},
                                            {"\uff0d\uff11\uff10\uff12\uff0e\uff19\u5ea6", -102.9, -102.9},
                                            {"\uff13\uff14\uff15\uff16\uff17\uff18", 345678.0, 345678.0},
                                            {"89.9", 450.0, 449.9}}) {
    ask(desk, Axis::roll, asked);
    talk(desk, {{typed, false}});
    EXPECT_NEAR(desk.manual.status(Axis::roll)->position_deg, meant, 1e-9);
  }
}

// By the gyros: 360 deg that were not made, made the other way round, and what their scale may be.
TEST_F(ManualTable, TheGyrosMustHaveFeltTheTurn) {
  std::array<double, 3> felt{};
  const std::optional<std::array<double, 3>> level = std::array<double, 3>{0.0, 9.79, 0.0};
  Desk desk({}, [&] { return level; });
  desk.manual.feel_turns([&] { return std::optional(felt); });
  desk.begin();
  const auto answer = [&](const char* typed) {
    desk.said();
    desk.answer(typed);
    return desk.said();
  };
  EXPECT_SAYS(answer("999"), "expected an angle of at most 720 degrees");
  for (int i = 0; i < 3; ++i) answer("0");
  const auto moving = [&](Axis axis) { return desk.manual.status(axis)->moving; };
  // Pitch turns about z, heading about -y; the scale is not known yet: 0.5 of a degree is believed, nothing is not.
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, 360.0, 10.0, 10.0).ok());
  EXPECT_SAYS(answer("0"), "another 360 deg forward");
  EXPECT_TRUE(moving(Axis::pitch));
  felt[2] = -180.0;
  EXPECT_SAYS(answer("360"), "another 720 deg forward") << "the other way round";
  felt[2] = 180.0;
  EXPECT_SAYS_NOT(answer("360"), "measured");
  EXPECT_FALSE(moving(Axis::pitch));
  // Now it is: two turns asked for and one made are told apart.
  ASSERT_TRUE(desk.manual.move_absolute(Axis::heading, -720.0, 10.0, 10.0).ok());
  felt[1] = 180.0;
  EXPECT_SAYS(answer("0"), "measured -360 deg of the -720 deg");
  const OperatorTask task = desk.manual.task();
  EXPECT_TRUE(task.wrong && task.kind == OperatorTask::Kind::turn && task.axis == Axis::heading);
  EXPECT_SAYS(task.note, "another 360 deg backward");
  felt[1] = 360.0;
  answer("0");
  EXPECT_FALSE(moving(Axis::heading));
  // The dial of heading is nobody's to check: any part of a turn can be missing.
  for (const auto& [dial, sense] : {std::pair{"-810", -1.0}, {"-720.05", 1.0}}) {
    ask(desk, Axis::heading, std::stod(dial));
    EXPECT_SAYS(answer(dial), sense < 0.0 ? "another 90 deg backward" : "another 90 deg forward");
    felt[1] -= sense * 45.0;  // half a degree is felt of one
    EXPECT_SAYS_NOT(answer(dial), "measured");
  }
  EXPECT_EQ(desk.manual.task().kind, OperatorTask::Kind::nothing);
}

TEST_F(ManualTable, TimeOutPausesAndAssumesNothing) {
  Desk desk;
  turning(desk);
  desk.clock.time_s += 601.0;
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving);
  EXPECT_TRUE(desk.manual.paused());
  EXPECT_SAYS(desk.said(), "paused");
  talk(desk, {{"90", true}, {"continue", true, "Turn roll from 0 to 90 deg"}, {"90", false}});
}

TEST_F(ManualTable, RepeatPauseSkipAbort) {
  Desk desk;
  turning(desk);
  talk(desk, {{"repeat", true, "Turn roll from 0 to 90 deg"}, {"p", true}});
  EXPECT_EQ(desk.manual.status(Axis::roll)->text, "paused");
  talk(desk, {{"c", true}, {"skip", true}});  // not without a reason
  desk.type("skip the roll axis is jammed");
  expect_end(desk, ErrorKind::interrupted, "skipped by the operator: the roll axis is jammed");
  Desk other;
  ready(other);
  other.type("abort");  // at once, though nothing is asked for
  expect_end(other, ErrorKind::aborted, "aborted by the operator");
}

// A slip of one key loses no run: only the whole word gives it up.
TEST_F(ManualTable, OneLetterGivesNothingUp) {
  for (const char* const language : {"en", "de", "zh"}) {
    Desk desk({.language = language});
    ready(desk);
    ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
    const OperatorTexts& texts = desk.manual.texts();
    const std::string abort = texts.say("word.abort");
    for (const std::string& letter :
         {std::string("a"), std::string("A"), abort.substr(0, printable_character(abort))}) {
      desk.said();
      desk.type(letter);
      EXPECT_TRUE(desk.manual.status(Axis::roll).ok()) << language << ": " << letter;
      EXPECT_EQ(desk.said(), texts.say("wrong.whole_word") + "\n") << language;
    }
    desk.type(abort);
    EXPECT_EQ(desk.manual.status(Axis::roll).error().kind, ErrorKind::aborted) << language;
  }
}

TEST_F(ManualTable, GermanLettersAndDecimalComma) {
  Desk desk({.language = "de"});
  turning(desk, Axis::roll, 22.5);
  EXPECT_SAYS(desk.said(), "Rollachse von 0 auf 22,5 Grad drehen, 22,5 Grad vorwärts");
  talk(desk, {{"22", true, "22 liegt 0,5 Grad neben 22,5; erlaubt sind höchstens 0,1."}, {"p", true}});
  EXPECT_EQ(desk.manual.status(Axis::roll)->text, "paused");
  talk(desk, {{"w", true}, {"Überspringen", true, "Warum? Bitte „überspringen“"}});
  desk.type("Ü Klemme sitzt fest");
  expect_end(desk, ErrorKind::interrupted, "skipped by the operator: Klemme sitzt fest");
}

TEST_F(ManualTable, WhoLeavesIsMissedWhenTheNextTurnIsDue) {
  for (const bool hangs_up : {true, false}) {
    Desk desk;
    ready(desk);
    if (hangs_up) desk.hang_up();
    if (!hangs_up) desk.type("leave");
    for (int i = 0; i < 3; ++i) EXPECT_TRUE(desk.manual.status(Axis::roll).ok()) << "a dwell needs nobody";
    ASSERT_TRUE(fails(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0), ErrorKind::interrupted));
    EXPECT_EQ(desk.manual.home().error().kind, ErrorKind::interrupted);
  }
  Desk desk;
  turning(desk);
  desk.type("l");
  expect_end(desk, ErrorKind::interrupted, "the operator left");
}

TEST_F(ManualTable, PauseHoldsTheNextQuestionBackAndEndsWhenTooLong) {
  Desk desk;
  ready(desk);
  desk.type("pause");
  EXPECT_TRUE(desk.manual.status(Axis::roll).ok());
  desk.clock.time_s += 10'000.0;
  EXPECT_TRUE(desk.manual.status(Axis::roll).ok()) << "nobody is missed yet";
  desk.said();
  ask(desk, Axis::roll, 90.0);
  EXPECT_EQ(desk.said(), "");
  desk.clock.time_s += 3599.0;
  talk(desk, {{"90", true}, {"continue", true, "Turn roll"}, {"pause", true}});
  desk.clock.time_s += 3601.0;
  expect_end(desk, ErrorKind::interrupted, "paused for longer than 3600 s");
}

TEST_F(ManualTable, HomingTakesTheAnglesReadOff) {
  std::optional<std::array<double, 3>> sensed = std::array<double, 3>{0.0, 0.0, 9.79};  // roll -90
  Desk desk({}, [&] { return sensed; });
  desk.begin();
  desk.type("90");  // wrong, and not seen before the other is known
  desk.answer("0.5");
  EXPECT_SAYS(desk.said(), "179.5 deg away");
  EXPECT_EQ(desk.manual.task().axis, Axis::roll) << "both are asked for again";
  desk.type("-90");
  desk.answer("0.5");
  desk.type("-400.25");
  const double expected[] = {-400.25, 0.5, -90.0};
  for (const Axis axis : all_axes) {
    const AxisStatus status = *desk.manual.status(axis);
    EXPECT_TRUE(status.homed && status.in_position && !status.moving);
    EXPECT_EQ(status.position_deg, expected[int(axis)]);
  }
}

// The rig is what the hand turns: it goes where the typed angle says, and only there.
TEST_F(ManualTable, RehearsalTurnsTheRigToTheTypedAngle) {
  Rig rig(default_rig_config());
  Desk desk;
  desk.manual.rehearse_on(rehearsed_table(rig));
  std::vector<ImuSample> samples(4000);
  const auto pass = [&](double seconds) { rig.advance(std::span(samples).first(std::size_t(200 * seconds))); };
  desk.begin();
  EXPECT_TRUE(desk.manual.identify()->simulated);
  // All at once, as from a file: each is taken by its own question.
  for (const char* line : {"0", "0.02", "-0.03", "turn roll 20", "say 45", "44.96"}) desk.type(line);
  desk.hang_up();
  for (const Axis axis : all_axes) {
    EXPECT_FALSE(desk.manual.status(axis)->homed && axis == Axis::heading);
    pass(1.0);
  }
  ASSERT_TRUE(desk.manual.status(Axis::heading)->homed);
  EXPECT_NEAR(rig.axis(Axis::pitch).position_deg, 0.02, 1e-9);
  EXPECT_TRUE(desk.manual.status(Axis::roll).ok()) << "the end of the file is not the end while nothing is asked";
  // "say 45" turns nothing.
  for (const auto& [said_deg, turned_deg] : {std::pair(45.0, 0.02), {44.96, 44.96}}) {
    ask(desk, Axis::pitch, 45.0);
    EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving);
    pass(10.0);
    EXPECT_NEAR(rig.axis(Axis::roll).position_deg, 20.0, 1e-9);
    EXPECT_NEAR(rig.axis(Axis::pitch).position_deg, turned_deg, 1e-9);
    EXPECT_EQ(desk.manual.status(Axis::pitch)->position_deg, said_deg);
  }
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, 0.0, 10.0, 20.0).ok());
  expect_end(desk, ErrorKind::interrupted, "end of input");
}

TEST_F(ManualTable, EndOfInputStops) {
  Desk desk;
  turning(desk);
  desk.type("89");                                // refused
  EXPECT_EQ(::write(desk.pipe_[1], "90", 2), 2);  // without a line end: no answer
  desk.hang_up();
  expect_end(desk, ErrorKind::interrupted, "end of input");
}

TEST_F(ManualTable, StopInMidTurnMeansNotInPosition) {
  Desk desk;
  turning(desk);
  ASSERT_TRUE(desk.manual.stop_all().ok());
  EXPECT_FALSE(desk.manual.status(Axis::roll)->in_position);
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->in_position);
  desk.type("90");
  EXPECT_NEAR(desk.manual.status(Axis::roll)->position_deg, 0.0, 1e-12) << "nothing was asked";
}

// Pitch 30 deg, roll -45 deg: f/g = (sin 30, cos 30 cos 45, cos 30 sin 45) = (0.5, 0.61237, 0.61237).
TEST_F(ManualTable, GravityHasToAgree) {
  std::optional<std::array<double, 3>> sensed = std::array<double, 3>{0.0, 9.79, 0.0};
  Desk desk({}, [&] { return sensed; });
  desk.begin();
  for (int i = 0; i < 3; ++i) desk.answer("0", 2.0);
  desk.said();
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, 30.0, 10.0, 10.0).ok());
  desk.type("30");
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving) << "the mean known so far is of before the answer";
  desk.settle();
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving) << "still level";
  EXPECT_SAYS(desk.said(), "senses gravity 30 deg away");
  sensed = std::array<double, 3>{-0.5 * 9.79, std::cos(0.5236) * 9.79, 0.0};  // turned the wrong way
  desk.answer("30");
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving);
  EXPECT_SAYS(desk.said(), "60 deg away");
  desk.type("30");
  desk.settle(0.0);
  sensed = std::array<double, 3>{0.5 * 9.79, std::cos(0.5236) * 9.79, 0.0};
  desk.settle();
  EXPECT_FALSE(desk.manual.status(Axis::pitch)->moving) << desk.said();
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, -45.0, 10.0, 10.0).ok());
  sensed = std::array<double, 3>{0.5, 0.61237, 0.61237};
  desk.answer("-45");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->moving) << desk.said();
  // A unit that does not come to rest, or says nothing, or zero, takes no answer.
  for (const bool zero : {false, true}) {
    sensed.reset();
    if (zero) sensed = std::array<double, 3>{};
    ASSERT_TRUE(zero || desk.manual.move_absolute(Axis::roll, 0.0, 10.0, 10.0).ok());
    desk.type("0");
    desk.settle(0.0);
    desk.settle(9.9);
    desk.settle(0.2);
    EXPECT_TRUE(desk.manual.status(Axis::roll)->moving) << zero;
    EXPECT_SAYS(desk.said(), zero ? "senses no gravity" : "is not still");
  }
  // Heading cannot be seen by gravity.
  ASSERT_TRUE(desk.manual.stop_all().ok());
  ASSERT_TRUE(desk.manual.move_absolute(Axis::heading, 90.0, 10.0, 10.0).ok());
  desk.type("90");
  EXPECT_FALSE(desk.manual.status(Axis::heading)->moving);
}

}  // namespace
}  // namespace turncal
