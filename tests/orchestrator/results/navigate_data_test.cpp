// `turncal navigate` on data that no unit gives, or that are not what they are called.

#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

// A garbled word is no motion: without it the unit goes where it goes without the fault, and the output says what was set aside.
TEST_F(Navigate, SamplesThatCannotBeAreSetAside) {
  record_rest_and_truth();
  const auto miles = [this](const std::string& recording, std::size_t faults, const std::string& words) {
    const ProgramResult navigated =
        ends({"navigate", recording, "--parameters", path("true.conf"), "--out", "nav", "--branches", "1"}, 0);
    KeyValueFile conf = result("nav/navigation.conf");
    EXPECT_EQ(conf.integer("filled_samples"), static_cast<std::int64_t>(faults)) << recording;
    EXPECT_EQ(conf.keys_with_prefix("fault.").size(), faults) << recording;
    EXPECT_SAYS(navigated.out, words);
    return conf.number("drift.rms_nm_per_h");
  };
  const double clean = miles("rest", 0, "drift");
  for (const char* value : {"20000", "-2147483647"}) {  // 5 deg in a sample, and what no table turns
    retell("rest", "hit", [&](std::int64_t counter, std::vector<std::string>& cells) {
      if (counter == 90000) cells[1] = value;
    });
    const std::string words = std::string("glitch: gyro x gave ") + value + " in sample 90000 (450.000 s): set aside";
    EXPECT_NEAR(miles("hit", 1, words), clean, 0.02) << value;
  }
  retell("rest", "hit", [](std::int64_t counter, std::vector<std::string>& cells) {
    if (counter == 90000) cells[5] = "2000";  // 1 m/s
  });
  EXPECT_NEAR(miles("hit", 1, "glitch: accelerometer y gave 2000 in sample 90000"), clean, 0.02);
}

// A table that stands at zero throughout is no hand.
TEST_F(Navigate, SamplesThatCannotBeAreSetAsideWhereTheTableStandsAtZero) {
  record("rest", std::string(without_noise) + "seed = 31\n",
         "step 1\n  initial H 0 P 0 R 0\n  align 60000\n  dwell 140000\n");
  write_truth("rest", "true.conf");
  retell("rest", "hit", [&](std::int64_t counter, std::vector<std::string>& cells) {
    if (counter == 90000) cells[1] = "20000";
  });
  for (const char* recording : {"rest", "hit"}) {
    ends({"navigate", recording, "--parameters", path("true.conf"), "--out", "nav", "--branches", "1"}, 0);
    EXPECT_LT(result("nav/navigation.conf").number("drift.rms_nm_per_h"), 0.05) << recording;
  }
}

// A counter that jumps is no time to be navigated through, and what turns is no rest, whatever it is called.
TEST_F(Navigate, NoRestAndNoDayIsMadeUp) {
  record_rest_and_truth();
  retell("rest", "jump", [](std::int64_t counter, std::vector<std::string>& cells) {
    if (counter > 90000) cells[0] = std::to_string(counter + 200'000'000);
  });
  expect_refused("navigate jump --parameters true.conf --out nav",
                 "200000000 samples lost from sample 90001 on: expected a recording that lost less than a day");
  retell("rest", "turning", [](std::int64_t, std::vector<std::string>& cells) { cells[3] = "96"; });  // 5 deg/s about z
  expect_refused("navigate turning --parameters true.conf --out nav",
                 "the unit rests nowhere for 20 s of 300 s of alignment");
}

// A branch begins where an alignment can be made, so that one near a turn does not spoil the others.
TEST_F(Navigate, BranchesBeginWhereTheUnitRestsLongEnough) {
  std::string sequence = "step 1\n  initial H 30 P 0 R 0\n  align 8000\n";
  for (int k = 0; k < 6; ++k) sequence += "  dwell 6000\n  rotate P +90\n  dwell 6000\n  rotate P -90\n";
  record("rest", std::string(without_noise) + "seed = 31\n", sequence);
  write_truth("rest", "true.conf");
  ends("navigate rest --parameters true.conf --out nav --align 20 --for 20 --branches 100", 0);
  EXPECT_GT(result("nav/navigation.conf").integer("branches"), 20);
}

TEST_F(Navigate, WhatNoUnitGivesIsRefused) {
  record_rest_and_truth();
  const auto navigate = [this](const std::string& recording) {
    return std::vector<std::string>{"navigate", recording, "--parameters", path("true.conf"), "--out", "nav"};
  };
  for (const auto& [first, name] : {std::pair<std::size_t, const char*>{1, "gyros"}, {4, "accelerometers"}}) {
    retell("rest", "dead", [first = first](std::int64_t, std::vector<std::string>& cells) {
      for (std::size_t k = first; k < first + 3; ++k) cells[k] = "0";
    });
    expect_refused(navigate("dead"), std::string("the ") + name + " gave only zeros");
  }
  retell("rest", "far", [](std::int64_t counter, std::vector<std::string>& cells) {
    if (counter >= 90000 && counter < 90100) cells[4] = "2147483647";
  });
  expect_refused(navigate("far"), "beyond the range of any unit");
  expect_refused("navigate rest --out nav", "rest: it holds pulses: expected --parameters");
}

TEST_F(Navigate, AGravityThatIsNotFeltIsSaid) {
  record_rest_and_truth();
  const auto navigated = [this](const std::string& gravity) {
    std::string conf = file_text(folder_ / "text/recording.conf");
    const std::size_t at = conf.find("gravity_mps2");
    write("text/recording.conf", conf.replace(at, conf.find('\n', at) - at, "gravity_mps2 = " + gravity));
    const ProgramResult result = ends("navigate text --parameters true.conf --out nav", 0);
    return result.out;
  };
  ASSERT_EQ(run("export rest --out text").code, 0);
  EXPECT_SAYS_NOT(navigated("9.7914"), "GRAVITY");
  EXPECT_SAYS_NOT(navigated("9.7834"), "GRAVITY");
  EXPECT_SAYS(navigated("9.78"), "GRAVITY         9.7914");
  EXPECT_NEAR(result("nav/navigation.conf").number("felt_gravity_mps2"), 9.7914, 1e-4);
  EXPECT_SAYS(navigated("9.78"), "noise           assumed, the parameter file has no noise keys");
}

// What `apply` left is navigated as it is.
TEST_F(Navigate, CalibratedIncrementsNeedNoParameters) {
  record_rest_and_truth();
  ASSERT_EQ(run("apply rest --parameters true.conf --out applied.tcr").code, 0);
  ASSERT_EQ(run("navigate rest --parameters true.conf --out nav").code, 0);
  ends("navigate applied.tcr --out as_it_is", 0);
  KeyValueFile one = result("nav/navigation.conf"), other = result("as_it_is/navigation.conf");
  // Nothing says any more that the increments were counted, so the alignment is weighed otherwise: a tenth of the heading's sigma, and
  // what that heading costs, g W cos L t^3 / 6 of 0.003 deg.
  EXPECT_NEAR(other.number("branch.1.heading_deg"), one.number("branch.1.heading_deg"),
              0.1 * one.number("branch.1.sigma.heading_deg"));
  EXPECT_NEAR(other.number("branch.1.north_m"), one.number("branch.1.north_m"), 30.0);
  expect_refused("apply rest --parameters true.conf --out rest.xyz",
                 "rest.xyz: expected a name that ends in one of .csv, .npy, .mat, .mcap, .tcr");
  expect_refused("export rest --out rest.csv", "rest.csv: expected a folder");
  expect_refused("navigate rest --parameters true.conf --out x --branches 1e3", "--branches = 1e3: expected a number");
}

}  // namespace
}  // namespace turncal
