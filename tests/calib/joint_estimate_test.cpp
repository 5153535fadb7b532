// The joint estimate against the truth of two simulators that share no code with it, and against what it should refuse.
// The long statistics (200 runs, normalised error parameter by parameter) are scripts/study-joint; docs/accuracy.md.
#include "calib/joint/joint_estimate.h"

#include <Eigen/Cholesky>
#include "calib/joint/joint_filter.h"
#include "calib/joint/linear_motion.h"
#include "calib/model/effects.h"
#include "imu_io/base/key_value.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

RigRecording run_of(std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = 5000 + seed;
  config.noise_seed = 6000 + seed;
  return record_on_rig(fourteen_steps(), config);
}

// Twelve units: the mean of 12 chi-squares of 21 degrees of freedom lies within 21 +- 2.58 sqrt(42/12), 99 of 100 times.
// The estimate starts from the values of Wang (2020); scale factors of gyros and accelerometers are per cents off.
TEST(JointEstimate, ErrorsAreWhatSigmaSays) {
  double sum = 0.0;
  constexpr int runs = 12;
  for (int seed = 1; seed <= runs; ++seed) {
    const RigRecording made = run_of(std::uint64_t(seed));
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    ASSERT_EQ(r.free.size(), 21u);
    EXPECT_TRUE(r.undetermined.empty());
    EXPECT_TRUE(r.faults.empty()) << r.faults.front().what;
    EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
    sum += nees(r, made.truth);
  }
  EXPECT_NEAR(sum / runs, 21.0, 2.58 * std::sqrt(42.0 / runs));
}

// The noise that the rig was given: 0.002 deg/sqrt(h), 8 ug/sqrt(Hz). The fit knows its own uncertainty.
TEST(JointEstimate, MeasuresTheNoise) {
  for (const double times : {1.0, 3.0}) {
    RigConfig config = default_rig_config();
    config.noise.gyro_random_walk_deg_per_rt_h *= times;
    config.noise.accel_random_walk_ug_per_rt_hz *= times;
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    const JointResult r = joint_estimate(record_on_rig(fourteen_steps(), config).recording);
    ASSERT_TRUE(r.noise_fit.has_value());
    EXPECT_TRUE(r.noise_fit->converged);
    EXPECT_LE(r.noise_fit->evaluations, 30);  // an instability that promises nothing is not looked for
    const double arw = config.noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh;
    const double vrw = config.noise.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz;
    EXPECT_NEAR(r.noise.angle_random_walk.x(), arw, 3.5 * r.noise_fit->sigma_angle_random_walk.x());
    EXPECT_LT(r.noise_fit->sigma_angle_random_walk.x(), 0.08 * arw);
    EXPECT_NEAR(r.noise.velocity_random_walk.x(), vrw, 0.04 * vrw);  // what is left of the quantisation included
  }
}

// A noise model three times too small is not believed: the result says that the innovations are not white at it.
TEST(JointEstimate, SaysWhenTheGivenNoiseDoesNotFit) {
  const RigRecording made = run_of(31);
  const JointResult fitted = joint_estimate(made.recording);
  JointOptions options;
  options.noise = fitted.noise;
  EXPECT_TRUE(joint_estimate(made.recording, options).whiteness.white);
  options.noise->angle_random_walk /= 3.0;
  options.noise->velocity_random_walk /= 3.0;
  options.noise->accel_pulse_mps /= 3.0;
  const JointResult r = joint_estimate(made.recording, options);
  EXPECT_FALSE(r.whiteness.white);
  EXPECT_GT(r.whiteness.level, 4.0);
}

// Step 1 alone turns about two axes, and by half turns at most.
TEST(JointEstimate, NamesWhatIsNotDetermined) {
  Sequence one = fourteen_steps();
  one.steps.resize(1);
  const JointResult r = joint_estimate(record_on_rig(one, default_rig_config()).recording);
  ASSERT_FALSE(r.undetermined.empty());
  int lost = 0;
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[k] && !r.determined[k]) {
      ++lost;
      EXPECT_EQ(r.sigma[k], 0.0) << parameter_keys[k] << " has no sigma to print";
    }
  EXPECT_GE(lost, 2);
  for (const Undetermined& u : r.undetermined) EXPECT_FALSE(u.combination.empty());
}

struct Bound {
  const char* key;
  double sigma;
};
// The sigmas that another implementation of the same estimate reached on this recording, rounded up.
constexpr Bound bounds[] = {{"N01", 0.0021}, {"N02", 0.0030}, {"N03", 0.0021}, {"n11", 3.6e-7}, {"n12", 1.1e-6},
                            {"n13", 1.0e-6}, {"n21", 1.2e-6}, {"n22", 5.2e-7}, {"n23", 7.5e-7}, {"n31", 1.9e-6},
                            {"n32", 8.2e-7}, {"n33", 3.7e-7}, {"A01", 3.0e-7}, {"A02", 2.3e-7}, {"A03", 2.9e-7},
                            {"a11", 3.1e-7}, {"a12", 1.1e-6}, {"a13", 1.9e-6}, {"a22", 2.3e-7}, {"a23", 9.7e-7},
                            {"a33", 2.9e-7}};

TEST(JointEstimateShared, CleanRecordingOfAnotherSimulator) {
  const std::filesystem::path folder = std::filesystem::path(TURNCAL_SOURCE_DIR) / "../shared/data/recordings/clean";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recordings beside the project (../shared)";
  const CompressedRecording recording = compress_folder(folder.string());
  KeyValueFile truth = must(KeyValueFile::read((folder / "truth.conf").string()));
  const JointResult r = joint_estimate(recording);
  ASSERT_TRUE(r.converged) << r.message;
  const ParameterVector values = to_vector(r.parameters);
  for (const Bound& bound : bounds) {
    const auto k = std::ranges::find(parameter_keys, bound.key) - parameter_keys.begin();
    EXPECT_LE(r.sigma[k], bound.sigma) << bound.key;
    EXPECT_GT(r.sigma[k], 0.7 * bound.sigma) << bound.key << ": too good to be true";
    EXPECT_LT(std::abs(values[k] - truth.number(bound.key)), 3.5 * r.sigma[k]) << bound.key;
  }
  EXPECT_TRUE(r.faults.empty());
  EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
}

// ---- joint jacobian ----

// The sensitivities that run_filter() carries for the parameters and for every effect of the catalogue, against differences of
// its own chi-square: d chi2 / dp = 2 sum N' S^-1 nu, d2 chi2 / dp2 = 2 sum N' S^-1 N (Gauss-Newton: the data are noise-free
// and the parameters near the truth, so what is dropped is small). The second difference also holds what a parameter does to
// the gains and to the first levelling, which the columns leave out: 0.5 % of the information, 1.4 % for a warm-up of 60 s.

struct Bench {
  RigRecording made;
  std::vector<EffectColumn> columns;
  EffectModel effects;
  FilterSetup setup;
};

// Twelve-state noise, a few effects in force, parameters off by some sigma: everything the columns can depend on.
Bench bench(double instability) {
  RigConfig config = noise_free(default_rig_config());
  config.seed = 5;
  config.temperature.rise_c = 6.0;
  Bench b{record_on_rig(must_read_sequence("short_demo.seq"), config), {}, {}, {}};
  b.columns = catalogue_columns(b.made.recording.info);
  b.effects = make_effect_model(b.columns, {b.made.recording.info.latitude_deg}, b.made.recording.mean_temperature_c);
  b.setup.noise.accel_pulse_mps = config.accel_pulse_mps;
  b.setup.noise.gyro_bias_instability_radps = instability * 5e-9;
  b.setup.noise.accel_bias_instability_mps2 = instability * 1e-5;
  return b;
}

double chi_square(const Bench& b, const ParameterVector& parameters, const EffectModel& effects) {
  FilterSetup setup = b.setup;
  setup.with_columns = false;
  return run_filter(b.made.recording, from_vector(parameters), effects, setup).chi_square;
}

void compare(const Bench& b) {
  // A place a tenth of a sigma from the minimum in every column: what hardly shows here (an error of the earth rate) is linear no further.
  ParameterVector parameters = to_vector(b.made.truth);
  const FilterResult at_truth = run_filter(b.made.recording, b.made.truth, b.effects, b.setup);
  EffectModel effects = b.effects;
  const Eigen::Index n = parameter_count + effects.columns;
  ASSERT_EQ(at_truth.information.rows(), n);
  const Eigen::VectorXd sigma = at_truth.information.diagonal().cwiseSqrt().cwiseInverse();
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(sigma[k] < 1e100)) continue;
    const double off = (k % 2 == 0 ? 0.1 : -0.06) * sigma[k];
    (k < parameter_count ? parameters[k] : effects.values[k - parameter_count]) += off;
  }
  const FilterResult here = run_filter(b.made.recording, from_vector(parameters), effects, b.setup);
  const double centre = chi_square(b, parameters, effects);
  int looked_at = 0;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(sigma[k] < 1e100)) continue;  // a column that nothing excites here
    const double h = sigma[k];
    const auto at = [&](double step) {
      ParameterVector p = parameters;
      EffectModel e = effects;
      (k < parameter_count ? p[k] : e.values[k - parameter_count]) += step;
      return chi_square(b, p, e);
    };
    const double plus = at(h);
    const double minus = at(-h);
    const std::string name = k < parameter_count ? std::string(parameter_keys[k])
                                                 : b.columns[k - parameter_count].key() + " " +
                                                       std::to_string(b.columns[k - parameter_count].tau_s);
    // In units in which the information of each column is 1.
    EXPECT_NEAR((plus - minus) / (4.0 * h) * sigma[k], here.gradient[k] * sigma[k], 2e-3 * std::sqrt(here.chi_square))
        << name;
    EXPECT_NEAR((plus - 2.0 * centre + minus) / (2.0 * h * h) * sigma[k] * sigma[k],
                here.information(k, k) * sigma[k] * sigma[k], 0.02)
        << name;
    ++looked_at;
  }
  EXPECT_GT(looked_at, 24 + 60);
}

TEST(JointJacobian, SixStates) { compare(bench(0.0)); }
TEST(JointJacobian, TwelveStates) { compare(bench(1.0)); }

// ---- the filter on random linear systems, against generalised least squares with the whole covariance of all observations

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

}  // namespace
}  // namespace turncal
