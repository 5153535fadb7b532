// A run by hand, rehearsed: `run --manual --dry-run` with an operator who reads the questions and types.

#include "orchestrator/records/journal.h"
#include "tests/orchestrator/operator_session.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class ByHand : public OperatedProgram {
 protected:
  void SetUp() override {
    OperatedProgram::SetUp();
    write("short.seq",
          "format = 1\nname = short\nrate_degps = 30\nacceleration_degps2 = 60\n"
          "step 1 \"up and down\"\n  initial H 0 P 0 R 0\n  align 1000\n  rotate P +90\n  dwell 1000\n"
          "step 2 \"on the side\"\n  initial H 0 P 0 R 0\n  align 1000\n  rotate R -90\n  dwell 1000\n");
    station("");
  }
  void station(const std::string& more) const { write("hand.station", station_head + "resume.rest_s = 20\n" + more); }
  static Arguments short_run() {
    return "run --manual --dry-run --unit SN1 --out r --station hand.station --sequence short.seq --capture-only";
  }
  static std::string text(double angle_deg) {
    char shown[40];
    std::snprintf(shown, sizeof shown, "%.3f", angle_deg);
    return shown;
  }
  // Does what it is told, to 0.05 deg.
  struct Careful {
    std::mt19937 random{7};
    int asked = 0;
    std::optional<std::string> operator()(const std::string& line) {
      const auto q = question(line);
      if (!q) return {};
      ++asked;
      return text(q->target_deg + std::uniform_real_distribution<double>(-0.05, 0.05)(random));
    }
  };
  std::size_t dwells_done() const {
    const auto journal = read_journal(path("r/journal.tcj"));
    EXPECT_TRUE(journal.ok());
    return journal.ok() && journal->last_dwell ? journal->last_dwell->item : 0;
  }
  void expect_resumed_to_the_end(int code = 0) const {
    Careful careful;
    const Session session = operate({"resume", "r"}, std::ref(careful));
    EXPECT_EQ(session.code, code) << session.err << session.out;
    EXPECT_GE(careful.asked, 3) << "it asks where the table stands";
    EXPECT_TRUE(fs::exists(folder_ / "r/recording.tcr"));
  }
  static void expect_tagged(const std::string& output) {
    for (const std::string& line : lines_of(output)) EXPECT_TRUE(line.starts_with("[dry run]")) << line;
  }
};

// The estimator must not take the table's word: 0.05 deg are 180 arcsec, a thousand times the sigma of a misalignment.
TEST_F(ByHand, FourteenStepsGiveTheUnitsParametersWhateverTheAnglesAre) {
  Careful careful;
  const Session session =
      operate({"run", "--manual", "--dry-run", "--unit", "SN1", "--out", "r", "--no-diagnosis"}, std::ref(careful));
  ASSERT_EQ(session.code, 0) << session.err;
  EXPECT_GT(careful.asked, 55);
  auto found = entries(file_text(path("r/parameters.conf")));
  int compared = 0;
  for (const auto& [key, value] : entries(file_text(path("r/truth.conf")))) {
    if (!found.contains("sigma." + key)) continue;
    ++compared;
    EXPECT_LE(std::abs(std::stod(found[key]) - std::stod(value)), 4.0 * std::stod(found["sigma." + key])) << key;
  }
  EXPECT_EQ(compared, 21);
  EXPECT_LT(std::stod(found["sigma.n12"]), 1e-5) << "arcsec a pulse of 0.93";
  expect_tagged(session.out);
}

// The dial reads 0 before and after: gravity and typed angle agree with a turn that nobody made.
TEST_F(ByHand, AWholeTurnThatWasNotMadeIsAskedForAgain) {
  for (const std::string axis : {"P", "H"}) {
    write("short.seq",
          "format = 1\nname = whole\nrate_degps = 30\nacceleration_degps2 = 60\nstep 1 \"whole turns\"\n"
          "  initial H 0 P 0 R 0\n  align 1000\n  rotate " +
              axis + " +360\n  dwell 1000\n  rotate " + axis + " -360\n  dwell 1000\n");
    int objections = 0, turns = 0;
    const Session session = operate(short_run(), [&](const std::string& line) -> std::optional<std::string> {
      if (line.find("The gyros measured ") != std::string::npos) {
        ++objections;
        const bool first = objections == 1;
        EXPECT_SAYS(line, first ? "measured 0 deg of the 360 deg" : "measured 0 deg of the -360 deg");
        EXPECT_SAYS(line, first ? " another 360 deg forward" : " another 360 deg backward");
        return objections == 1 ? "360,0" : "0,02";
      }
      const auto q = question(line);
      if (!q) return {};
      if (q->homing) return "0";
      return ++turns == 1 ? "say 360" : "say 0";
    });
    EXPECT_EQ(session.code, 0) << session.err << session.out;
    EXPECT_EQ(objections, 2) << axis << session.out;
    fs::remove_all(folder_ / "r");
  }
}

// However the operator ends it, at whichever question: the run says how, and is resumed to its end. Nothing turns by itself, so a pause does
// not wait for the turn.
TEST_F(ByHand, WhatEndsAtAQuestionIsResumedToTheEnd) {
  const std::string interrupt = "\x03";
  struct Row {
    int at;
    std::string reply;
    int code;
    const char* says;
  };
  std::vector<Row> rows = {{1, interrupt, 75, "paused"},
                           {4, interrupt, 75, "paused"},
                           {4, "skip the clamp is jammed", 75, "the clamp is jammed"},
                           {4, "abort", 30, "stopped by the operator"}};
  for (int at = 1; at <= 6; ++at) rows.push_back({at, hang_up, 75, "end of input"});
  for (const Row& row : rows) {
    SCOPED_TRACE(row.says + std::string(" at ") + std::to_string(row.at));
    Careful careful;
    const Session session = operate(short_run(), [&](const std::string& line) -> std::optional<std::string> {
      const auto reply = careful(line);
      if (careful.asked != row.at || !reply) return reply;
      if (row.reply != interrupt) return row.reply;
      ::kill(pid_, SIGINT);
      return {};
    });
    EXPECT_EQ(session.code, row.code) << session.err << session.out;
    EXPECT_SAYS(session.err, row.says);
    EXPECT_SAYS(session.out + session.err, "resume with: turncal resume r");
    expect_tagged(session.out + session.err);
    expect_resumed_to_the_end();
    fs::remove_all(folder_ / "r");
  }
}

TEST_F(ByHand, PauseAndLeaveAndGoOnAnotherDay) {
  Careful careful;
  const Session session = operate(short_run(), [&](const std::string& line) -> std::optional<std::string> {
    if (line.find("Paused. Leave the table") != std::string::npos) return "leave";
    auto reply = careful(line);
    return careful.asked == 5 && reply ? "pause" : reply;
  });
  EXPECT_EQ(session.code, 75) << session.out;
  EXPECT_SAYS(session.err, "the operator left");
  const std::size_t done = dwells_done();
  EXPECT_GT(done, 0u);
  // Whoever comes back reads the angles off instead of turning everything to 0.
  Careful later;
  int asked = 0;
  const Session resumed = operate({"resume", "r"}, [&](const std::string& line) -> std::optional<std::string> {
    const auto q = question(line);
    if (q && q->homing) return ++asked, q->axis == "pitch" ? "30" : "0";
    return later(line);
  });
  EXPECT_EQ(resumed.code, 0) << resumed.err << resumed.out;
  EXPECT_EQ(asked, 3);
  EXPECT_SAYS(file_text(folder_ / "r/run.log"), "rests for 20 s");
  EXPECT_SAYS(resumed.out, "Turn pitch from 30 to 90 deg") << "back to where the last dwell stood";
  EXPECT_GT(dwells_done(), done);
  expect_tagged(resumed.out);
}

TEST_F(ByHand, NoAnswerPausesWaitsWithoutSpinningAndLeaves) {
  station("table.answer_timeout_s = 1\ntable.pause_limit_s = 2\n");
  Careful careful;
  int paused = 0;
  const Session session = operate(short_run(), [&](const std::string& line) -> std::optional<std::string> {
    const bool pause = line.find("No answer for 1 s: paused.") != std::string::npos;
    if (pause && ++paused == 1) return "continue";
    auto reply = careful(line);
    if (careful.asked == 4 || careful.asked == 5) reply.reset();
    return reply;
  });
  EXPECT_EQ(session.code, 75) << session.out;
  EXPECT_EQ(paused, 2);
  EXPECT_SAYS(session.err, "paused for longer than 2 s");
  // The rig's time stands still meanwhile: "...Z      22.605 s  step". A loop that spins passes hours of it.
  const std::string log = file_text(folder_ / "r/run.log");
  const std::size_t unit = log.find(" s  step", log.rfind("Z  ", log.find("stopping -> interrupted")));
  ASSERT_NE(unit, std::string::npos) << log;
  EXPECT_LT(std::strtod(log.substr(unit - 11, 11).c_str(), nullptr), 100.0);
  expect_resumed_to_the_end();
}

}  // namespace
}  // namespace turncal
