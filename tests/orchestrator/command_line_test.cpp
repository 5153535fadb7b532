// Every command as a black box: help and version, refusals with one line and exit code 1, nothing left behind.
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

const char* const header = "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n";
const char* const conf =
    "format = 1\nsample_period_s = 0.005\nlatitude_deg = 29.53\ngravity_mps2 = 9.7914\nunit_serial = SN1\n"
    "gyro_increment = pulses\naccel_increment = pulses\naccel_pulse_mps = 0.0005\n";

class CommandLine : public Program {
 protected:
  // A text recording of `samples` rows at rest, one static segment.
  std::string text_recording(const std::string& name, int samples = 4000) const {
    std::string csv = header;
    for (int i = 0; i < samples; ++i) csv += std::to_string(i) + ",0,0,0,0,98,0\n";
    write(name + "/recording.conf", conf);
    write(name + "/imu.csv", csv);
    write(name + "/segments.csv", "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n1,static,0," +
                                      std::to_string(samples) + ",0,0,0\n");
    return path(name);
  }
  std::string demo_run(const std::string& name) const {
    ends(dry_run(name), 0);
    return path(name);
  }
};

TEST_F(CommandLine, WhatWasMeantIsSaid) {
  expect_refused({"run", "--statoin", "x"},
                 "'--statoin' is not understood; did you mean '--station'? (see turncal run --help)");
  expect_refused({"run", "--sequnce=x", "--unit", "A", "--out", "o"}, "did you mean '--sequence'?");
  expect_refused({"--verison"}, "did you mean '--version'?");
  expect_refused({"run", "--nonsense"}, "'--nonsense' is not understood (see turncal run --help)");
  write("s.station", "format = 1\nsite.latitude_dge = 1\n");
  expect_refused("run --dry-run --unit A --out o --station s.station",
                 "s.station:2: key 'site.latitude_dge' is unknown; did you mean 'site.latitude_deg'?");
}

// Of `turncal X --help`: what it lists as commands.
std::vector<std::string> listed(const std::string& help) {
  std::vector<std::string> names;
  for (const std::string& line : lines_of(help.substr(0, help.find("Examples:"))))
    if (line.starts_with("  ") && std::islower(static_cast<unsigned char>(line[2])) != 0)
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
  return names;
}

TEST_F(CommandLine, EveryHelpIsGroupedNarrowAndHasTwoExamples) {
  const std::string help = run("--help").out;
  for (const char* group : {"Station:", "Data:", "Analysis:", "Line:", "Records:"})
    EXPECT_SAYS(help, "\n" + std::string(group) + "\n");
  std::vector<Arguments> commands = {{}};
  for (const std::string& name : listed(help)) commands.push_back({name});
  for (const std::string& action : listed(run("records --help").out)) commands.push_back({"records", action});
  ASSERT_GT(commands.size(), 30u);
  for (const Arguments& command : commands) {
    const std::string text = run(command + "--help").out;
    EXPECT_EQ(run(Arguments{"help"} + command).out, text) << command.line();
    const std::size_t examples = text.find("\nExamples:\n  turncal ");
    ASSERT_NE(examples, std::string::npos) << command.line();
    int count = 0;
    for (const std::string& line : lines_of(text.substr(examples + 11)))
      count += line.starts_with("  turncal ") ? 1 : 0;
    EXPECT_EQ(count, 2) << command.line();
    for (const std::string& line : lines_of(text)) EXPECT_LE(line.size(), 100u) << line;
  }
  EXPECT_EQ(run("-V").out, run("--version").out);
}

// An example whose options are not those of its command would say so before it looks for its files.
TEST_F(CommandLine, ExamplesAreUnderstood) {
  int tried = 0;
  for (const std::string& line :
       lines_of(file_text(std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/commands/examples.txt"))) {
    ASSERT_TRUE(line.starts_with("turncal ") && line.size() <= 98) << line;
    if (line.find("--dry-run") != std::string::npos || line.find(" design ") != std::string::npos) continue;
    const ProgramResult result = run(Arguments(line.substr(8)));
    EXPECT_SAYS_NOT(result.err, "--help)") << line;
    ++tried;
  }
  EXPECT_GT(tried, 50);
}

TEST_F(CommandLine, OldNamesWorkAndSayTheNewOnes) {
  write("runs/readme", "none");
  const ProgramResult old =
      ends({"prune", "runs", "--older-than", "30d", "--list"}, 0, "'turncal prune' is 'turncal records prune' now");
  EXPECT_EQ(old.out, ends("records prune runs --older-than 30d --list", 0).out);
  EXPECT_SAYS(run("database check none.db").err, "'turncal database' is 'turncal records' now");
  expect_refused("records chek none.db",
                 "'chek' is not understood; did you mean 'check'? (see turncal records --help)");
  expect_refused("help calibrat", "'calibrat' is not understood; did you mean 'calibrate'? (see turncal --help)");
  expect_refused("help records chek", "did you mean 'check'? (see turncal records --help)");
  expect_refused("hlep run", "'hlep' is not understood; did you mean 'help'? (see turncal --help)");
  expect_refused("run --settle 2h", "--settle: '2h': expected a time from 0min to 60min, with its unit");
  expect_refused("calibrate x --out y --method jiont",
                 "'jiont': expected joint, closed-form; did you mean 'joint'? (see turncal calibrate --help)");
}

TEST_F(CommandLine, QuietPrintsNothingButErrors) {
  const ProgramResult good =
      ends({"run", "--quiet", "--dry-run", "--unit", "SN1", "--out", "o", "--sequence", short_demo}, 0);
  EXPECT_EQ(good.out, "");
  EXPECT_EQ(good.err, "");
  EXPECT_SAYS(file_text(folder_ / "o/run.log"), "moving -> settling");
  const ProgramResult bad =
      ends({"run", "--quiet", "--dry-run", "--unit", "SN1", "--out", "o", "--sequence", short_demo}, 1);
  EXPECT_EQ(bad.out, "");
  EXPECT_EQ(bad.err_lines(), 1) << bad.err;
  expect_refused({"run", "--quiet", "--manual", "--dry-run", "--unit", "SN1", "--out", "by_hand"},
                 "--quiet: expected none with a table");
}

TEST_F(CommandLine, BadRecordingsAreRefusedByEveryCommand) {
  struct Case {
    std::string name, file, text, message;
  };
  std::string rows = header;
  for (int i = 0; i < 4000; ++i) rows += std::to_string(i) + (i == 100 ? ",0,nan,0,0,98,0\n" : ",0,0,0,0,98,0\n");
  const std::string segments = "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n";
  const std::vector<Case> cases = {
      {"empty_csv", "imu.csv", "", "imu.csv"},
      {"nan", "imu.csv", rows, "imu.csv:102"},
      {"empty_conf", "recording.conf", "", "recording.conf"},
      {"unknown_key", "recording.conf", std::string(conf) + "colour = red\n", "colour"},
      {"overlap", "segments.csv", segments + "1,static,0,3000,0,0,0\n1,static,2999,4000,0,0,0\n", "segments.csv"},
      {"kind", "segments.csv", segments + "1,resting,0,4000,0,0,0\n", "segments.csv:2"},
  };
  for (const Case& c : cases) {
    const std::string recording = text_recording(c.name);
    write(c.name + "/" + c.file, c.text);
    expect_refused({"import", recording, "--out", "out"}, c.message);
    expect_refused({"calibrate", recording, "--out", "out"}, c.message);
    expect_refused({"calibrate", recording, "--out", "out/deep/down", "--method", "closed-form"}, c.message);
  }
  const std::string moving = text_recording("no_rest");
  write("no_rest/segments.csv", segments + "1,rotate,0,4000,0,90,0\n");
  expect_refused({"calibrate", moving, "--out", "out"}, "not one whole second at rest");
  expect_refused({"calibrate", moving, "--partial", "--out", "out"}, "not one whole second at rest");
  expect_refused({"diagnose", moving, "--out", "out"}, "no_rest: not one whole second at rest");
  const std::string unreadable = text_recording("cut");
  std::filesystem::remove(folder_ / "cut/imu.csv");
  expect_refused({"import", unreadable, "--out", "out"}, "imu.csv");
}

TEST_F(CommandLine, CalibrateGivesWhatTheRunGave) {
  const std::string demo = demo_run("demo");
  const ProgramResult again = ends({"calibrate", demo, "--out", "again"}, 0);
  EXPECT_TRUE(again.out.starts_with("verdict         Calibrated; parameters trusted\nreason  ")) << again.out;
  EXPECT_TRUE(again.out.ends_with("\nopen again/report.html\n")) << again.out;
  EXPECT_SAYS(file_text(folder_ / "again/report.html"), "Calibrated; parameters trusted");
  const auto values = [&](const std::string& name) {
    std::string kept;
    for (const std::string& line : lines_of(file_text(folder_ / name / "parameters.conf"))) {
      // record.*: what only the run knows.
      if (!line.starts_with("time_utc") && !line.starts_with("checksum") && !line.starts_with("record."))
        kept += line + "\n";
    }
    return kept;
  };
  EXPECT_EQ(values("again"), values("demo"));
}

TEST_F(CommandLine, SeveralRecordingsAreOfOneUnitAndDiffer) {
  const std::string demo = demo_run("demo");
  expect_refused({"calibrate", demo, demo, "--out", "out"}, "is given twice");
  write("again.rig", "noise.seed = 5\n");
  ASSERT_EQ(run(dry_run("sn1", {"--capture-only", "--rig", "again.rig"})).code, 0);
  ASSERT_EQ(run(dry_run("sn2", {"--capture-only"}, "SN2")).code, 0);
  expect_refused({"calibrate", "sn1", "sn2", "--out", "out"}, "unit_serial = 'SN2': expected 'SN1', as in sn1");
  expect_refused({"calibrate", "sn1", demo, "--method", "closed-form", "--out", "out"}, "expected joint");
}

// A step that no model fits takes the noise so high that it hides the earth's rate.
TEST_F(CommandLine, DataThatDoNotFitAreSaidWhereTheyHideWhatIsAskedFor) {
  write("step.rig",
        "outside.gyro_bias_step.axis = x\noutside.gyro_bias_step.time_s = 400\n"
        "outside.gyro_bias_step.size_degph = 3000\n");
  ASSERT_EQ(run(dry_run("step", {"--capture-only", "--rig", "step.rig"})).code, 0);
  const ProgramResult result = ends({"calibrate", "step", "--out", "out"}, 20, "does not determine N0");
  EXPECT_SAYS_NOT(result.err, "expected the steps that do");
}

// verify.seq keeps the table level: most parameters stay open.
TEST_F(CommandLine, WhatIsNotDeterminedIsSaidAndNotUsed) {
  const std::string demo = demo_run("demo");
  write("noise.rig", "noise.seed = 104\n");
  const Arguments level = "run --dry-run --unit SN1 --capture-only --rig noise.rig --out level --sequence";
  ends(level + (TURNCAL_SOURCE_DIR "/sequences/verify.seq"), 0);
  expect_refused({"calibrate", "level", "--out", "out"}, "does not determine N01 A01", 20);
  ASSERT_EQ(run({"calibrate", "level", "--partial", "--out", "part"}).code, 0);
  const std::string file = file_text(folder_ / "part/parameters.conf");
  EXPECT_SAYS(file, "\nquality.undetermined = N01 A01 A02 A03 ");
  EXPECT_SAYS(file, "\nquality.trusted = false\n");
  const std::string said = "did not determine N01 A01 A02 A03", part = path("part/parameters.conf");
  expect_refused({"apply", "level", "--parameters", part, "--out", "out.csv"}, said);
  expect_refused({"navigate", "level", "--parameters", part, "--out", "out"}, said);
  expect_refused({"verify", "--recording", "level", "--parameters", part, "--out", "out"}, said);
  expect_refused({"convert", part, "--header", "out.h"}, said);
  // It goes with a recording that determines all, and what open directions make of its own fit does not pass for a contradiction.
  ends({"calibrate", demo, "level", "--out", "both"}, 0);
  EXPECT_SAYS(file_text(folder_ / "both/parameters.conf"), "\nquality.trusted = true\n");
}

TEST_F(CommandLine, AnotherUnitUnderTheSameSerialIsNotTrusted) {
  const std::string demo = demo_run("demo");
  write("other.rig", "seed = 77\n");
  ASSERT_EQ(run(dry_run("other", {"--capture-only", "--rig", "other.rig"})).code, 0);
  const ProgramResult both =
      ends({"calibrate", demo, "other", "--out", "both"}, 20, "not trusted: the recordings contradict each other");
  EXPECT_SAYS(file_text(folder_ / "both/parameters.conf"), "\nquality.trusted = false\n");
}

TEST_F(CommandLine, OnlyResultsOfTheSameUnitAreReplaced) {
  const std::string demo = demo_run("demo");
  ASSERT_EQ(run(dry_run("other", {}, "SN2")).code, 0);
  ASSERT_EQ(run({"calibrate", demo, "--out", "out"}).code, 0);
  const std::string first = file_text(folder_ / "out/parameters.conf");
  const std::string of_run = file_text(folder_ / "other/parameters.conf");
  expect_refused({"calibrate", demo, "--out", demo}, "expected another folder than that of the source");
  for (const char* command : {"calibrate", "diagnose"}) {
    expect_refused({command, "other", "--out", "out"}, "is of unit 'SN1', not of 'SN2'");
    expect_refused({command, demo, "--out", "other"}, "holds a run (journal.tcj)");
  }
  EXPECT_EQ(file_text(folder_ / "out/parameters.conf"), first);
  EXPECT_EQ(file_text(folder_ / "other/parameters.conf"), of_run);
  write("damaged/parameters.conf", first.substr(0, first.size() / 2));
  expect_refused({"calibrate", demo, "--out", "damaged"}, "damaged/parameters.conf");
  ASSERT_EQ(run({"calibrate", demo, "--out", "out"}).code, 0);
}

TEST_F(CommandLine, ApplyRefusesWhatDoesNotBelong) {
  const std::string demo = demo_run("demo");
  const std::string good = file_text(folder_ / "demo/parameters.conf");
  const auto apply = [&](const std::string& file) {
    return std::vector<std::string>{"apply", demo, "--parameters", file, "--out", "out.csv"};
  };
  expect_refused({"apply", demo, "--parameters", demo + "/parameters.conf", "--out", demo + "/journal.tcj"},
                 "expected a name that ends in one of");
  std::string digit = good;
  digit[digit.find("N01 = ") + 9] ^= 1;
  expect_refused(apply(write("digit.conf", digit)), "checksum");
  std::string missing = good;
  const std::size_t at = missing.find("a22 = ");
  missing.erase(at, missing.find('\n', at) - at + 1);
  expect_refused(apply(write("missing.conf", missing)), "");
  expect_refused(apply(write("empty.conf", "")), "empty.conf");
  expect_refused(apply("nowhere.conf"), "nowhere.conf");
  // Another unit's recording.
  ASSERT_EQ(run(dry_run("other", {"--capture-only"}, "SN2")).code, 0);
  expect_refused({"apply", path("other"), "--parameters", demo + "/parameters.conf", "--out", "out.csv"}, "SN2");
  // Nowhere to write to.
  expect_refused({"apply", demo, "--parameters", demo + "/parameters.conf", "--out", "no/such/folder/out.csv"},
                 "folder");
  expect_refused({"apply", demo, "--parameters", demo + "/parameters.conf", "--out", demo},
                 "expected a name that ends in one of");
}

}  // namespace
}  // namespace turncal
