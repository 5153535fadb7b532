#include "orchestrator/jobs/design/sequence_design.h"

#include "calib/prediction/predict.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/station/station_config.h"
#include "tests/test.h"

namespace turncal {
namespace {

DesignTask task_of(double time_s) {
  DesignTask task;
  task.info.latitude_deg = 29.53;
  task.info.gravity_mps2 = 9.7914;
  task.info.sample_period_s = 0.005;
  task.info.accel_pulse_mps = 0.0005;
  task.limits = plan_limits(default_station_config(), task.info.sample_period_s);
  task.predict.noise.angle_random_walk.setConstant(0.002 * radprs_per_degprh);
  task.predict.noise.velocity_random_walk.setConstant(8.0 * mpsprs_per_ugprHz);
  task.time_s = time_s;
  task.tries = 60;
  const Result<Sequence> sequence = read_sequence(TURNCAL_SOURCE_DIR "/sequences/fourteen_step.seq");
  EXPECT_TRUE(sequence.ok());
  task.start = walk_of(*sequence);
  const Plan plan = make_plan(*sequence, task.limits);
  task.aim = predict(task.info, planned_motion(*sequence, plan), task.predict).sigma;
  return task;
}

bool go_on(const DesignProgress&) { return true; }

Result<Sequence> sequence_of(const Design& design) {
  WalkHeader header;
  header.name = "designed";
  return parse_sequence(sequence_text(design.walk, header), "designed.seq");
}

TEST(SequenceDesign, IsBetterThanItsStartAndCanBeRun) {
  const DesignTask task = task_of(2400.0);
  const Result<Design> design = good(design_walk(task, go_on));
  EXPECT_LT(design->cost, design->start_cost - 0.05);
  const Result<Sequence> sequence = good(sequence_of(*design));
  const Plan plan = make_plan(*sequence, task.limits);
  EXPECT_TRUE(plan.ok());
  EXPECT_LE(plan.station_s, task.time_s);
  EXPECT_GT(plan.station_s, task.time_s - double(design->walk.legs.size()) - 2.0) << "no time is left over";
  for (const PlannedItem& item : plan.items) {
    if (item.kind != SequenceItem::Kind::dwell) continue;
    EXPECT_GE(item.duration_s, task.least_rest_s);
  }
}

TEST(SequenceDesign, KeepsToTheAxesAndTheTravelOfTheTable) {
  DesignTask task = task_of(1500.0);
  task.turns[index(Axis::heading)] = false;
  for (const Axis axis : {Axis::pitch, Axis::roll}) {
    task.limits.axis[index(axis)].soft_min_deg = -180.0;
    task.limits.axis[index(axis)].soft_max_deg = 180.0;
  }
  const Result<Design> design = good(design_walk(task, go_on));
  AxisTriple at = design->walk.start_deg;
  for (const Leg& leg : design->walk.legs) {
    EXPECT_NE(leg.axis, Axis::heading);
    at[leg.axis] += leg.turn_deg;
    EXPECT_LE(std::abs(at[leg.axis]), 180.0);
  }
}

// What the fourteen steps need, and this table has not: their start, their turns, their rate. Whole turns are the same pose.
TEST(SequenceDesign, IsFoundForATableThatCannotDoTheFourteenSteps) {
  DesignTask task = task_of(1500.0);
  task.limits.axis[index(Axis::heading)] = {
      .soft_min_deg = 20.0, .soft_max_deg = 65.0, .max_rate_degps = 4.0, .wrap_deg = 0.0};
  task.limits.axis[index(Axis::pitch)] = {.soft_min_deg = -540.0, .soft_max_deg = -330.0, .wrap_deg = 180.0};
  task.limits.axis[index(Axis::roll)] = {.soft_min_deg = -45.5, .soft_max_deg = 200.5, .wrap_deg = 100.0};
  task.start = on_table(task.start, task.limits);
  EXPECT_EQ(task.start.start_deg[Axis::heading], 20.0);
  EXPECT_EQ(task.start.start_deg[Axis::pitch], -360.0);
  const Result<Design> design = good(design_walk(task, go_on));
  EXPECT_LT(design->cost, design->start_cost);
  const Result<Sequence> sequence = good(sequence_of(*design));
  const Plan plan = make_plan(*sequence, task.limits);
  EXPECT_TRUE(plan.ok()) << plan.violations.front();
  EXPECT_LE(plan.station_s, 1500.0);
}

TEST(SequenceDesign, SaysWhatCannotBe) {
  DesignTask task = task_of(1500.0);
  task.turns = {};
  EXPECT_EQ(design_walk(task, go_on).error().message, "no axis may turn by a degree: expected at least one that may");
  task.turns = {true, true, true};
  task.time_s = 5.0;
  EXPECT_SAYS(design_walk(task, go_on).error().message, "not even one turn of 30 deg");
}

TEST(SequenceDesign, ShowsTheEffectsThatAreAskedFor) {
  DesignTask task = task_of(2400.0);
  task.aim *= 3.0;  // easily had: what is left to do are the effects
  task.predict.effects = true;
  const Result<Sequence> reference = read_sequence(TURNCAL_SOURCE_DIR "/sequences/fourteen_step.seq");
  task.effect_aims =
      predict(task.info, planned_motion(*reference, make_plan(*reference, task.limits)), task.predict).effects;
  const auto detectable = [&](const Design& design) {
    const Result<Sequence> sequence = sequence_of(design);
    double sum = 0.0;
    int n = 0;
    for (const PredictedEffect& effect :
         predict(task.info, planned_motion(*sequence, make_plan(*sequence, task.limits)), task.predict).effects)
      if (effect.column.entry->name == "gyro_rate_nonlinearity" && effect.visible) {
        sum += std::log(effect.detectable);
        ++n;
      }
    return sum / n;
  };
  task.rates_degps = {10.0, 20.0};
  const Result<Design> without = good(design_walk(task, go_on));
  task.effects = {"gyro_rate_nonlinearity"};
  const Result<Design> with = good(design_walk(task, go_on));
  EXPECT_LT(detectable(*with), detectable(*without));
}

}  // namespace
}  // namespace turncal
