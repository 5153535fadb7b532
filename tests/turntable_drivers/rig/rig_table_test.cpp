// The mock table: the contract of every table, its own manners, and its lies.
#include "turntable_drivers/rig/rig_devices.h"

#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

struct RigFactory {
  Rig rig{default_rig_config()};
  RigTable rig_table{rig};
  Turntable& table() { return rig_table; }
  void pass(double seconds) { pass_time(rig, seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 3601.0;
};
INSTANTIATE_TYPED_TEST_SUITE_P(Rig, TableContract, RigFactory);

// A rig and its table, homed, at rig time 2 s; the faults of the tests are timed from there.
struct Station {
  explicit Station(const RigConfig& config = default_rig_config()) : rig(config), table(rig) {
    EXPECT_TRUE(table.connect().ok());
    EXPECT_TRUE(table.enable().ok());
    EXPECT_TRUE(table.home().ok());
    pass_time(rig, 2.0);
    for (Axis axis : all_axes) EXPECT_TRUE(table.status(axis)->homed);
  }
  AxisStatus at(Axis axis) { return *table.status(axis); }
  void go(Axis axis, double target_deg) { EXPECT_TRUE(table.move_absolute(axis, target_deg, 10.0, 10.0).ok()); }
  Rig rig;
  RigTable table;
};

RigConfig with_fault(RigFaultKind kind, double time_s, Axis axis = Axis::heading) {
  RigConfig config = default_rig_config();
  config.faults.push_back({.kind = kind, .time_s = time_s, .axis = int(axis)});
  return config;
}

TEST(RigTable, HomingTurnsTheAxesToZero) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {12.0, -7.0, 0.0};
  Rig rig(config);
  RigTable table(rig);
  ASSERT_TRUE(table.connect().ok());
  ASSERT_TRUE(table.enable().ok());
  EXPECT_NEAR(table.status(Axis::heading)->position_deg, 12.0, 1e-9);
  ASSERT_TRUE(table.home().ok());
  EXPECT_FALSE(table.move_absolute(Axis::pitch, 5.0, 10.0, 10.0).ok()) << "homing is under way";
  pass_time(rig, 2.1);
  EXPECT_FALSE(table.status(Axis::heading)->homed);  // 12 deg take 2.2 s
  EXPECT_TRUE(table.status(Axis::heading)->moving);
  EXPECT_TRUE(table.status(Axis::pitch)->homed);
  pass_time(rig, 0.2);
  EXPECT_TRUE(table.status(Axis::heading)->homed);
  EXPECT_EQ(table.status(Axis::heading)->position_deg, 0.0);
}

TEST(RigTable, RefusesWhatItsLimitsForbid) {
  Station s;
  for (const Status& status :
       {s.table.move_absolute(Axis::pitch, -3600.1, 10.0, 10.0), s.table.move_absolute(Axis::pitch, 10.0, 100.1, 10.0),
        s.table.move_absolute(Axis::pitch, 10.0, 10.0, 201.0)}) {
    ASSERT_TRUE(fails(status, ErrorKind::device, "pitch"));
  }
  EXPECT_TRUE(fails(s.table.move_absolute(Axis::pitch, -3600.1, 10.0, 10.0), "-3600.1 deg: expected -3600 to"));
  s.go(Axis::pitch, 10.0);
  EXPECT_FALSE(s.table.move_absolute(Axis::pitch, 20.0, 10.0, 10.0).ok()) << "one move at a time";
}

// From 10 deg/s at 10 deg/s^2 a stop takes 1 s and 5 deg; an abort one sample and half a sample's way.
TEST(RigTable, StopBrakesAndAbortStopsWithinASample) {
  Station s;
  s.go(Axis::roll, 90.0);
  pass_time(s.rig, 5.0);
  ASSERT_TRUE(s.table.stop_all().ok());
  pass_time(s.rig, 0.9);
  EXPECT_TRUE(s.at(Axis::roll).moving);
  pass_time(s.rig, 0.1);
  EXPECT_FALSE(s.at(Axis::roll).moving);
  EXPECT_NEAR(s.at(Axis::roll).position_deg, 50.0, 1e-4);
  EXPECT_FALSE(s.at(Axis::roll).in_position);
  s.go(Axis::roll, 90.0);
  pass_time(s.rig, 2.0);
  const double before_deg = s.at(Axis::roll).position_deg;
  ASSERT_TRUE(s.table.abort_all().ok());
  pass_time(s.rig, 0.005);
  EXPECT_FALSE(s.at(Axis::roll).moving);
  EXPECT_NEAR(s.at(Axis::roll).position_deg, before_deg + 0.025, 1e-4);
  EXPECT_FALSE(s.at(Axis::roll).enabled);
}

TEST(RigTable, DriveFaultIsLatched) {
  Station s(with_fault(RigFaultKind::axis_fault, 5.0, Axis::pitch));
  s.go(Axis::pitch, 90.0);
  pass_time(s.rig, 2.995);
  EXPECT_FALSE(s.at(Axis::pitch).fault);
  pass_time(s.rig, 0.005);
  EXPECT_TRUE(s.at(Axis::pitch).fault);
  EXPECT_FALSE(s.at(Axis::pitch).enabled);
  EXPECT_FALSE(s.at(Axis::heading).fault);
  EXPECT_FALSE(s.at(Axis::pitch).text.empty());
  pass_time(s.rig, 5.0);
  EXPECT_TRUE(s.at(Axis::pitch).fault);
  EXPECT_FALSE(s.at(Axis::pitch).moving);
  EXPECT_NEAR(s.at(Axis::pitch).position_deg, 25.0 + 5.0, 1e-4);  // 25 deg after 3 s, then the way of the brake
  EXPECT_FALSE(s.table.move_absolute(Axis::pitch, 0.0, 10.0, 10.0).ok());
  EXPECT_FALSE(s.table.enable().ok());
  ASSERT_TRUE(s.table.clear_fault().ok());
  EXPECT_FALSE(s.table.move_absolute(Axis::pitch, 0.0, 10.0, 10.0).ok()) << "not enabled yet";
  ASSERT_TRUE(s.table.enable().ok());
  s.go(Axis::pitch, 0.0);
  pass_time(s.rig, 10.0);
  EXPECT_TRUE(s.at(Axis::pitch).in_position);
  EXPECT_EQ(s.at(Axis::pitch).raw, 0b1011u);
}

TEST(RigTable, EmergencyStopNeedsTheOperator) {
  Station s(with_fault(RigFaultKind::emergency_stop, 5.0));
  s.go(Axis::pitch, 90.0);
  s.go(Axis::roll, 90.0);
  pass_time(s.rig, 3.01);
  for (Axis axis : all_axes) {
    EXPECT_TRUE(s.at(axis).emergency_stop);
    EXPECT_FALSE(s.at(axis).moving);
    EXPECT_FALSE(s.at(axis).enabled);
  }
  EXPECT_NEAR(s.at(Axis::pitch).position_deg, 25.025, 1e-4);
  EXPECT_FALSE(s.table.clear_fault().ok());
  EXPECT_FALSE(s.table.enable().ok());
  s.rig.release_emergency_stop();
  EXPECT_TRUE(s.at(Axis::pitch).emergency_stop) << "latched";
  EXPECT_TRUE(s.table.clear_fault().ok());
  EXPECT_FALSE(s.at(Axis::pitch).emergency_stop);
  EXPECT_TRUE(s.table.enable().ok());
  EXPECT_TRUE(s.at(Axis::pitch).homed);

  RigConfig timed = with_fault(RigFaultKind::emergency_stop, 5.0);
  timed.faults[0].duration_s = 10.0;
  Station t(timed);
  pass_time(t.rig, 12.9);
  EXPECT_FALSE(t.table.clear_fault().ok());
  pass_time(t.rig, 0.1);
  EXPECT_TRUE(t.table.clear_fault().ok());
}

// 0.05 deg at 1 deg/s: seen by the encoder, or hidden from it; the unit feels both.
TEST(RigTable, TableMovesByItself) {
  for (const bool hidden : {false, true}) {
    RigConfig config = with_fault(RigFaultKind::table_moved, 4.0, Axis::pitch);
    config.faults[0].size = 0.05;
    config.faults[0].hidden = hidden;
    config.table_errors.random_arcmin = 0.0;
    Station s(config);
    pass_time(s.rig, 4.0);
    EXPECT_NEAR(s.at(Axis::pitch).position_deg, hidden ? 0.0 : 0.05, 1e-4);
    EXPECT_EQ(s.at(Axis::pitch).in_position, hidden);
    EXPECT_NEAR(s.rig.attitude_nb()[3], std::sin(0.05 * 3.14159265358979 / 180.0), 1e-10);
    s.go(Axis::pitch, 0.0);
    pass_time(s.rig, 4.0);
    EXPECT_NEAR(s.rig.attitude_nb()[3], hidden ? 8.7266e-4 : 0.0, 1e-8);
  }
}

TEST(RigTable, InPositionLies) {
  const auto flags = [](InPositionFlag flag, const std::vector<double>& at_s) {
    RigConfig config = default_rig_config();
    config.table.in_position = flag;
    Station s(config);
    pass_time(s.rig, 5.0);
    s.go(Axis::pitch, 20.0);  // lasts 3 s
    std::vector<bool> result;
    double now_s = 0.0;
    for (double t : at_s) {
      pass_time(s.rig, t - now_s);
      now_s = t;
      result.push_back(s.at(Axis::pitch).in_position);
    }
    return result;
  };
  const std::vector<double> at_s = {0.0, 0.5, 1.5, 2.5, 2.55, 3.1, 3.15, 4.5};
  using V = std::vector<bool>;
  EXPECT_EQ(flags(InPositionFlag::honest, at_s), (V{0, 0, 0, 0, 0, 1, 1, 1}));
  EXPECT_EQ(flags(InPositionFlag::servo_on, at_s), (V{1, 1, 1, 1, 1, 1, 1, 1}));
  EXPECT_EQ(flags(InPositionFlag::stale, at_s), (V{1, 1, 0, 0, 0, 1, 1, 1}));
  EXPECT_EQ(flags(InPositionFlag::late, at_s), (V{0, 0, 0, 0, 0, 0, 0, 1}));
  const V flicker = flags(InPositionFlag::flicker, at_s);
  EXPECT_FALSE(flicker[2]);
  EXPECT_NE(flicker[3], flicker[4]);
  EXPECT_NE(flicker[5], flicker[6]);
  EXPECT_TRUE(flicker[7]);

  RigConfig config = default_rig_config();
  config.table.in_position = InPositionFlag::after_stop;
  Station s(config);
  s.go(Axis::pitch, 20.0);
  pass_time(s.rig, 1.5);
  EXPECT_FALSE(s.at(Axis::pitch).in_position);
  ASSERT_TRUE(s.table.stop_all().ok());
  pass_time(s.rig, 1.5);
  EXPECT_TRUE(s.at(Axis::pitch).in_position);
}

}  // namespace
}  // namespace turncal
