#include "calib/evidence/rest_diagnosis.h"

#include "tests/test.h"

#include <Eigen/LU>

#include "calib/evidence/piece_system.h"
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
  return *good(diagnose_rests(data));
}

TEST(Distributions, FTail) {
  // Tables: F(1, 10) at 0.05 is 4.9646, F(3, 20) at 0.01 is 4.9382.
  EXPECT_NEAR(f_tail(4.9646, 1.0, 10.0), 0.05, 1e-5);
  EXPECT_NEAR(f_tail(4.9382, 3.0, 20.0), 0.01, 1e-5);
  EXPECT_EQ(f_tail(0.0, 3.0, 20.0), 1.0);
}

TEST(RestDiagnosis, NothingIsFoundWhereNothingIs) {
  int alarms = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const RestDiagnosis d = diagnose_hand({.seed = seed});
    alarms += d.diagnosis.verdict == Verdict::clean ? 0 : 1;
    EXPECT_TRUE(d.diagnosis.extended.effects.empty());
  }
  EXPECT_LE(alarms, 1);
}

TEST(RestDiagnosis, GSensitivityIsFoundNamedAndMeasured) {
  HandPlan plan;
  plan.seed = 7;
  Eigen::Matrix3d G;
  G << 0.0, 150.0, 300.0, -500.0, 0.0, 350.0, -300.0, -300.0, 0.0;  // deg/h/g
  plan.effect = [G](const Eigen::Vector3d&, const Eigen::Vector3d& f, double, Eigen::Vector3d& w, Eigen::Vector3d&) {
    w += G * f / standard_gravity_mps2 * radps_per_degph;
  };
  const RestDiagnosis r = diagnose_hand(plan);
  const Diagnosis& d = r.diagnosis;
  EXPECT_EQ(d.verdict, Verdict::extended);
  ASSERT_GE(d.extended.effects.size(), 5u);
  for (const EstimatedEffect& e : d.extended.effects) {
    ASSERT_EQ(e.column.entry->name, "gyro_g_sensitivity");
    EXPECT_NEAR(e.value, G(e.column.component / 3, e.column.component % 3), 4.0 * e.sigma);
  }
  EXPECT_LT(r.final.left_out.direction_rms_rad, 0.5 * r.base.left_out.direction_rms_rad);
  EXPECT_LT(d.holdout_after.normalised_rms, 0.6 * d.holdout_before.normalised_rms);
  EXPECT_EQ(d.statements.said().size(), 3u) << d.reason;
}

TEST(RestDiagnosis, DriftIsNotTakenForGSensitivity) {
  HandPlan plan;
  plan.seed = 9;
  plan.effect = [](const Eigen::Vector3d&, const Eigen::Vector3d&, double t, Eigen::Vector3d& w, Eigen::Vector3d& f) {
    w += Eigen::Vector3d(40000.0, 0.0, -25000.0) * radps_per_degph * t / 3600.0;  // deg/h/h
    f += Eigen::Vector3d(0.0, 0.0, 0.25) * t / 3600.0 * standard_gravity_mps2;
  };
  const Diagnosis d = diagnose_hand(plan).diagnosis;
  std::set<std::string> said;
  for (const Statement& s : d.statements.said()) {
    EXPECT_EQ(s.driver, "time") << s.sensor;
    said.insert(s.sensor);
  }
  EXPECT_TRUE(said.contains("gyro x") && said.contains("gyro z") && said.contains("accelerometer z")) << d.reason;
  for (const EstimatedEffect& e : d.extended.effects) {
    EXPECT_TRUE(e.column.entry->driver == Driver::time) << e.column.key();
    if (e.column.key() == "gyro_bias_drift.x") {
      EXPECT_NEAR(e.value, 40000.0, 4.0 * e.sigma);
    }
  }
}

TEST(RestDiagnosis, SaysWhatRestsCannotShow) {
  const Diagnosis d = diagnose_hand({}).diagnosis;
  for (const char* heading : {"gyro_magnetic", "earth_rate", "sample_period", "accel_delay", "accel_size_effect"})
    EXPECT_NE(std::find(d.undetectable.begin(), d.undetectable.end(), heading), d.undetectable.end()) << heading;
}

// Six rests leave 13 observations beyond the 21 parameters: any name would fit them.
TEST(RestDiagnosis, FewRestsGiveNoNames) {
  HandPlan plan;
  plan.rests = 6;
  plan.effect = [](const Eigen::Vector3d&, const Eigen::Vector3d& f, double, Eigen::Vector3d& w, Eigen::Vector3d&) {
    w.x() += 2000.0 * radps_per_degph * f.y() / standard_gravity_mps2;
  };
  const RestDiagnosis d = diagnose_hand(plan);
  EXPECT_TRUE(d.diagnosis.extended.effects.empty());
  EXPECT_FALSE(d.diagnosis.statements.tested);
  EXPECT_NE(d.not_tested.find("6 rests"), std::string::npos) << d.not_tested;
}

// What only an absurdly large value would show is not tested, and says so.
TEST(RestDiagnosis, AbsurdMagnitudesAreStruckOut) {
  HandPlan plan;
  plan.accel_noise_mps2 = 3.0;  // a sample: 5 sigma of some accelerometer polynomials is beyond a tenth of g
  plan.rests = 24;
  const RestDiagnosis d = diagnose_hand(plan);
  EXPECT_TRUE(d.diagnosis.extended.effects.empty());
  int absurd = 0;
  for (const CandidateScore& c : d.diagnosis.candidates) {
    absurd += c.sigma > 0.0 && !c.visible ? 1 : 0;
    EXPECT_TRUE(!c.visible || c.detectable <= absurd_magnitude(*c.column.entry, 236.0)) << c.column.key();
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
      named += d.diagnosis.extended.effects.empty() ? 0 : 1;
      EXPECT_NE(d.diagnosis.verdict, Verdict::clean);
    }
  EXPECT_LE(named, 1);
}

// A row of components is one term: what is beside the one that is there is within its sigma.
TEST(RestDiagnosis, ComponentsAreClear) {
  using Eigen::Vector3d;
  int extra = 0, kept = 0;
  for (unsigned seed = 61; seed <= 72; ++seed) {
    HandPlan plan{.rests = 30, .seed = seed};
    plan.effect = [](const Vector3d&, const Vector3d& f, double, Vector3d& w, Vector3d&) {
      w.y() += 900.0 * radps_per_degph * f.x() / standard_gravity_mps2;
    };
    for (const EstimatedEffect& e : diagnose_hand(plan).diagnosis.extended.effects)
      if (e.column.key() == "gyro_g_sensitivity.yx")
        ++kept;
      else
        extra += std::abs(e.value) < 3.0 * e.sigma ? 0 : 1;
  }
  EXPECT_GE(kept, 11);
  EXPECT_LE(extra, 1);
}

// Against the same by dense matrices.
TEST(PieceSystem, OfObservationsIsALeastSquaresProblem) {
  constexpr int rows = 29, parameters = 4, columns = 3;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const auto drawn = [&](int n, int m) { return Eigen::MatrixXd::NullaryExpr(n, m, [&] { return normal(random); }); };
  const Eigen::MatrixXd J = drawn(rows, parameters), C = drawn(rows, columns);
  const Eigen::VectorXd r = drawn(rows, 1);
  const PieceSystem system(J, r, 0.0);
  const PieceSystem::Block block = system.blocks({Weights::of_rows(C)}).front();
  const Eigen::MatrixXd A_inverse = (J.transpose() * J).inverse();
  const Eigen::MatrixXd P = Eigen::MatrixXd::Identity(rows, rows) - J * A_inverse * J.transpose();
  const Eigen::MatrixXd Q = C.transpose() * P * C;
  const Eigen::VectorXd s = -C.transpose() * P * r;
  EXPECT_LT((block.Q - Q).norm(), 1e-6 * Q.norm());
  EXPECT_LT((block.s - s).norm(), 1e-9 * s.norm());
  EXPECT_LT((block.shift + A_inverse * J.transpose() * C).norm(), 1e-9);
  EXPECT_LT((system.fit_shift() + A_inverse * J.transpose() * r).norm(), 1e-9);
  EXPECT_LT((system.times(Eigen::MatrixXd::Identity(36, 36)).topLeftCorner(rows, rows) - P).norm(), 1e-9);
}

}  // namespace
}  // namespace turncal
