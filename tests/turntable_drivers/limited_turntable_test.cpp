// Motion limits around the mock: the contract still holds, and no move beyond them reaches the driver.
#include "turntable_drivers/table/limited_turntable.h"

#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {
namespace {

struct LimitedFactory {
  Rig rig{default_rig_config()};
  RigTable mock{rig};
  LimitedTurntable limited{mock, std::array<AxisLimits, 3>{}};
  Turntable& table() { return limited; }
  void pass(double seconds) { pass_time(rig, seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 541.0;
};
INSTANTIATE_TYPED_TEST_SUITE_P(Limited, TableContract, LimitedFactory);

struct LimitedTable : testing::Test, LimitedFactory {
  void SetUp() override {
    ASSERT_TRUE(limited.connect().ok());
    ASSERT_TRUE(limited.enable().ok());
    ASSERT_TRUE(limited.home().ok());
    pass(3.0);
    ASSERT_TRUE(limited.status(Axis::roll)->homed);
  }
  // Empty: taken, and done.
  std::string move(double to_deg, double rate = 90.0, double acceleration = 90.0) {
    const Status status = limited.move_absolute(Axis::roll, to_deg, rate, acceleration);
    if (!status) {
      EXPECT_EQ(status.error().kind, ErrorKind::input);
      EXPECT_FALSE(rig.axis(Axis::roll).moving);
      return status.error().message;
    }
    pass(15.0);
    EXPECT_NEAR(rig.axis(Axis::roll).position_deg, to_deg, 1e-3);
    return "";
  }
};

TEST_F(LimitedTable, TravelRateAndAcceleration) {
  EXPECT_EQ(move(540.1), "motion limits: roll: move to 540.1 deg: expected -540 to 540 deg");
  EXPECT_EQ(move(-541), "motion limits: roll: move to -541 deg: expected -540 to 540 deg");
  EXPECT_EQ(move(10, 100.5), "motion limits: roll: rate 100.5 deg/s: expected at most 100 deg/s");
  EXPECT_EQ(move(10, 10, 101), "motion limits: roll: acceleration 101 deg/s^2: expected at most 100 deg/s^2");
  EXPECT_NE(move(std::nan("")), "");
  EXPECT_EQ(move(540, 100, 100), "");
}

TEST_F(LimitedTable, CableIsNotWoundFurther) {
  EXPECT_EQ(move(400), "");
  EXPECT_EQ(move(-321),
            "motion limits: roll: the move to -321 deg winds the cable by 721 deg: expected at most 720 deg");
  EXPECT_EQ(move(-320), "");
  EXPECT_EQ(move(400), "") << "back over the same way";
  EXPECT_NE(move(401), "");
  ASSERT_TRUE(limited.home().ok());
  pass(60.0);
  EXPECT_EQ(move(401), "") << "homed: unwound";
}

TEST_F(LimitedTable, WhereTheTableWasWithoutACommandCounts) {
  rig.command_move(Axis::roll, 500.0, 90.0, 90.0);
  pass(10.0);
  EXPECT_NE(move(-230), "");
  EXPECT_EQ(move(-220), "");
}

// ---- described tables

const std::string plain_tcp = plain_map_text("tcp"), circle_rtu = circle_map_text("rtu");
using Plain = MapFactory<plain_tcp>;
using Circle = MapFactory<circle_rtu>;
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusTcp, TableContract, Plain);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusCircleRtu, TableContract, Circle);

enum class Which { dollar, acutronic, newport, pi, own_dollar, own_bits, own_prompt };
constexpr const char* names[] = {"three_axis_dollar", "acutronic_acl", "newport_esp30x", "pi_gcs2",
                                 "own_dollar",        "own_bits",      "own_prompt"};

template <Which which, bool tcp>
struct DialectFactory : DescribedFactory<DialectStation> {
  DialectFactory() : DescribedFactory(shipped_dialect(names[int(which)], tcp)) {}
};
using Dollar = DialectFactory<Which::dollar, false>;
using Acutronic = DialectFactory<Which::acutronic, true>;
using Newport = DialectFactory<Which::newport, false>;
using PiTcp = DialectFactory<Which::pi, true>;
using OwnDollar = DialectFactory<Which::own_dollar, false>;
using OwnBits = DialectFactory<Which::own_bits, true>;
using OwnPrompt = DialectFactory<Which::own_prompt, false>;
INSTANTIATE_TYPED_TEST_SUITE_P(DollarSerial, TableContract, Dollar);
INSTANTIATE_TYPED_TEST_SUITE_P(AcutronicTcp, TableContract, Acutronic);
INSTANTIATE_TYPED_TEST_SUITE_P(NewportSerial, TableContract, Newport);
INSTANTIATE_TYPED_TEST_SUITE_P(PiTcp, TableContract, PiTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnDollarSerial, TableContract, OwnDollar);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnBitsTcp, TableContract, OwnBits);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnPromptSerial, TableContract, OwnPrompt);

}  // namespace
}  // namespace turncal
