// `turncal navigate` as a program: what it writes, and what it refuses.

#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

TEST_F(Navigate, TrueParametersStayWhereTheyAreAndWrongOnesDoNot) {
  record_rest_and_truth();
  write_truth("rest", "wrong.conf", 1, 0.1);  // N02, the gyro that points up: 0.1 deg/h
  const ProgramResult navigated =
      ends("navigate rest --parameters true.conf --against wrong.conf --out nav --for 1500 --branches 3", 0);
  EXPECT_EQ(navigated.err, "");
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.integer("branches"), 3);
  EXPECT_EQ(conf.integer("against.branches"), 3);
  EXPECT_NEAR(conf.number("branch.1.heading_deg"), 30.0, 1e-3);
  EXPECT_NEAR(conf.number("branch.1.pitch_deg"), 0.0, 1.3e-4);  // half a gyro pulse
  EXPECT_NEAR(conf.number("branch.1.roll_deg"), 0.0, 1.3e-4);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.05);  // of counting in pulses
  // Until the first turn the alignment hides a constant gyro error up in nothing: the heading drifts by w t, and with it the Earth's
  // rate east by W cos L w t: v_N' = -g W cos L w t^2 / 2, 2 m/s after 1500 s, less by Schuler's feedback.
  EXPECT_GT(conf.number("against.drift.rms_nm_per_h"), 20.0 * conf.number("drift.rms_nm_per_h"));
  EXPECT_EQ(conf.text("expected.from"), "none");
  EXPECT_GT(conf.number("expected.cep_nm_per_h"), 0.0);
  // A row a second and branch, and the start.
  const std::string track = file_text(folder_ / "nav/track.csv");
  EXPECT_EQ(std::count(track.begin(), track.end(), '\n'), 1 + 3 * 1501);
  EXPECT_EQ(std::count(track.begin(), track.begin() + static_cast<std::ptrdiff_t>(track.find('\n')), ','), 10);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "nav/track_against.csv"));
  const std::string page = file_text(folder_ / "nav/navigation.html");
  for (const char* part : {"<b>Drift:</b> rms ", "<svg", "</i> first start<", "</i> compared with<"})
    EXPECT_SAYS(page, part);
  // What docs/examples has for it reads the same rates.
  if (std::system("python3 -c 'import numpy' 2> /dev/null") == 0) {
    const std::string command = std::string("python3 ") + TURNCAL_SOURCE_DIR + "/docs/examples/read_track.py " +
                                path("nav/track.csv") + " > " + path("nav/read");
    ASSERT_EQ(std::system(command.c_str()), 0);
    const std::string read = file_text(folder_ / "nav/read");
    for (int k = 1; k <= 3; ++k) {
      char rate[40];
      std::snprintf(rate, sizeof rate, ", %.3f NM/h\n", conf.number("branch." + std::to_string(k) + ".nm_per_h"));
      EXPECT_SAYS(read, rate);
    }
  }
  // Again, in the same folder: the same bytes.
  const std::string before = file_text(folder_ / "nav/navigation.conf");
  EXPECT_EQ(run("navigate rest --parameters true.conf --against wrong.conf --out nav --for 1500 --branches 3").code, 0);
  EXPECT_EQ(file_text(folder_ / "nav/navigation.conf"), before);
  // Without the other file nothing of it is left.
  EXPECT_EQ(run("navigate rest --parameters true.conf --out nav --branches 1").code, 0);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "nav/track_against.csv"));
}

// Nothing is aligned or navigated over more than two lost samples.
TEST_F(Navigate, LostSamplesEndABranch) {
  record_rest_and_truth();
  const auto navigate = [&](const std::string& recording) {
    return run(
        {"navigate", recording, "--parameters", path("true.conf"), "--out", "nav", "--for", "1500", "--branches", "1"});
  };
  const std::int64_t first = segments_of("rest").front().start_sample;
  lose("rest", first + 150000, 1, "one");
  const ProgramResult one = navigate("one");
  ASSERT_EQ(one.code, 0) << one.err;
  EXPECT_SAYS(one.out, "1 samples lost or bad");
  EXPECT_EQ(result("nav/navigation.conf").number("branch.1.free_s"), 1500.0);
  EXPECT_LT(result("nav/navigation.conf").number("drift.rms_nm_per_h"), 0.05);
  // 300 s of alignment and 950 s: more than half of what was asked for.
  lose("rest", first + 250000, 1000, "late");
  const ProgramResult late = navigate("late");
  ASSERT_EQ(late.code, 0) << late.err;
  const std::string said = "1000 samples lost from sample " + std::to_string(first + 250000) + " on";
  EXPECT_SAYS(late.out, "branch from 0 s ends early: " + said);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_NEAR(conf.number("branch.1.free_s"), 950.0, 0.2);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.05);
  EXPECT_EQ(conf.text("lost.1"), "branch from 0 s ends early: " + said);
  // In the alignment: there is no such branch.
  lose("rest", first + 20000, 1000, "early");
  std::filesystem::remove_all(folder_ / "nav");
  expect_refused("navigate early --parameters true.conf --out nav --for 1500 --branches 1",
                 "branch from 0 s left out: 1000 samples lost from sample " + std::to_string(first + 20000) + " on");
}

TEST_F(Navigate, SamplesLostInATurnAreCountedThere) {
  record_rest_and_truth();
  const Segments segments = segments_of("rest");
  const auto turn = std::find_if(segments.begin(), segments.end(), [&](const Segment& s) {
    return s.kind == SegmentKind::rotate && s.start_sample > segments.front().start_sample + 100000;
  });
  ASSERT_NE(turn, segments.end());
  // From the rest before to the rest after it: 100 and 200 samples of them.
  const std::int64_t length = turn->end_sample - turn->start_sample;
  lose("rest", turn->start_sample - 100, length + 300, "turn");
  const ProgramResult navigated = ends("navigate turn --parameters true.conf --out nav --for 600", 0);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.integer("filled_samples"), length + 300);
  EXPECT_EQ(conf.integer("filled_in_motion"), length);
  EXPECT_SAYS_NOT(navigated.out, "LATITUDE");
  EXPECT_NEAR(conf.number("felt_latitude_deg"), 29.53, 0.01);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.1);
}

TEST_F(Navigate, EffectsOfTheFileAreTakenOff) {
  record_rest("g", "effect.gyro_g_sensitivity.zx = 0.5\n");
  write_truth("g", "plain.conf");
  ParameterFile file = *read_parameter_file(path("plain.conf"));
  file.effects.push_back({"gyro_g_sensitivity", "zx", 0.5, 0.01});
  file.model = "extended";
  keep(file, "effect.conf");
  ASSERT_EQ(run("navigate g --parameters effect.conf --against plain.conf --out nav --branches 1").code, 0);
  KeyValueFile conf = result("nav/navigation.conf");
  // Nose up for 300 s, 0.5 deg/h tilt it by 7e-4 rad: 7 mm/s^2 from then on.
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.05);  // of counting in pulses
  EXPECT_GT(conf.number("against.drift.rms_nm_per_h"), 0.1);
}

TEST_F(Navigate, WithoutSegmentsEverythingCountsAsRest) {
  record_rest_and_truth();
  ASSERT_EQ(run("export rest --out text").code, 0);
  const std::string segments = file_text(folder_ / "text/segments.csv");
  write("text/segments.csv", segments.substr(0, segments.find('\n') + 1));
  const ProgramResult navigated = ends("navigate text --parameters true.conf --out nav --to 900 --align 200", 0);
  EXPECT_SAYS(navigated.out, "no segments: everything counts as rest");
  EXPECT_EQ(result("nav/navigation.conf").number("branch.1.free_s"), 700.0);
}

TEST_F(Navigate, RefusesWhatItCannotUse) {
  record_rest_and_truth();
  const auto with = [](const Arguments& more) { return "navigate rest --parameters true.conf --out nav" + more; };
  expect_refused("navigate rest --out nav", "--parameters");
  expect_refused("navigate rest --parameters nothing.conf --out nav", "nothing.conf");
  expect_refused("navigate nothing --parameters true.conf --out nav", "nothing");
  expect_refused("navigate rest --parameters true.conf --out rest", "rest");
  expect_refused("navigate rest --parameters true.conf --out true.conf", "true.conf");
  expect_refused(with({"--align", "5000"}), "s to navigate, expected more than 5000 s");
  expect_refused(with({"--for", "5000"}), "s to navigate, expected more than 5300 s");
  expect_refused(with({"--from", "700", "--to", "600"}), "--to 600 s: expected more than --from, 700 s");
  expect_refused(with({"--from", "1e300"}), "--from");
  expect_refused(with({"--from", "1900"}), "s to navigate, expected more than 300 s");
  expect_refused(with({"--align", "nan"}), "--align");
  expect_refused(with({"--branches", "0"}), "--branches");
  expect_refused(with({"--against", "nothing.conf"}), "nothing.conf");
  std::string other = file_text(folder_ / "true.conf");
  other.replace(other.find("n11"), 3, "n99");
  write("damaged.conf", other);
  expect_refused("navigate rest --parameters damaged.conf --out nav", "damaged.conf");
}

// The unit's nose down: heading is not defined, and what is said of it says so.
TEST_F(Navigate, NoseDownHasNoHeading) {
  record("down", without_noise, "step 1\n  initial H 0 P -90 R 0\n  align 60000\n  dwell 20000\n");
  write_truth("down", "true.conf");
  ASSERT_EQ(run("navigate down --parameters true.conf --out nav --branches 1").code, 0);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_NEAR(conf.number("branch.1.pitch_deg"), -90.0, 0.1);
  EXPECT_GT(conf.number("branch.1.sigma.heading_deg"), 3.0);
  EXPECT_LE(conf.number("branch.1.sigma.heading_deg"), 104.0);
}

TEST_F(Navigate, SaysWhatSpeaksAgainstTheFile) {
  record_rest("rest");
  ParameterFile file = truth_of("rest");
  file.add_further("quality.trusted", std::string("false"));
  keep(file, "doubtful.conf");
  const ProgramResult navigated = ends("navigate rest --parameters doubtful.conf --out nav", 0);
  EXPECT_SAYS(navigated.out, "NOT TRUSTED");
  EXPECT_NEAR(result("nav/navigation.conf").number("felt_latitude_deg"), 29.53, 0.01);
  EXPECT_EQ(result("nav/navigation.conf").text("trusted"), "false");
  // The recording says another latitude than the one that the unit turns with.
  ASSERT_EQ(run("export rest --out text").code, 0);
  std::string conf = file_text(folder_ / "text/recording.conf");
  conf.replace(conf.find("29.53"), 5, "39.53");
  write("text/recording.conf", conf);
  const ProgramResult elsewhere = ends("navigate text --parameters doubtful.conf --out away", 0);
  EXPECT_SAYS(elsewhere.out, "LATITUDE        29.5");
  // Parameters are of increments over a period.
  file.sample_period_s = 0.0025;
  keep(file, "faster.conf");
  expect_refused("navigate rest --parameters faster.conf --out fast", "'sample_period_s' = '0.0025': expected 0.005");
}

// A bias and its drift are estimated together: the sigma of the bias alone promises miles that nobody drifts.
TEST_F(Navigate, ExpectsOfAFileWithEffectsWhatItCanKnow) {
  record_rest("rest");
  ParameterFile file = truth_of("rest");
  for (int k = 0; k < 3; ++k) file.sigma[static_cast<std::size_t>(k)] = 0.2;
  keep(file, "base.conf");
  file.effects.push_back({"gyro_bias_drift", "x", 0.0, 0.2});
  file.model = "extended";
  keep(file, "effect.conf");
  ASSERT_EQ(run("navigate rest --parameters effect.conf --against base.conf --out nav --branches 1").code, 0);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.text("expected.from"), "effects");
  EXPECT_EQ(conf.text("against.expected.from"), "sigmas");
  EXPECT_GT(conf.number("against.expected.rms_nm_per_h"), 5.0 * conf.number("expected.rms_nm_per_h"));
}

TEST_F(Navigate, AFullDiskLeavesNothing) {
  record_rest_and_truth();
  const Arguments arguments = "navigate rest --parameters true.conf --out nav";
  const long points = count_points(arguments);
  std::filesystem::remove_all(folder_ / "nav");
  const std::set<std::string> before = everything();
  ASSERT_GT(points, 5);
  for (long point = 1; point <= points; ++point) {
    const ProgramResult full = run_struck(arguments, point, "full");
    std::filesystem::remove(folder_.string() + ".count");
    const bool written = std::filesystem::exists(folder_ / "nav/navigation.conf");
    EXPECT_EQ(full.code == 0, written) << point << full.err;
    if (!written) {
      EXPECT_EQ(full.code, 50) << point;
      EXPECT_EQ(full.err_lines(), 1) << full.err;
      EXPECT_EQ(everything(), before) << point;
    }
    std::filesystem::remove_all(folder_ / "nav");
  }
}

TEST_F(Navigate, IsPredictedFromASequence) {
  const std::string sequence = std::string(TURNCAL_SOURCE_DIR) + "/sequences/fourteen_step.seq";
  const auto row = [](const std::string& text, const std::string& name) {
    const std::size_t at = text.find(name);
    return at == std::string::npos ? -1.0 : std::stod(text.substr(at + name.size()));
  };
  const ProgramResult hour = ends("predict --sequence " + sequence + " --navigate 1h", 0);
  // Angle random walk N over the alignment T: N / (W cos L sqrt(T)) = 0.0303 deg; velocity noise, and the calibration, add to it.
  EXPECT_GT(row(hour.out, "heading after alignment, deg"), 0.0303);
  EXPECT_LT(row(hour.out, "heading after alignment, deg"), 0.0303 * 1.2);
  EXPECT_GT(row(hour.out, "rms, NM/h"), row(hour.out, "from noise alone, NM/h"));
  EXPECT_EQ(run("predict --sequence " + sequence + " --navigate 60min").out, hour.out);
  EXPECT_EQ(run("predict --sequence " + sequence + " --navigate 3600").out, hour.out);
  // An alignment four times as long halves the heading's sigma from noise.
  const ProgramResult longer = run("predict --sequence " + sequence + " --navigate 1h --align 1200");
  EXPECT_NEAR(row(longer.out, "heading after alignment, deg"), 0.5 * row(hour.out, "heading after alignment, deg"),
              0.004);
  for (const char* bad : {"0", "25h", "2d", "h", "nan", "-1h"})
    expect_refused("predict --sequence " + sequence + " --navigate " + bad, "--navigate");
}

}  // namespace
}  // namespace turncal
