// What a run finds wrong with the unit on the table in its first step, on the rig: the check is given a unit mounted another way, with
// another sign, or with a dead channel.
#include "orchestrator/devices/first_step_check.h"

#include <Eigen/Geometry>

#include "calib/model/parameters.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// Given samples with their channels changed: the unit as it would be.
class ChangedUnit : public FirstStepCheck {
 public:
  ChangedUnit(std::function<void(ImuSample&)> change, std::function<void(RecordingInfo&)> told)
      : change_(std::move(change)), told_(std::move(told)) {}
  Status start(const RecordingInfo& info) override {
    RecordingInfo other = info;
    told_(other);
    return FirstStepCheck::start(other);
  }
  Status add(std::span<const ImuSample> samples) override {
    std::vector<ImuSample> changed(samples.begin(), samples.end());
    for (ImuSample& sample : changed) change_(sample);
    return FirstStepCheck::add(changed);
  }

 private:
  std::function<void(ImuSample&)> change_;
  std::function<void(RecordingInfo&)> told_;
};

// The first step of the fourteen with dwells of 10 s, and a second one. Levels, both signs of every accelerometer, turns of pitch and roll.
constexpr const char* first_step_text =
    "format = 1\nname = first\nrate_degps = 30\nacceleration_degps2 = 60\n"
    "step 1 \"each accelerometer up and down\"\n  initial H 0 P 0 R 0\n  align 2000\n  rotate P +90\n  dwell 2000\n"
    "  rotate P -180\n  dwell 2000\n  rotate P +90\n  rotate R +90\n  dwell 2000\n  rotate R -180\n  dwell 2000\n"
    "  rotate R +90\nstep 2 \"again\"\n  initial H 0 P 0 R 0\n  align 1000\n";

struct FirstStepStop {
  RunState state;
  std::string why;
  double time_s;
  bool is_of_the_unit;  // by the event that stopped the run
};
FirstStepStop found_with(
    const std::function<void(ImuSample&)>& change,
    const std::function<void(RecordingInfo&)>& told = [](RecordingInfo&) {},
    const RigConfig& rig_config = default_rig_config()) {
  RigStation rig(first_step_text, rig_config);
  ChangedUnit unit(change, told);
  rig.sinks.push_back(&unit);
  const RunOutcome outcome = rig.run();
  EXPECT_TRUE(rig.at_rest());
  return {outcome.state, outcome.state == RunState::done ? "" : outcome.error.message, rig.clock.now_s(),
          rig.watcher.saw(RunEvent::unit_wrong) && !rig.watcher.saw(RunEvent::storage_failed)};
}

// What is wrong with a unit, what is said of it, and how soon; nothing of one that is good.
struct WrongUnit {
  const char* what;
  std::function<void(ImuSample&)> change;
  const char* says = "";
  double within_s = 1e9;
  std::function<void(RecordingInfo&)> told = [](RecordingInfo&) {};
};
// A unit whose frame is said to be in rad and m/s; what it sends is so many times that.
WrongUnit in_units(const char* what, double gyros, double accelerometers, const char* says = "",
                   double within_s = 1e9) {
  constexpr double rad = 0.932920 * rad_per_arcsec, mps = 0.0005;
  const auto change = [=](ImuSample& s) {
    for (double& x : s.gyro) x *= gyros * rad;
    for (double& x : s.accel) x *= accelerometers * mps;
  };
  return {what, change, says, within_s,
          [](RecordingInfo& info) { info.gyro_increment = info.accel_increment = IncrementKind::physical; }};
}

TEST(FirstStep, WhatIsWrongIsSaidInItsTime) {
  constexpr double first_rest_s = 20.0, first_turn_s = 30.0;
  int k = 0;
  for (const WrongUnit& unit :
       {WrongUnit{"good", [](ImuSample&) {}},
        {"turned by 90 deg about x",
         [](ImuSample& s) {
           for (auto* v : {&s.gyro, &s.accel}) *v = {(*v)[0], (*v)[2], -(*v)[1]};
         },
         "the unit's -z is up instead of its +y", first_rest_s},
        {"-x", [](ImuSample& s) { s.accel[0] *= -1.0; }, "the unit's -x is up instead of its +x"},
        {"-y", [](ImuSample& s) { s.accel[1] *= -1.0; }, "the unit's -y is up instead of its +y"},
        {"-z", [](ImuSample& s) { s.accel[2] *= -1.0; }, "the unit's +z is up instead of its -z"},
        {"gyro -z", [](ImuSample& s) { s.gyro[2] *= -1.0; }, "the turn of pitch by 90 deg was sensed about -z"},
        {"gyro -x", [](ImuSample& s) { s.gyro[0] *= -1.0; }, "the turn of roll by 90 deg was sensed about -x"},
        {"gyros x, z", [](ImuSample& s) { std::swap(s.gyro[0], s.gyro[2]); }, "sensed about +x"},
        {"beside the table",
         [](ImuSample& s) {
           if (std::abs(s.gyro[2]) > 20.0) s.gyro[2] = double(s.counter % 50 == 0);
         },
         "the turn of pitch by 90 deg was hardly sensed"},
        // These the earth's rate shows first.
        {"gyros y, z", [](ImuSample& s) { std::swap(s.gyro[1], s.gyro[2]); }, "axes and signs of the gyros",
         first_rest_s},
        {"gyro -y", [](ImuSample& s) { s.gyro[1] *= -1.0; }, "axes and signs of the gyros", first_rest_s},
        {"the other hemisphere", [](ImuSample&) {}, "site.latitude_deg is -29.53", first_rest_s,
         [](RecordingInfo& info) { info.latitude_deg *= -1.0; }},
        in_units("rad and m/s", 1.0, 1.0),
        in_units("deg", 1.0 / rad_per_deg, 1.0, "they look as if they were in deg/s, not rad/s", first_rest_s),
        in_units("radians squared", rad_per_deg, 1.0, "as if they were in rad/s, not deg/s", first_turn_s),
        in_units("g", 1.0, 1.0 / standard_gravity_mps2, "as if they were in g, not m/s^2"),
        {"3000 C", [](ImuSample& s) { s.temperature_c = 3000.0F; }, "temperature reads 3000 C", first_rest_s},
        {"a sample now and then that cannot be", [&k](ImuSample& s) {
           if (++k % 1500 == 0) s.gyro[0] = s.accel[1] = 2e9;
         }}}) {
    SCOPED_TRACE(unit.what);
    const FirstStepStop found = found_with(unit.change, unit.told);
    const bool good = *unit.says == '\0';
    EXPECT_EQ(found.state, good ? RunState::done : RunState::failed) << found.why;
    EXPECT_SAYS(found.why, unit.says);
    EXPECT_LT(found.time_s, unit.within_s);
    EXPECT_EQ(found.is_of_the_unit, !good) << "nothing was wrong with storing";
  }
}

// Other units at other sites. What is told is off by 8 deg and more; what is not told is off by nothing.
TEST(FirstStep, AnotherLatitude) {
  std::mt19937 random(14);
  std::uniform_real_distribution<double> anywhere(-75.0, 75.0), off(8.0, 30.0);
  for (int draw = 0; draw < 20; ++draw) {
    RigConfig config = default_rig_config();
    config.seed = 100 + std::uint64_t(draw);
    config.site.latitude_deg = anywhere(random);
    const double at_deg = config.site.latitude_deg, by_deg = at_deg > 0.0 ? -off(random) : off(random);
    for (const double told_deg : {at_deg, at_deg + by_deg}) {
      const auto found = found_with([](ImuSample&) {}, [=](RecordingInfo& i) { i.latitude_deg = told_deg; }, config);
      EXPECT_EQ(found.state, told_deg == at_deg ? RunState::done : RunState::failed)
          << config.site.latitude_deg << " told as " << told_deg << ": " << found.why;
      if (told_deg == at_deg) continue;
      EXPECT_SAYS(found.why, "site.latitude_deg is ");
      EXPECT_LT(found.time_s, 75.0) << "three rests are enough";
    }
  }
}

// Biases as of a unit that is no laser gyro: the poses tell them from the earth's rate, and the latitude is still right.
TEST(FirstStep, BiasesAreNotTakenForALatitude) {
  std::mt19937 random(15);
  std::normal_distribution<double> bias_degph(0.0, 20.0);
  for (int draw = 0; draw < 20; ++draw) {
    std::array<double, 3> pulses{};  // of a sample
    for (double& p : pulses) p = bias_degph(random) * 0.005 / 0.932920;
    const FirstStepStop found = found_with([&](ImuSample& s) {
      for (std::size_t i = 0; i < 3; ++i) s.gyro[i] += pulses[i];
    });
    EXPECT_EQ(found.state, RunState::done) << found.why;
  }
}

// A rest that contradicts those before it: axes or signs are wrong, and what a latitude would be of them is not said.
TEST(FirstStep, ARestThatContradictsEndsTheLookAtTheLatitude) {
  const Eigen::Vector3d earth = earth_rate_radps * Eigen::Vector3d(std::cos(0.9), std::sin(0.9), 0.0);  // 51.6 deg
  const auto says = [&](bool contradicting) {
    EarthRateCheck check(40.0);
    std::string wrong;
    for (const int quarter : {0, 1, 2, 3, 0, 1}) {
      const double angle = quarter * std::numbers::pi / 2.0;
      const Eigen::Matrix3d C_nb = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
      Eigen::Vector3d rate = C_nb.transpose() * earth;
      if (contradicting && quarter == 1) rate = -20.0 * rate;
      wrong += check.add_rest(rate, 1e-9, C_nb, C_nb.transpose() * Eigen::Vector3d::UnitY());
    }
    return wrong;
  };
  EXPECT_SAYS(says(false), "that of a latitude of 51.57 +- ");
  EXPECT_EQ(says(true), "");
}

TEST(FirstStep, UpThatLeansAndNumbersThatAreNothing) {
  const DirectionLimits limits;
  EXPECT_TRUE(fails(judge_force({9.79 * std::sin(0.5), 9.79 * std::cos(0.5), 0.0}, {}, 9.79, limits),
                    "up is 29 deg away from there"));
  const Status turned = judge_force({0.0, 0.0, 9.79}, {0.0, 90.0, 0.0}, 9.79, limits);
  ASSERT_FALSE(turned.ok());
  EXPECT_SAYS(turned.error().message, "expected +9.79, +0, +0;");
}

TEST(FirstStep, PulsesOfAWeightThatNoCalibrationFindsAreNamed) {
  const auto weighing = [](double arcsec) {
    RigConfig config = default_rig_config();
    config.gyro_pulse_arcsec = arcsec;
    return found_with([](ImuSample&) {}, [](RecordingInfo&) {}, config);
  };
  for (const double arcsec : {0.65, 1.0, 1.9})
    EXPECT_EQ(weighing(arcsec).state, RunState::done) << weighing(arcsec).why;
  for (const double arcsec : {0.0163, 0.46, 2.5, 53.5}) {
    const FirstStepStop found = weighing(arcsec);
    EXPECT_SAYS(found.why, "a pulse weighs") << arcsec;
    EXPECT_TRUE(found.is_of_the_unit);
    EXPECT_LT(found.time_s, 35.0) << "seen in the first turn";
  }
}

TEST(FirstStep, DeadSensors) {
  const char* names[] = {"gyro x", "gyro y", "gyro z", "accelerometer x", "accelerometer y", "accelerometer z"};
  for (std::size_t i = 0; i < 6; ++i) {
    for (const std::int64_t from : {0, 3000}) {
      // No turn of the first step is about y: once it has lived, it may as well point west. The step that turns about it tells.
      if (i == 1 && from > 0) continue;
      const auto shown = [i](ImuSample& s) -> double& { return i < 3 ? s.gyro[i] : s.accel[i - 3]; };
      std::int64_t k = 0;
      double last = 0.0;
      const FirstStepStop found = found_with([&](ImuSample& s) {
        if (k++ < from)
          last = shown(s);
        else
          shown(s) = last;
      });
      EXPECT_EQ(found.state, RunState::failed) << names[i];
      const bool named = found.why.find(std::string(names[i]) + " is ") != std::string::npos;
      // A turn or gravity may tell before.
      const bool earlier = found.why.find("the accelerometers sense") != std::string::npos ||
                           found.why.find("was not felt") != std::string::npos ||
                           found.why.find("was hardly sensed") != std::string::npos ||
                           found.why.find("was sensed about") != std::string::npos;
      EXPECT_TRUE(named || earlier) << found.why;
    }
  }
}

// In pulses as coarse as these to the millisecond, a gyro that points west gives none for minutes.
TEST(FirstStep, AGyroThatPointsWestIsNotStuck) {
  RecordingInfo info;
  info.sample_period_s = 0.001;
  info.accel_pulse_mps = 5e-4;
  ChannelLife life(info);
  const auto turn = [&](std::size_t about, double angle_deg) {
    constexpr int samples = 36000;
    const double counts = angle_deg * 3600.0 / 0.932920 / samples;
    for (int k = 0; k < samples; ++k) {
      static std::int64_t counter = 0;
      ImuSample s;
      s.counter = counter++;
      for (std::size_t i = 0; i < 3; ++i) s.accel[i] = double((k + int(i)) % 3);
      s.gyro[about] = counts + (k % 2 == 0 ? 0.5 : -0.5);
      s.gyro[(about + 1) % 3] = k % 7 == 0 ? 1.0 : 0.0;
      life.add(s);
    }
    life.turned(std::abs(angle_deg));
  };
  turn(0, 90.0);  // every gyro but z has lived
  for (const double angle : {360.0, -360.0, 360.0, -360.0}) turn(0, angle);
  EXPECT_EQ(life.defect(), "") << "z, across the axis";
  turn(2, 360.0);
  EXPECT_EQ(life.defect(), "");
  for (const double angle : {360.0, -360.0}) turn(1, angle);  // x is silent now, and z lives
  EXPECT_EQ(life.defect(), "");
}

// From the last second of a turn of a circle on an accelerometer gives the same count, and the turn is told after the rest.
TEST(FirstStep, AnAccelerometerAtRestIsNotStuck) {
  RecordingInfo info;
  info.sample_period_s = 0.005;
  ChannelLife life(info);
  std::int64_t counter = 0;
  const auto pass = [&](double seconds, bool moves) {
    for (int k = 0; k < int(seconds / info.sample_period_s); ++k) {
      ImuSample s;
      s.counter = counter++;
      for (std::size_t i = 0; i < 3; ++i) s.gyro[i] = s.accel[i] = k % 2 == 0 ? 1.0 : 2.0;
      if (!moves) s.accel[1] = 1.0;
      life.add(s);
    }
  };
  pass(35.0, true);
  pass(22.0, false);
  life.turned(360.0);
  EXPECT_EQ(life.defect(), "");
  pass(40.0, false);  // and now it does not change in a whole turn
  life.turned(360.0);
  EXPECT_SAYS(life.defect(), "accelerometer y is stuck");
}

}  // namespace
}  // namespace turncal
