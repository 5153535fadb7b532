#include "calib/rest_diagnosis/rest_diagnosis.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/rest_diagnosis/curve_of_two.h"
#include "calib/rest_diagnosis/rest_selection.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/segmentation.h"
#include "tests/calib/compress.h"
#include "tests/calib/hand_rotations.h"

namespace turncal {
namespace {

RestDiagnosis diagnose_hand(const HandPlan& plan) {
  const HandData hand = make_hand_data(plan);
  const CompressedRecording recording = compress(hand.info, hand.segments, hand.samples, rest_compression_options());
  const RestData data = make_rest_data(recording);
  Result<RestDiagnosis> result = diagnose_rests(data);
  EXPECT_TRUE(result.ok());
  return *result;
}

TEST(RestSelection, FTail) {
  // Tables: F(1, 10) at 0.05 is 4.9646, F(3, 20) at 0.01 is 4.9382.
  EXPECT_NEAR(f_tail(4.9646, 1.0, 10.0), 0.05, 1e-5);
  EXPECT_NEAR(f_tail(4.9382, 3.0, 20.0), 0.01, 1e-5);
  EXPECT_EQ(f_tail(0.0, 3.0, 20.0), 1.0);
}

TEST(RestDiagnosis, NothingIsFoundWhereNothingIs) {
  int alarms = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const RestDiagnosis d = diagnose_hand({.seed = seed});
    alarms += d.effects.empty() ? 0 : 1;
    EXPECT_TRUE(!d.effects.empty() || d.verdict == Verdict::clean);
  }
  EXPECT_LE(alarms, 1);  // of 20 at 1 %: two or more have probability 0.017
}

TEST(RestDiagnosis, GSensitivityIsFoundNamedAndMeasured) {
  HandPlan plan;
  plan.seed = 7;
  Eigen::Matrix3d G;
  G << 0.0, 150.0, 300.0, -500.0, 0.0, 350.0, -300.0, -300.0, 0.0;  // deg/h/g
  plan.effect = [G](const Eigen::Vector3d&, const Eigen::Vector3d& f, double, Eigen::Vector3d& w, Eigen::Vector3d&) {
    w += G * f / standard_gravity_mps2 * radps_per_degph;
  };
  const RestDiagnosis d = diagnose_hand(plan);
  EXPECT_EQ(d.verdict, Verdict::extended);
  ASSERT_GE(d.effects.size(), 5u);
  for (const RestEffect& e : d.effects) {
    ASSERT_EQ(e.column.entry->name, "gyro_g_sensitivity");
    EXPECT_NEAR(e.value, G(e.column.component / 3, e.column.component % 3), 4.0 * e.sigma);
  }
  EXPECT_LT(d.final.left_out.direction_rms_rad, 0.5 * d.base.left_out.direction_rms_rad);
  EXPECT_LT(d.left_out_after, 0.6 * d.left_out_before);
}

TEST(RestDiagnosis, DriftIsNotTakenForGSensitivity) {
  HandPlan plan;
  plan.seed = 9;
  plan.effect = [](const Eigen::Vector3d&, const Eigen::Vector3d&, double t, Eigen::Vector3d& w, Eigen::Vector3d& f) {
    w += Eigen::Vector3d(40000.0, 0.0, -25000.0) * radps_per_degph * t / 3600.0;  // deg/h/h
    f += Eigen::Vector3d(0.0, 0.0, 0.25) * t / 3600.0 * standard_gravity_mps2;
  };
  const RestDiagnosis d = diagnose_hand(plan);
  ASSERT_FALSE(d.effects.empty());
  bool accel = false;
  for (const RestEffect& e : d.effects) {
    EXPECT_TRUE(e.column.entry->name == "gyro_bias_drift" || e.column.entry->name == "accel_bias_drift")
        << e.column.key();
    accel = accel || e.column.entry->name == "accel_bias_drift";
    if (e.column.key() == "gyro_bias_drift.x") {
      EXPECT_NEAR(e.value, 40000.0, 4.0 * e.sigma);
    }
  }
  EXPECT_TRUE(accel);
}

TEST(RestDiagnosis, SaysWhatRestsCannotShow) {
  const RestDiagnosis d = diagnose_hand({});
  int heading = 0, trace = 0;
  for (const RestCandidate& c : d.candidates) {
    if (c.effect == "gyro_magnetic" || c.effect == "earth_rate") heading += c.remark == "needs the heading" ? 1 : 0;
    if (c.effect == "accel_delay" || c.effect == "accel_size_effect")
      trace += c.remark.starts_with("leaves no trace") ? 1 : 0;
  }
  EXPECT_EQ(heading, 2);
  EXPECT_EQ(trace, 2);
}

// Six rests leave 13 observations beyond the 21 parameters: any name would fit them.
TEST(RestDiagnosis, FewRestsGiveNoNames) {
  HandPlan plan;
  plan.rests = 6;
  plan.effect = [](const Eigen::Vector3d&, const Eigen::Vector3d& f, double, Eigen::Vector3d& w, Eigen::Vector3d&) {
    w.x() += 2000.0 * radps_per_degph * f.y() / standard_gravity_mps2;
  };
  const RestDiagnosis d = diagnose_hand(plan);
  EXPECT_TRUE(d.effects.empty());
  EXPECT_NE(d.not_tested.find("6 rests"), std::string::npos) << d.not_tested;
  for (const RestCandidate& c : d.candidates) EXPECT_FALSE(c.remark.empty()) << c.effect;
}

// What only an absurdly large value would show is not tested, and says so.
TEST(RestDiagnosis, AbsurdMagnitudesAreStruckOut) {
  HandPlan plan;
  plan.accel_noise_mps2 = 3.0;  // a sample: 5 sigma of some accelerometer polynomials is beyond a tenth of g
  plan.rests = 24;
  const RestDiagnosis d = diagnose_hand(plan);
  EXPECT_TRUE(d.effects.empty());
  int absurd = 0;
  for (const RestCandidate& c : d.candidates) {
    absurd += c.remark.starts_with("would have to be larger") ? 1 : 0;
    for (const double detectable : c.detectable)
      EXPECT_TRUE(std::isinf(detectable) || detectable <= absurd_magnitude(*find_effect(c.effect), 236.0)) << c.effect;
  }
  EXPECT_EQ(d.not_tested, "");
  EXPECT_GE(absurd, 1);
  EXPECT_EQ(absurd_magnitude(*find_effect("gyro_bias_drift"), 360.0), 1e5);
  EXPECT_EQ(absurd_magnitude(*find_effect("gyro_bias_drift")), 1e4);
  EXPECT_EQ(absurd_magnitude(*find_effect("gyro_g_sensitivity"), 360.0), 1e4);
  EXPECT_EQ(absurd_magnitude(*find_effect("gyro_lock_in"), 360.0), 100.0);  // %
}

// Undeclared disturbances: a curve in time, steps, a curve with force, and a scale factor that goes up and down.
TEST(RestDiagnosis, WhatNoEntryDescribesGetsNoName) {
  using Eigen::Vector3d;
  const std::vector<decltype(HandPlan::effect)> disturbances = {
      [](const Vector3d&, const Vector3d&, double t, Vector3d&, Vector3d& f) { f.z() += 0.05 * std::sin(t / 9.5); },
      [](const Vector3d&, const Vector3d&, double t, Vector3d& w, Vector3d&) {
        w.x() += (t > 60.0 ? 0.002 : 0.0) - (t > 110.0 ? 0.003 : 0.0);
      },
      [](const Vector3d&, const Vector3d& f, double, Vector3d& w, Vector3d&) {
        w.y() += 0.004 * std::exp(-std::pow((f.x() / 9.81 - 0.3) / 0.25, 2));
      },
      [](const Vector3d& w, const Vector3d&, double t, Vector3d& extra, Vector3d&) {
        extra.z() += 0.02 * std::sin(t / 12.0) * w.z();
      }};
  int named = 0;
  for (const auto& effect : disturbances)
    for (unsigned seed = 31; seed <= 35; ++seed) {
      const RestDiagnosis d = diagnose_hand({.rests = 26, .seed = seed, .effect = effect});
      named += d.effects.empty() ? 0 : 1;
      EXPECT_TRUE(!d.effects.empty() || d.verdict == Verdict::unexplained);
    }
  EXPECT_LE(named, 1);
}

// What a parabola of a gyro's bias came to, and what a drift beside a warm-up of a measured run came to: the second pair keeps its names.
TEST(CurveOfTwo, IsOfTwoThatStandAgainstEachOther) {
  const std::vector<EffectColumn> columns = {{find_effect("gyro_bias_drift"), 0, 0.0},
                                             {find_effect("gyro_warm_up"), 0, 480.0}};
  const auto found = [&](double correlation, double first, double second) {
    return curve_of_two(columns, Eigen::Vector2d(first, second), [=](int, int) {
      Eigen::Matrix2d G;
      G << 1.0, correlation, correlation, 1.0;
      return G;
    });
  };
  const CurveOfTwo parabola = found(-0.995959, 165.5, 157.3);
  EXPECT_EQ(parabola.what, "bias of gyro x with time");
  EXPECT_NE(parabola.why.find("gyro_bias_drift.x and gyro_warm_up.x"), std::string::npos);
  EXPECT_FALSE(found(-0.992587, 99.2, 33.8).found());
  EXPECT_FALSE(found(-0.96, 165.5, 157.3).found()) << "not of one class";
  EXPECT_FALSE(found(-0.995959, 165.5, -157.3).found()) << "with each other";
  std::vector<EffectColumn> other_axis = columns;
  other_axis[1].component = 1;
  EXPECT_FALSE(curve_of_two(other_axis, Eigen::Vector2d(165.5, 157.3), [](int, int) {
                 Eigen::Matrix2d G;
                 G << 1.0, -0.995959, -0.995959, 1.0;
                 return G;
               }).found());
}

// Further components of a name are taken by BIC from 2.3 sigma on.
TEST(RestDiagnosis, ComponentsAreClear) {
  using Eigen::Vector3d;
  int extra = 0, kept = 0, unclear = 0;
  for (unsigned seed = 61; seed <= 90; ++seed) {
    HandPlan plan{.rests = 30, .seed = seed};
    plan.effect = [](const Vector3d&, const Vector3d& f, double, Vector3d& w, Vector3d&) {
      w.y() += 900.0 * radps_per_degph * f.x() / standard_gravity_mps2;
    };
    const RestDiagnosis d = diagnose_hand(plan);
    for (const RestEffect& e : d.effects) {
      (e.column.key() == "gyro_g_sensitivity.yx" ? kept : extra) += 1;
      unclear += std::abs(e.value) < 3.0 * e.sigma;
    }
  }
  EXPECT_GE(kept, 27);
  EXPECT_LE(extra, 2);
  EXPECT_LE(unclear, 1);  // without which what is left out is predicted worse
}

}  // namespace
}  // namespace turncal
