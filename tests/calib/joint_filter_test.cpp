// The filter of the joint estimate: its derivatives against differences, on random linear systems against generalised least squares with the
// whole covariance of all observations, and its noise of counting against counts.
#include "calib/joint/joint_filter.h"

#include <Eigen/Cholesky>

#include "calib/joint/linear_motion.h"
#include "calib/model/effects.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

// The sensitivities that run_filter() carries for the parameters and for every effect of the catalogue, against differences of
// its own chi-square: d chi2 / dp = 2 sum N' S^-1 nu, d2 chi2 / dp2 = 2 sum N' S^-1 N (Gauss-Newton: the data are noise-free
// and the parameters near the truth, so what is dropped is small). The second difference also holds what a parameter does to
// the gains and to the first levelling, which the columns leave out: 0.5 % of the information, 1.4 % for a warm-up of 60 s.
// Twelve-state noise, a few effects in force, parameters off by some sigma: everything the columns can depend on.
TEST(JointFilter, JacobianAgreesWithDifferences) {
  RigConfig config = noise_free(default_rig_config());
  config.seed = 5;
  config.temperature.rise_c = 6.0;
  Sequence brief = must_read_sequence("short_demo.seq");
  brief.steps.resize(6);
  const RigRecording made = record_on_rig(brief, config);
  const RecordingInfo& info = made.recording.info;
  const std::vector<EffectColumn> columns = catalogue_columns(info);
  const EffectModel effects = make_effect_model(columns, {info.latitude_deg}, made.recording.mean_temperature_c);
  FilterSetup setup;
  setup.noise.accel_pulse_mps = config.accel_pulse_mps;
  setup.noise.gyro_bias_instability_radps = 5e-9;
  setup.noise.accel_bias_instability_mps2 = 1e-5;

  const FilterResult at_truth = run_filter(made.recording, made.truth, effects, setup);
  const Eigen::Index n = parameter_count + effects.columns;
  ASSERT_EQ(at_truth.information.rows(), n);
  const Eigen::VectorXd sigma = at_truth.information.diagonal().cwiseSqrt().cwiseInverse();
  const auto excited = [&](Eigen::Index k) { return sigma[k] < 1e100; };
  // A place a tenth of a sigma from the minimum in every column: what hardly shows here (an error of the earth rate) is linear no further.
  Eigen::VectorXd place = (Eigen::VectorXd(n) << to_vector(made.truth), effects.values).finished();
  for (Eigen::Index k = 0; k < n; ++k) place[k] += excited(k) ? (k % 2 == 0 ? 0.1 : -0.06) * sigma[k] : 0.0;
  const auto filtered = [&](const Eigen::VectorXd& at, bool with_columns) {
    EffectModel model = effects;
    model.values = at.tail(effects.columns);
    setup.with_columns = with_columns;
    return run_filter(made.recording, from_vector(at.head<parameter_count>()), model, setup);
  };
  const FilterResult here = filtered(place, true);
  const double centre = filtered(place, false).chi_square;
  int looked_at = 0;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!excited(k)) continue;
    const double h = sigma[k];
    const Eigen::VectorXd step = h * Eigen::VectorXd::Unit(n, k);
    const double plus = filtered(place + step, false).chi_square, minus = filtered(place - step, false).chi_square;
    const std::string name(k < parameter_count ? std::string(parameter_keys[std::size_t(k)])
                                               : columns[std::size_t(k - parameter_count)].key());
    // In units in which the information of each column is 1. The error of the earth rate hardly shows here: its column is right to 0.3 %.
    const double right_to = name == "earth_rate.up" ? 3e-3 : 2e-3;
    EXPECT_NEAR((plus - minus) / 4.0, here.gradient[k] * h, right_to * std::sqrt(here.chi_square)) << name;
    EXPECT_NEAR((plus - 2.0 * centre + minus) / 2.0, here.information(k, k) * h * h, 0.02) << name;
    ++looked_at;
  }
  EXPECT_GT(looked_at, 24 + 60);
}

std::vector<LinearInterval> random_intervals(std::mt19937_64& random, int columns) {
  std::normal_distribution<double> normal;
  const auto M = [&](Eigen::Index rows, Eigen::Index cols, double size) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return size * normal(random); });
  };
  std::vector<LinearInterval> intervals(14);
  for (std::size_t k = 0; k < intervals.size(); ++k) {
    LinearInterval& i = intervals[k];
    i.begins_chain = k == 0 || k == 9;
    i.begins_recording = k == 9;
    i.still = k % 3 != 2;
    i.observed = i.still && k != 4;
    i.t = 0.5 + 0.1 * double(k);
    i.cut_psi = k == 6 ? 1e-3 : 0.0;
    i.cut_v = k == 6 ? 0.1 : 0.0;
    i.jump_psi = M(3, 1, 1e-3), i.jump_v = M(3, 1, 0.1), i.v_start.setZero();
    i.turn = rotation_exp(M(3, 1, 0.1));
    i.v_psi = M(3, 3, 5.0), i.psi_bg = M(3, 3, 1.0), i.v_bg = M(3, 3, 1.0), i.v_ba = M(3, 3, 1.0);
    i.B_psi = M(columns, 3, 1.0), i.B_v = M(columns, 3, 1.0), i.D = M(columns, 3, 1.0);
    i.C = rotation_exp(M(3, 1, 1.0));
    i.F = skew(Eigen::Vector3d(0.0, 9.8, 0.0));
    i.y = M(3, 1, 0.1);
    i.quantisation = M(3, 1, 0.01).cwiseAbs2();
    for (int source = 0; source < (i.still ? 0 : 2); ++source) {
      const Eigen::MatrixXd root = M(6, 6, 0.03), Q = root * root.transpose();
      i.noise.push_back({Q.topLeftCorner(3, 3), Q.topRightCorner(3, 3), Q.bottomRightCorner(3, 3)});
    }
  }
  return intervals;
}

// Of [psi, v, b_g, b_a; all observations so far]: covariance, mean, derivatives, without any gain.
struct Dense {
  Eigen::MatrixXd V = Eigen::MatrixXd::Zero(12, 12);
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(12), y = Eigen::VectorXd::Zero(12);
  Eigen::MatrixXd X;

  Dense(const std::vector<LinearInterval>& intervals, const FilterSetup& setup, const std::vector<double>& weights) {
    X.setZero(12, intervals.front().B_psi.rows());
    const double b_g = std::pow(setup.noise.gyro_bias_instability_radps, 2);
    const double b_a = std::pow(setup.noise.accel_bias_instability_mps2, 2);
    for (const LinearInterval& i : intervals) {
      if (i.begins_chain) {
        mean.head(12).setZero(), X.topRows(12).setZero();
        V.topRows(12).setZero(), V.leftCols(12).setZero();
        V.diagonal().head(12) << std::pow(setup.initial_tilt_sigma_rad, 2),
            std::pow(setup.initial_heading_sigma_rad, 2), std::pow(setup.initial_tilt_sigma_rad, 2),
            Eigen::Vector3d::Constant(std::pow(setup.initial_velocity_sigma_mps, 2)), Eigen::Vector3d::Constant(b_g),
            Eigen::Vector3d::Constant(b_a);
      } else {
        V.diagonal().head(3).array() += i.cut_psi;
        V.diagonal().segment(3, 3).array() += i.cut_v;
        mean.head(3) -= i.jump_psi;
        mean.segment(3, 3) -= i.jump_v;
      }
      const double rho = std::exp(-i.t / setup.noise.bias_correlation_s);
      Eigen::Matrix<double, 12, 12> T = rho * Eigen::Matrix<double, 12, 12>::Identity(), Q = 0.0 * T;
      T.topLeftCorner<6, 6>().setIdentity();
      T.block<3, 3>(0, 0) = i.turn, T.block<3, 3>(0, 6) = i.psi_bg;
      T.block<3, 3>(3, 0) = i.v_psi, T.block<3, 3>(3, 6) = i.v_bg, T.block<3, 3>(3, 9) = i.v_ba;
      Q.diagonal().tail<6>() << Eigen::Vector3d::Constant((1.0 - rho * rho) * b_g),
          Eigen::Vector3d::Constant((1.0 - rho * rho) * b_a);
      Eigen::Matrix<double, 12, 3> with_z = Eigen::Matrix<double, 12, 3>::Zero();
      Eigen::Matrix<double, 3, 12> H;
      H << -0.5 * i.t * i.F, Eigen::Matrix3d::Identity(), -i.t * i.t / 6.0 * i.F * i.C, 0.5 * i.t * i.C;
      Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
      const auto enter = [&](double weight, const auto& n) {
        Q.topLeftCorner<3, 3>() += weight * n.psi_psi, Q.block<3, 3>(3, 3) += weight * n.v_v;
        Q.block<3, 3>(0, 3) += weight * n.psi_v, Q.block<3, 3>(3, 0) += weight * n.psi_v.transpose();
      };
      for (std::size_t k = 0; k < i.noise.size(); ++k) enter(weights[k], i.noise[k]);
      if (i.still) {
        const WalkNoise walk = walk_noise(setup.noise);
        const StepNoise q = step_noise(i.C * walk.gyro.asDiagonal() * i.C.transpose(),
                                       i.C * walk.accel.asDiagonal() * i.C.transpose(), i.F, i.t);
        enter(1.0, q);
        with_z << q.psi_z, q.v_z, Eigen::Matrix<double, 6, 3>::Zero();
        R = q.z_z + i.C * i.quantisation.asDiagonal() * i.C.transpose();
      }
      const Eigen::Index n = V.rows(), more = i.observed ? 3 : 0;
      Eigen::MatrixXd step = Eigen::MatrixXd::Zero(n + more, n);  // of all that is there
      step.topRows(n).setIdentity();
      step.topLeftCorner(12, 12) = T;
      if (i.observed) step.bottomLeftCorner(3, 12) = H;
      V = (step * V * step.transpose()).eval();
      V.topLeftCorner(12, 12) += Q;
      mean = (step * mean).eval(), X = (step * X).eval();
      if (i.observed) {
        V.bottomRightCorner(3, 3) += R;
        V.topRightCorner(12, 3) += with_z, V.bottomLeftCorner(3, 12) += with_z.transpose();
        X.bottomRows(3) += i.D.transpose();
        y.conservativeResize(n + 3);
        y.tail(3) = i.y;
      }
      X.topRows(3) += i.B_psi.transpose(), X.middleRows(3, 3) += i.B_v.transpose();
    }
  }
};

TEST(JointFilter, IsGeneralisedLeastSquares) {
  std::mt19937_64 random(8);
  for (int k = 0; k < 20; ++k) {
    FilterSetup setup;
    setup.noise.angle_random_walk.setConstant(0.01);
    setup.noise.velocity_random_walk.setConstant(0.05);
    setup.noise.bias_correlation_s = 5.0;
    setup.noise.gyro_bias_instability_radps = k % 2 == 0 ? 0.02 : 0.0;
    setup.noise.accel_bias_instability_mps2 = k % 2 == 0 ? 0.03 : 0.0;
    setup.initial_velocity_sigma_mps = 0.3;
    const std::vector<LinearInterval> intervals = random_intervals(random, 5);
    const FilterResult filtered = run_filter(intervals, setup, {0.5, 2.0});
    const Dense dense(intervals, setup, {0.5, 2.0});
    const Eigen::Index n = dense.y.size() - 12;
    const Eigen::VectorXd nu = (dense.y - dense.mean).tail(n);
    const Eigen::MatrixXd G = dense.X.bottomRows(n);
    const Eigen::LLT<Eigen::MatrixXd> V(dense.V.bottomRightCorner(n, n));
    ASSERT_EQ(filtered.observations, n);
    EXPECT_NEAR(filtered.chi_square / nu.dot(V.solve(nu)), 1.0, 1e-8) << k;
    EXPECT_NEAR(filtered.log_determinant, 2.0 * Eigen::MatrixXd(V.matrixL()).diagonal().array().log().sum(), 1e-8) << k;
    EXPECT_TRUE(filtered.information.isApprox(G.transpose() * V.solve(G), 1e-8)) << k;
    EXPECT_TRUE(filtered.gradient.isApprox(G.transpose() * V.solve(nu), 1e-8)) << k;
  }
}

// A count that falls short of a steady velocity, from anywhere; on the mean over a range, for one tooth more or less is not known.
TEST(JointFilter, QuantisationIsThatOfACountedVelocity) {
  constexpr int samples = 200;
  constexpr double pulse = 0.0005;
  const auto measured = [&](double teeth) {
    constexpr int phases = 200;
    double square = 0.0;
    double sum = 0.0;
    for (int phase = 0; phase < phases; ++phase) {
      double mean = 0.0;
      for (int k = 0; k < samples; ++k) {
        const double v = 0.618034 * phase + (k + 0.5) * teeth / samples;
        mean += (v - std::floor(v)) / samples;
      }
      sum += mean / phases;
      square += mean * mean / phases;
    }
    return pulse * pulse * (square - sum * sum);
  };
  const std::pair<double, double> ranges[] = {{0.02, 0.3}, {3.0, 9.0}, {20.0, 40.0}, {60.0, 75.0}, {90.0, 99.0}};
  for (const auto& [from, to] : ranges) {
    double expected = 0.0;
    double model = 0.0;
    constexpr int steps = 400;
    for (int i = 0; i < steps; ++i) {
      const double teeth = from + (to - from) * (i + 0.5) / steps;
      expected += measured(teeth);
      model += quantisation_variance(teeth + 3.0 * samples, samples, pulse);
    }
    EXPECT_NEAR(model / expected, 1.0, 0.25) << from;
  }
}

}  // namespace
}  // namespace turncal
