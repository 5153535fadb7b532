#include "orchestrator/run/motion_watch.h"
#include "calib/model/parameters.h"
#include "tests/test.h"

namespace turncal {
namespace {

// 200 Hz.
RecordingInfo unit_in_rad() {
  RecordingInfo info;
  info.sample_period_s = 0.005;
  info.gyro_increment = IncrementKind::physical;
  return info;
}

// Samples of a unit whose one axis feels what a function of their number says, rad; the next number.
template <class Felt>
std::int64_t feel(FeltRate& unit, std::int64_t first, std::int64_t count, std::size_t axis, Felt felt) {
  for (ImuSample sample; sample.counter = first, count-- > 0; ++first) {
    sample.gyro[axis] = felt(first);
    unit.add(sample);
  }
  return first;
}
constexpr double sample_rad_of(double degps) { return 0.005 * degps * rad_per_deg; }

// Two turns of an axis that tell the unit's scale: what it makes of that rate, and how far they were.
std::int64_t tell_scale(FeltRate& unit, std::int64_t first, std::int64_t samples, std::size_t axis, double felt_degps,
                        double turned_deg) {
  for (int turn = 0; turn < 2; ++turn) {
    unit.begin_turn(1e9);
    first = feel(unit, first, samples, axis, [&](std::int64_t) { return sample_rad_of(felt_degps); });
    EXPECT_TRUE(unit.end_turn(turned_deg));
  }
  return first;
}

constexpr std::array<AxisLimits, 3> limits = {AxisLimits{}, AxisLimits{-10.0, 10.0}, AxisLimits{}};

TableStatus at(double time_s, double heading_deg, double pitch_deg, double pitch_rate_degps = 0.0) {
  TableStatus axes{};
  for (AxisStatus& axis : axes) axis.time_s = time_s;
  axes[0].position_deg = heading_deg;
  axes[1].position_deg = pitch_deg;
  axes[1].rate_degps = pitch_rate_degps;
  return axes;
}

// There and back within its travel, with an angle that is set anew at the zero.
TEST(HomingWatch, ASearchWithinTheTravelIsNone) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  for (double pitch = 9.0; pitch > -10.0; pitch -= 0.5) EXPECT_FALSE(watch.add(at(time_s += 0.1, 50.0, pitch, -5.0)));
  for (double pitch = -10.0; pitch < 0.0; pitch += 0.5) EXPECT_FALSE(watch.add(at(time_s += 0.1, 50.0, pitch, 5.0)));
  EXPECT_FALSE(watch.add(at(time_s += 0.1, -300.0, 0.0))) << "350 deg in 0.1 s is another zero";
}

TEST(HomingWatch, AnAxisThatPassesItsZeroIsSaidByItsAngle) {
  HomingWatch watch(limits);
  double turned = 0.0, time_s = 0.0;
  std::optional<std::string> said;
  for (; !said && turned < 5000.0; turned += 1.0) said = watch.add(at(time_s += 0.1, turned, 0.0));
  ASSERT_TRUE(said);
  EXPECT_NEAR(turned, 1440.0, 3.0) << "its travel of 1080 deg, and a turn";
  EXPECT_EQ(*said, "heading does not find its zero: it has turned 1441 deg, its travel is 1080 deg");
}

// Of an axis whose angle stands still, or is a code within one turn.
TEST(HomingWatch, AnAxisThatPassesItsZeroIsSaidByItsRate) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  std::optional<std::string> said;
  while (!said && time_s < 100.0) said = watch.add(at(time_s += 0.1, 0.0, 3.0, -2.0));
  ASSERT_TRUE(said);
  EXPECT_NEAR(time_s, 20.0, 0.5) << "twice its travel of 20 deg";
}

// One axis after the other, each within its time; then one whose drive never begins.
TEST(HomingWatch, AnAxisThatDoesNotBeginIsSaid) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  TableStatus axes = at(time_s, 50.0, 7.0);
  for (AxisStatus& axis : axes) {
    axis.homed = axis.moving = false;
    axis.rate_degps = std::numeric_limits<double>::quiet_NaN();  // not told
  }
  const auto pass = [&](double seconds) {
    std::optional<std::string> said;
    for (const double end_s = time_s + seconds; !said && time_s < end_s;) {
      for (AxisStatus& axis : axes) axis.time_s = time_s;
      said = watch.add(axes);
      time_s += 0.5;
    }
    return said;
  };
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[0].moving = true;
  EXPECT_EQ(pass(30.0), std::nullopt);
  axes[0].homed = true;
  axes[0].moving = false;
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[2].position_deg = 3.0;  // it moved
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[2].homed = true;
  EXPECT_EQ(pass(19.0).value_or(""),
            "pitch does not look for its zero: it stands at 7.0000 deg, and nothing has turned for 20 s");
  axes[1].homed = true;
  EXPECT_EQ(pass(30.0), std::nullopt);
}

// ---- how fast ----

constexpr std::array<AxisLimits, 3> usual_limits{};  // 100 deg/s, 100 deg/s^2

// A move as a table makes it, rate and acceleration times a factor, read over a line with latency, from a register that is found anew every
// refresh_s. Returns the time at which something was said, and what.
struct DrawnMove {
  Move move{Axis::pitch, 90.0, 20.0, 60.0};
  double rate_factor = 1.0, acceleration_factor = 1.0;
  double refresh_s = 0.0, latency_s = 0.0, noise_degps = 0.0;
  bool tells_rate = false, felt = false;
  double gyro_scale = 1.0, gyro_noise_degps = 0.0;
  mutable std::optional<FeltRate> unit{};  // as the move left it

  double at_deg(double t) const {
    const double rate = rate_factor * move.rate_degps, acceleration = acceleration_factor * move.acceleration_degps2;
    const double ramp_s = rate / acceleration, way = move.target_deg, cruise_s = std::max(0.0, way / rate - ramp_s);
    if (t <= 0.0) return 0.0;
    if (t < ramp_s) return 0.5 * acceleration * t * t;
    if (t < ramp_s + cruise_s) return rate * (t - 0.5 * ramp_s);
    const double left_s = std::max(0.0, 2.0 * ramp_s + cruise_s - t);
    return way - 0.5 * acceleration * left_s * left_s;
  }
  double longest_s() const {
    const double rate = rate_factor * move.rate_degps;
    return move.target_deg / rate + rate / (acceleration_factor * move.acceleration_degps2) + 1.0;
  }
  double rate_degps(double t) const { return (at_deg(t + 1e-4) - at_deg(t - 1e-4)) / 2e-4; }

  std::optional<std::pair<double, std::string>> watch(std::mt19937_64& random) const {
    const auto draw = [&](double to) { return std::uniform_real_distribution(0.0, to)(random); };
    std::normal_distribution<double> normal;
    unit.emplace(unit_in_rad());
    std::int64_t samples = 0;
    const auto feel_until = [&](double t) {
      for (; felt && 0.005 * double(samples) - 4.0 < t; ++samples) {
        const double now = 0.005 * double(samples) - 4.0;
        ImuSample sample;
        sample.counter = samples;
        sample.gyro[1] = gyro_scale * (at_deg(now + 0.005) - at_deg(now)) * rad_per_deg;
        for (double& one : sample.gyro) one += 0.005 * gyro_noise_degps * normal(random) * rad_per_deg;
        unit->add(sample);
      }
    };
    // An earlier turn has told the unit's scale.
    if (felt) {
      for (int turn = 0; turn < 2; ++turn) {
        unit->begin_turn(1e9);
        samples = feel(*unit, samples, 200, 1, [&](std::int64_t) { return sample_rad_of(gyro_scale * 20.0); });
        samples = feel(*unit, samples, 100, 1, [](std::int64_t) { return 0.0; });
        unit->end_turn(20.0);
      }
      feel_until(0.0);
      unit->begin_turn(SpeedWatch::factor * move.acceleration_degps2);
    }
    SpeedWatch speed(usual_limits, 1.0);
    const double began_s = draw(1.0);
    TableStatus axes{};
    speed.restart(axes, began_s - 0.01, began_s);
    for (double now = began_s, next = 0.0; now < began_s + longest_s(); now = next) {
      const double asked_s = now, answered_s = now + draw(latency_s), read_s = asked_s + draw(answered_s - asked_s);
      next = std::max(now + 0.1, answered_s);
      const double found_s = refresh_s > 0.0 ? refresh_s * std::floor(read_s / refresh_s) : read_s;
      AxisStatus& pitch = axes[1];
      pitch.position_deg = at_deg(found_s - began_s);
      pitch.rate_told = tells_rate;
      pitch.rate_degps = rate_degps(found_s - began_s) + noise_degps * normal(random);
      if (auto said = speed.add(axes, asked_s, answered_s, move, false)) return {{now - began_s, *said}};
      feel_until(answered_s - began_s);
      if (felt) {
        if (auto said = speed.add_felt({&*unit}, axes, move, false)) return {{now - began_s, *said}};
      }
    }
    if (felt) unit->end_turn(move.target_deg);
    return std::nullopt;
  }
};

// Registers that are found anew four times a second, answers up to 0.4 s late, gyros of any scale and of the noise of a phone.
TEST(SpeedWatch, OfThousandsOfHealthyMovesNoneIsSaid) {
  std::mt19937_64 random(1);
  const auto draw = [&](double from, double to) { return std::uniform_real_distribution(from, to)(random); };
  for (int i = 0; i < 2000; ++i) {
    DrawnMove drawn;
    drawn.move.rate_degps = std::exp(draw(std::log(0.5), std::log(90.0)));
    drawn.move.acceleration_degps2 = drawn.move.rate_degps * draw(0.5, 5.0);
    drawn.rate_factor = draw(0.5, 1.05);
    drawn.acceleration_factor = draw(0.5, 1.1);
    const double rate_degps = drawn.rate_factor * drawn.move.rate_degps;
    const double ramps_deg = rate_degps * rate_degps / (drawn.acceleration_factor * drawn.move.acceleration_degps2);
    drawn.move.target_deg = ramps_deg + draw(5.0, 360.0);
    drawn.refresh_s = draw(0.0, 1.0) < 0.5 ? 0.0 : draw(0.0, 0.25);
    drawn.latency_s = draw(0.0, 0.4);
    drawn.tells_rate = draw(0.0, 1.0) < 0.5;
    drawn.noise_degps = 0.01 * drawn.move.rate_degps;
    drawn.felt = true;
    drawn.gyro_scale = draw(0.5, 1.6);
    drawn.gyro_noise_degps = std::exp(draw(std::log(0.01), std::log(1.0)));
    const auto said = drawn.watch(random);
    ASSERT_FALSE(said) << i << ": after " << said->first << " s: " << said->second;
    const auto jumped = SpeedWatch::judge_turn({&*drawn.unit}, drawn.move, drawn.move.target_deg);
    ASSERT_FALSE(jumped) << i << ": " << *jumped;
  }
}

struct TooFast {
  double factor;
  double within_s;
};

TEST(SpeedWatch, SaysHowManyTimesTooFastAnAxisTurns) {
  std::mt19937_64 random(2);
  // A poll after the rate is beyond the limit: one, but for what positions alone must wait for.
  for (const auto& [factor, within_s] :
       {TooFast{1.4, 4.0}, TooFast{2.0, 1.0}, TooFast{8.0, 0.35}, TooFast{15.0, 0.25}}) {
    for (int i = 0; i < 100; ++i) {
      DrawnMove drawn;
      drawn.move.target_deg = 360.0;
      drawn.rate_factor = factor;
      drawn.acceleration_factor = factor;
      const auto by_positions = drawn.watch(random);
      ASSERT_TRUE(by_positions) << factor;
      EXPECT_LE(by_positions->first, within_s) << factor;
      EXPECT_SAYS(by_positions->second, "by its positions");
      drawn.tells_rate = true;
      const auto by_rate = drawn.watch(random);
      ASSERT_TRUE(by_rate) << factor;
      EXPECT_LE(by_rate->first, 20.0 * 1.2 / (60.0 * factor) + 0.3) << factor;
      drawn.tells_rate = false;
      drawn.felt = true;
      const auto by_unit = drawn.watch(random);
      ASSERT_TRUE(by_unit) << factor;
      EXPECT_LE(by_unit->first, 0.5) << factor;
    }
  }
}

// At the end of the turn.
TEST(SpeedWatch, SaysWhatIsSpedUpTooQuickly) {
  std::mt19937_64 random(3);
  DrawnMove drawn;
  drawn.felt = true;
  for (int i = 0; i < 100; ++i) {
    drawn.acceleration_factor = i % 2 == 0 ? 10.0 : 1.05;
    EXPECT_FALSE(drawn.watch(random));
    const auto said = SpeedWatch::judge_turn({&*drawn.unit}, drawn.move, drawn.move.target_deg);
    ASSERT_EQ(said.has_value(), i % 2 == 0) << i;
    EXPECT_SAYS(said.value_or("more than it may at the 60 deg/s^2"), "more than it may at the 60 deg/s^2") << *said;
  }
}

// A unit that loses samples while the axis is sped up, and does not say so, is no table that jumps.
TEST(SpeedWatch, LostSamplesOfAUnitAreNoJumpOfTheTable) {
  for (const bool lost : {true, false}) {
    FeltRate unit(unit_in_rad());
    std::int64_t counter = 0;
    const auto turn_at = [&](double degps, int samples) {
      counter = feel(unit, counter, samples, 0, [degps](std::int64_t) { return sample_rad_of(degps); });
    };
    counter = tell_scale(unit, counter, 400, 0, 10.0, 20.0);
    turn_at(0.0, 400);
    const Move move{Axis::pitch, 90.0, 30.0, 60.0};
    unit.begin_turn(SpeedWatch::factor * move.acceleration_degps2);
    turn_at(0.0, 20);
    // To 18 deg/s at once; the 0.3 s before, 2.7 deg, are lost, or the table was so quick.
    for (int i = 0; i < 20; ++i) turn_at(18.0 + 0.6 * i, 2);
    turn_at(30.0, 500);
    turn_at(0.0, 100);
    const double felt_deg = 0.01 * (20.0 * 18.0 + 0.6 * 190.0) + 75.0;
    const double turned_deg = felt_deg + (lost ? 2.7 : 0.0);
    unit.end_turn(turned_deg);
    EXPECT_EQ(SpeedWatch::judge_turn({&unit}, move, turned_deg).has_value(), !lost);
  }
}

// A drive whose counter slipped: rates and accelerations are those that were sent. In its first turn the unit's scale is not known yet.
TEST(SpeedWatch, AWayThatTheTableDoesNotReadIsFelt) {
  const Move move{Axis::pitch, 90.0, 30.0, 1e9};
  for (const int turns_before : {0, 2}) {
    for (const double read_deg : {180.0, 90.0, -90.0, 70.0, 12.0}) {
      FeltRate unit(unit_in_rad());
      std::int64_t counter = 0;
      if (turns_before > 0) counter = tell_scale(unit, counter, 400, 1, 13.0, 20.0);
      unit.begin_turn(SpeedWatch::factor * move.acceleration_degps2);
      feel(unit, counter, 600, 1, [](std::int64_t) { return sample_rad_of(1.3 * 30.0); });
      unit.end_turn(read_deg);
      const auto said = SpeedWatch::judge_turn({&unit}, move, read_deg);
      EXPECT_EQ(said.has_value(), std::abs(read_deg) < (turns_before > 0 ? 80.0 : 60.0)) << read_deg;
    }
  }
}

// Nothing but max_rate is asked of an axis that looks for its zero, whose angle may be set anew.
TEST(SpeedWatch, AnAxisThatLooksForItsZeroKeepsToItsLargestRate) {
  SpeedWatch speed(usual_limits, 1.0);
  TableStatus axes{};
  axes[2].rate_told = true;
  axes[2].rate_degps = -99.0;
  EXPECT_FALSE(speed.add(axes, 0.0, 0.0, std::nullopt, true));
  axes[2].position_deg = 350.0;
  EXPECT_FALSE(speed.add(axes, 0.1, 0.1, std::nullopt, true));
  axes[2].rate_degps = -120.0;
  const auto said = speed.add(axes, 0.2, 0.2, std::nullopt, true);
  ASSERT_TRUE(said);
  EXPECT_EQ(*said, "roll turns at 120 deg/s (by its own rate): expected at most 100 deg/s");
}

// One unit that goes mad is its own trouble: the least of those on the table counts.
TEST(SpeedWatch, OfSeveralUnitsTheLeastCounts) {
  FeltRate mad(unit_in_rad()), sane(unit_in_rad());
  for (FeltRate* unit : {&mad, &sane}) tell_scale(*unit, -400, 200, 0, 10.0, 10.0);
  feel(sane, 0, 100, 0, [](std::int64_t) { return 0.0; });
  feel(mad, 0, 100, 0, [](std::int64_t) { return sample_rad_of(500.0); });
  const SpeedWatch speed(usual_limits, 1.0);
  EXPECT_FALSE(speed.add_felt({&mad, &sane}, {}, std::nullopt, false));
  EXPECT_TRUE(speed.add_felt({&mad}, {}, std::nullopt, false));
}

// A unit whose scale is not known yet may weigh its pulses 1.7 times too high: beyond that a search is too fast.
TEST(SpeedWatch, ASearchIsFeltBeforeTheUnitsScaleIsKnown) {
  const SpeedWatch speed(usual_limits, 1.0);
  for (const double times : {1.5, 2.0}) {
    FeltRate felt(unit_in_rad());
    feel(felt, 0, 100, 1, [&](std::int64_t) { return sample_rad_of(times * usual_limits[0].max_rate_degps); });
    EXPECT_EQ(speed.add_felt({&felt}, {}, std::nullopt, true).has_value(), times > 1.7);
    EXPECT_FALSE(speed.add_felt({&felt}, {}, std::nullopt, false)) << "at rest nothing is known of it";
  }
}

// A line that takes 0.3 s for the three axes: how late an answer may be counts once, not with every poll.
TEST(SpeedWatch, ASlowLineHidesNoAxisThatTurnsTwiceAsFast) {
  SpeedWatch speed(usual_limits, 1.0);
  const Move move{Axis::heading, 360.0, 20.0, 60.0};
  TableStatus axes{};
  std::optional<std::string> said;
  double asked_s = 0.0;
  for (; !said && asked_s < 9.0; asked_s += 0.4) {
    axes[0].position_deg = 2.0 * move.rate_degps * (asked_s + 0.15);
    said = speed.add(axes, asked_s, asked_s + 0.3, move, false);
  }
  ASSERT_TRUE(said);
  EXPECT_LT(asked_s, 2.0) << *said;
}

// The last digit of an encoder does not stand still.
TEST(SpeedWatch, AFlickeringEncoderDoesNotTurn) {
  SpeedWatch speed(usual_limits, 1.0);
  const Move move{Axis::heading, 1.0, 0.02, 0.1};
  TableStatus axes{};
  for (int i = 0; i < 400; ++i) {
    axes[0].position_deg = 0.02 * 0.1 * i + (i % 2 == 0 ? 0.005 : -0.005);
    const auto said = speed.add(axes, 0.1 * i, 0.1 * i + 0.001, move, false);
    ASSERT_FALSE(said) << 0.1 * i << " s: " << *said;
  }
}

// A device that tells no rate: a search beyond max_rate, and one with an angle that is set anew twice.
TEST(SpeedWatch, ASearchIsJudgedByItsPositions) {
  for (const double factor : {1.3, 3.0, 8.0}) {
    SpeedWatch speed(usual_limits, 1.0);
    TableStatus axes{};
    std::optional<std::string> said;
    double now_s = 0.0;
    for (; !said && now_s < 10.0; now_s += 0.5) {
      axes[0].position_deg = 100.0 * factor * now_s;
      said = speed.add(axes, now_s, now_s + 0.01, std::nullopt, true);
    }
    ASSERT_TRUE(said) << factor;
    EXPECT_LE(now_s, 2.5) << *said;
  }
  SpeedWatch speed(usual_limits, 1.0);
  TableStatus axes{};
  for (int i = 0; i < 20; ++i) {
    axes[0].position_deg = 95.0 * 0.5 * i + (i < 7 ? 0.0 : i < 9 ? 400.0 : -700.0);
    const auto said = speed.add(axes, 0.5 * i, 0.5 * i + 0.01, std::nullopt, true);
    ASSERT_FALSE(said) << i << ": " << *said;
  }
}

TEST(SpeedWatch, AnAxisThatNothingSentKeepsToItsLargestRate) {
  SpeedWatch speed(usual_limits, 1.0);
  TableStatus axes{};
  axes[2].rate_told = true;
  axes[2].rate_degps = 300.0;
  const auto said = speed.add(axes, 0.0, 0.01, Move{Axis::heading, 90.0, 20.0, 60.0}, false);
  EXPECT_EQ(said.value_or(""), "roll turns at 300 deg/s (by its own rate): expected at most 100 deg/s");
}

// One sample of 1 rad in a resting unit; a hundred that the unit flags.
void expect_nothing_felt(std::int64_t first, std::int64_t last, std::uint32_t flags) {
  FeltRate felt(unit_in_rad());
  for (std::int64_t i = 0; i < 1000; ++i) {
    const bool bad = i >= first && i <= last;
    ImuSample sample;
    sample.counter = i;
    sample.flags = bad ? static_cast<decltype(sample.flags)>(flags) : decltype(sample.flags){};
    sample.gyro[2] = bad ? 1.0 : 0.0;
    felt.add(sample);
    EXPECT_EQ(felt.now_degps().value_or(0.0), 0.0) << i;
  }
}
TEST(FeltRate, AGlitchIsNotFelt) { expect_nothing_felt(500, 500, 0); }
TEST(FeltRate, AFlaggedSampleIsNotFelt) { expect_nothing_felt(500, 599, sample_flag_invalid); }

// ---- arrival monitor ----

// The arrival rule against axes that lie, one clause at a time.

constexpr Move to_90 = {Axis::pitch, 90.0, 10.0, 20.0};

MotionConfig arrival_config() {
  MotionConfig c;
  c.settle_s = 1.0;
  return c;
}

// Every axis at rest at zero but pitch as given.
TableStatus with_pitch(double position_deg, double rate_degps, bool moving, bool in_position) {
  TableStatus status{};
  for (AxisStatus& axis : status) {
    axis.moving = false;
    axis.in_position = true;
  }
  AxisStatus& pitch = status[std::size_t(Axis::pitch)];
  pitch.position_deg = position_deg;
  pitch.rate_degps = rate_degps;
  pitch.moving = moving;
  pitch.in_position = in_position;
  return status;
}

const TableStatus at_target = with_pitch(90.0, 0.0, false, true);
const TableStatus under_way = with_pitch(40.0, 10.0, true, false);

struct Poll {
  TableStatus status;
  double time_s;
  std::optional<RunEvent> event = {};
};
struct Story {
  const char* what;
  std::optional<Move> move;  // without one: to rest only
  std::vector<Poll> polls;
};

TEST(ArrivalMonitor, SaysWhatBecomesOfAMoveAndWhen) {
  using enum RunEvent;
  const TableStatus flickers = with_pitch(90.0, 0.0, false, false), away = with_pitch(-1.0, -10.0, true, false),
                    there = with_pitch(0.0, 0.0, false, true), turns = with_pitch(12.5, 1.0, true, false),
                    rests = with_pitch(13.0, 0.0, false, false);
  const Poll begun{under_way, 4.0};
  for (const Story& story :
       {Story{"the settle time",
              to_90,
              {begun, {at_target, 9.5, arrived}, {at_target, 10.4}, {at_target, 10.5, settled}}},
        {"within tolerance from the start, so that motion is never seen: three polls",
         Move{Axis::pitch, 0.005, 10.0, 20.0},
         {{there, 0.1}, {there, 0.2}, {there, 0.3, arrived}}},
        {"a flicker begins the settle time anew",
         to_90,
         {begun,
          {at_target, 9.5, arrived},
          {flickers, 10.0, unsettled},
          {at_target, 10.1, arrived},
          {at_target, 10.6},
          {at_target, 11.1, settled}}},
        {"two seconds without coming nearer", to_90, {begun, {under_way, 5.9}, {under_way, 6.0, stall}}},
        {"away is no progress", to_90, {{away, 1.0}, {with_pitch(-9.0, -10.0, true, false), 2.0, stall}}},
        {"90/10 + 2 * 10/20 + 10 = 20 s", to_90, {begun, {flickers, 19.9}, {flickers, 20.1, deadline}}},
        {"rest alone",
         {},
         {{with_pitch(12.0, 0.0, false, false), 0.5}, {turns, 0.9}, {rests, 1.5}, {rests, 1.9, settled}}},
        {"no rest", {}, {{turns, 11.1, deadline}}}}) {
    ArrivalMonitor monitor(arrival_config());
    if (story.move)
      monitor.start_move(*story.move, 0.0, 0.0);
    else
      monitor.settle_only(0.0);
    for (const Poll& poll : story.polls)
      EXPECT_EQ(monitor.update(poll.status, poll.time_s), poll.event) << story.what << " at " << poll.time_s;
  }
}

TEST(ArrivalMonitor, EveryClauseIsNeeded) {
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  TableStatus another = at_target;
  another[0].moving = true;
  for (const TableStatus& status :
       {with_pitch(90.0, 0.0, false, false),                                         // not in position
        with_pitch(90.0, 0.0, true, true),                                           // still says moving
        with_pitch(90.011, 0.0, false, true), with_pitch(89.989, 0.0, false, true),  // outside 0.01 deg
        with_pitch(450.0, 0.0, false, true),  // a turn too far is not here: positions are cumulative
        with_pitch(90.0, 0.011, false, true), with_pitch(90.0, -0.011, false, true),  // still turning
        with_pitch(unknown, 0.0, false, true), with_pitch(90.0, unknown, false, true), another}) {
    ArrivalMonitor monitor(arrival_config());
    monitor.start_move(to_90, 0.0, 0.0);
    EXPECT_EQ(monitor.update(under_way, 4.0), std::nullopt);
    EXPECT_EQ(monitor.update(status, 5.0), std::nullopt) << status[1].position_deg << ' ' << status[1].rate_degps;
  }
}

TEST(ArrivalMonitor, SlowMoveIsNoStall) {
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move({Axis::pitch, 1.0, 0.01, 1.0}, 0.0, 0.0);
  for (int i = 1; i < 1000; ++i)
    ASSERT_EQ(monitor.update(with_pitch(0.001 * i, 0.01, true, false), 0.1 * i), std::nullopt) << i;
}

TEST(ArrivalMonitor, PollsAreWorthMostAtTheEndOfTheMotion) {
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move(to_90, 0.0, 100.0);
  EXPECT_NEAR(monitor.allowed_s(), 20.0, 1e-12);
  EXPECT_NEAR(monitor.moment_of_interest_s(100.0), 109.5, 1e-12);
  EXPECT_EQ(monitor.update(under_way, 104.0), std::nullopt);
  EXPECT_EQ(monitor.update(at_target, 109.5), RunEvent::arrived);
  EXPECT_NEAR(monitor.moment_of_interest_s(109.5), 110.5, 1e-12);
}

}  // namespace
}  // namespace turncal
