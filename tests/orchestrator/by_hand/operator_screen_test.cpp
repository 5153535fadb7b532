// What somebody at a table turned by hand is shown: made of what there is to do, drawn on a terminal, sent to the page.
#include "orchestrator/watch/operator_screen.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/station/number_text.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

constexpr TerminalSize usual{80, 24};

OperatorTask a_turn() {
  OperatorTask task;
  task.kind = OperatorTask::Kind::turn;
  task.axis = Axis::pitch;
  task.from_deg = 0.02;
  task.target_deg = 360.0;
  return task;
}

RunSnapshot at_state(RunState state) {
  RunSnapshot at;
  at.state = state;
  at.step_place = 3;
  at.step_count = 14;
  at.moves_left = 46;
  at.run_fraction = 0.149;
  at.utc_s = 1767225600.0;
  return at;
}

OperatorScreen screen_of(const OperatorTask& task, RunState state, const char* language = "en") {
  return operator_screen(task, at_state(state), 3600.0, OperatorTexts::of(language));
}

std::string all(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

TEST(OperatorScreen, OneInstructionTheAngleAndTheWay) {
  const OperatorScreen screen = screen_of(a_turn(), RunState::moving);
  EXPECT_EQ(screen.instruction, "Turn pitch to 360°");
  EXPECT_EQ(screen.big, "360");
  EXPECT_EQ(screen.way, "359.98° forward (its angle increases); whole turns to make: 1");
  EXPECT_EQ(screen.step, "Step 3 of 14, 14 % done");
  EXPECT_EQ(screen.left, "Turns left: 46; until about " + local_time(1767229200.0));
  EXPECT_TRUE(screen.wants_hands());
  EXPECT_EQ(operator_screen(a_turn(), at_state(RunState::moving), {}, OperatorTexts::of("en")).left, "Turns left: 46")
      << "a rehearsal has no time of the wall";
  OperatorTask back = a_turn();
  back.target_deg = -90.0;
  EXPECT_EQ(screen_of(back, RunState::moving).way, "90.02° backward (its angle decreases)");
  back.from_deg.reset();
  EXPECT_EQ(screen_of(back, RunState::moving).way, "") << "after a stop in mid-turn nobody knows";
}

TEST(OperatorScreen, HandsOffForAsLongAsTheUnitIsMeasured) {
  RunSnapshot at = at_state(RunState::dwelling);
  at.item_end_utc_s = at.utc_s + 99.2;
  OperatorScreen screen = operator_screen({}, at, 3600.0, OperatorTexts::of("en"));
  EXPECT_EQ(screen.instruction, "Hands off");
  EXPECT_EQ(screen.big, "1:40");
  EXPECT_FALSE(screen.wants_hands());
  EXPECT_EQ(screen_of({}, RunState::settling).instruction, "Hands off: the table comes to rest");
  EXPECT_EQ(screen_of({}, RunState::connecting).instruction, "Please wait");
  OperatorTask task = a_turn();
  task.kind = OperatorTask::Kind::compare;
  EXPECT_EQ(screen_of(task, RunState::moving, "de").instruction, "Hände weg: Ihre Eingabe wird geprüft");
  EXPECT_FALSE(screen_of(task, RunState::moving).wants_hands());
}

TEST(OperatorScreen, TheLastOneSaysThatItIsOver) {
  EXPECT_EQ(all(drawn(last_screen(false, "out/r", OperatorTexts::of("de")), "02:41", usual)),
            "02:41\n\n\x1b[1mDer Lauf ist beendet. Am Tisch ist nichts mehr zu tun.\x1b[0m\n\n"
            "Was gemessen ist, bleibt erhalten. Später fortsetzen mit: turncal resume out/r\n");
  EXPECT_EQ(last_screen(true, "", OperatorTexts::of("en")).instruction,
            "All turns are done. Nothing is left to do at the table.");
  EXPECT_EQ(last_screen(false, "", OperatorTexts::of("en")).how, "") << "nothing to go on with";
}

TEST(OperatorScreen, ThePageGetsTheSame) {
  OperatorTask task = a_turn();
  task.note = "0 is 90 deg away";
  task.wrong = true;
  const std::string json = json_of(screen_of(task, RunState::moving, "zh"));
  for (const char* part :
       {"\"kind\":\"turn\"", "\"wants_hands\":true", "\"big\":\"360\"", "请把俯仰轴转到 360°", "\"axis\":1",
        "\"from_deg\":0.02", "\"wrong\":true", "\"axes\":[\"航向轴\",\"俯仰轴\",\"横滚轴\"]"})
    EXPECT_SAYS(json, part);
}

// In every language what there is to say fits a terminal of 80 by 24, above the line that is typed in.
TEST(OperatorTerminal, EveryTaskFitsInEveryLanguage) {
  for (const char* language : {"en", "de", "zh"}) {
    using enum OperatorTask::Kind;
    for (const OperatorTask::Kind kind : {nothing, where, turn, compare, paused}) {
      OperatorTask task = a_turn();
      task.kind = kind;
      task.target_deg = -360.0;
      task.wrong = true;
      task.note = OperatorTexts::of(language).say(
          "wrong.gravity", {{"away", "90.4"}, {"axis", "roll"}, {"angle", "-90"}, {"most", "5"}});
      const auto lines = drawn(screen_of(task, RunState::moving, language), "[dry run] 02:41", usual);
      EXPECT_LT(lines.size(), 21u) << language << "\n" << all(lines) << "one that is cut off would be 21";
      for (std::string line : lines) {
        for (std::size_t escape; (escape = line.find('\x1b')) != std::string::npos;)
          line.erase(escape, line.find('m', escape) + 1 - escape);
        EXPECT_LT(columns_of(line), 80u) << language << ": " << line;
      }
    }
  }
}

TEST(OperatorTerminal, DrawsWhatChangedAndLeavesWhatIsTypedAlone) {
  std::vector<std::string> written;
  double utc_s = 0.0;
  {
    OperatorTerminal terminal(
        "[dry run] ", [&](const std::string& text) { written.push_back(text); }, usual, [&] { return utc_s; });
    OperatorTask task = a_turn();
    terminal.show(screen_of(task, RunState::moving));
    ASSERT_EQ(written.size(), 1u);
    EXPECT_SAYS(written[0], "0.02 o========================> [360]");
    EXPECT_SAYS(written[0], "[dry run] ");
    EXPECT_TRUE(written[0].ends_with("> \a")) << "the bell";
    terminal.show(screen_of(task, RunState::moving));
    EXPECT_EQ(written.size(), 1u) << "nothing has changed";
    utc_s = 60.0;
    terminal.show(screen_of(task, RunState::moving));
    ASSERT_EQ(written.size(), 2u) << "the clock has";
    EXPECT_TRUE(written[1].starts_with("\0337") && written[1].ends_with("\0338")) << "the cursor stays with the typing";
    task.answers = 1;
    task.wrong = true;
    task.note = "359 is 1 deg away";
    terminal.show(screen_of(task, RunState::moving));
    ASSERT_EQ(written.size(), 3u);
    EXPECT_TRUE(written[2].ends_with("> \a")) << "not taken";
    task.kind = OperatorTask::Kind::compare;
    terminal.show(screen_of(task, RunState::moving));
    ASSERT_EQ(written.size(), 4u);
    EXPECT_EQ(written[3].find('\a'), std::string::npos) << "nobody is wanted";
  }
  EXPECT_EQ(written.back(), "\x1b[22;1H\x1b[J") << "what comes next stands below";
}

// ---- what is left

class StoppedClock : public Clock {
 public:
  double now_s() const override { return 0.0; }
  double utc_s() const override { return 1767225600.0; }
};

TransitionRecord record_of(RunState from, RunEvent event, double time_s, double eta_s) {
  TransitionRecord record;
  record.from = from;
  record.event = event;
  record.at.time_s = time_s;
  record.at.utc_s = 1767225600.0 + time_s;
  record.at.eta_s = eta_s;
  record.at.step_place = record.at.step_count = 1;
  record.at.moves_left = 5;
  return record;
}

// What is said when the next turn is asked for.
std::string left_after(const std::vector<TransitionRecord>& records) {
  const StoppedClock clock;
  std::ostringstream out;
  int input[2];
  if (::pipe(input) != 0) return "no pipe";
  ManualTurntable table(ManualSettings{}, clock, input[0], out, [] { return std::optional<std::array<double, 3>>(); });
  OperatorPrompts prompts(table, 60.0);
  for (const TransitionRecord& record : records) prompts.on_transition(record);
  // The reason stands above whatever question comes next.
  const bool asked = table.connect().ok() && table.enable().ok() && table.home().ok();
  ::close(input[0]);
  ::close(input[1]);
  return asked ? out.str() : "not asked: " + out.str();
}

// After a resume the first settling belongs to no turn: it used to be counted as one that had taken since the beginning of time, and
// more than 17 hours were said of ten minutes.
TEST(OperatorPrompts, SettlingWithoutATurnIsNoTurn) {
  const TransitionRecord settled = record_of(RunState::settling, RunEvent::settled, 12000.0, 600.0);
  const TransitionRecord next = record_of(RunState::selecting, RunEvent::move_next, 12001.0, 600.0);
  // Ten minutes of plan and five turns of a minute.
  EXPECT_SAYS(left_after({settled, next}), "Turns left: 5; until about " + local_time(next.at.utc_s + 900.0));
  // A dwell that is repeated settles once more after the same turn.
  const TransitionRecord turned = record_of(RunState::settling, RunEvent::settled, 12041.0, 590.0);
  const TransitionRecord repeated = record_of(RunState::settling, RunEvent::settled, 12141.0, 590.0);
  const TransitionRecord another = record_of(RunState::selecting, RunEvent::move_next, 12142.0, 590.0);
  // The turn took 40 s, 10 of them planned: 30 s beyond the plan, five times.
  EXPECT_SAYS(left_after({settled, next, turned, repeated, another}),
              "until about " + local_time(another.at.utc_s + 740.0));
}

}  // namespace
}  // namespace turncal
