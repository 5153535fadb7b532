#include "calib/fleet/fleet_diagnosis.h"

#include "calib/fleet/fleet_prior.h"
#include "calib/fleet/fleet_scores.h"
#include "calib/fleet/unit_statistics.h"
#include "calib/statistics/numerics.h"
#include "imu_io/recordings/statistics_file.h"
#include "tests/fleet/drawn_fleet.h"
#include "tests/imu_io/recording_samples.h"
#include "tests/test.h"

namespace turncal {
namespace {

constexpr std::size_t units = 200, stations = 4;
constexpr std::uint64_t seeds = 8;

FleetDiagnosis diagnose(std::uint64_t seed, const std::function<DrawnEffects(const DrawnUnit&)>& add) {
  return diagnose_fleet(drawn_fleet(seed, units, stations, add), {});
}

std::string drawn_column(std::mt19937_64& random) {
  const UnitStatistics& one = statistics_of_one();
  for (;;) {
    const auto k = std::uniform_int_distribution<Eigen::Index>(0, one.Q.rows() - 1)(random);
    if (one.Q(k, k) > 0.0F) return one.columns[std::size_t(k)];
  }
}

TEST(FleetDiagnosis, FindsNothingInACleanFleet) {
  int found = 0, outstanding = 0, unexplained = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const FleetDiagnosis d = diagnose(seed, [](const DrawnUnit&) { return DrawnEffects{}; });
    found += !d.effects.empty();
    unexplained += !d.explained();
    outstanding += int(d.units.size());
  }
  EXPECT_EQ(found, 0);
  EXPECT_LE(outstanding, 1);
  EXPECT_LE(unexplained, 1);
}

// A fifth of what one unit can show: one sigma.
TEST(FleetDiagnosis, FindsAStationEffectOfAFifthOfWhatOneUnitShows) {
  const std::string keys[] = {"accel_second_order.x", "gyro_g_sensitivity.yx", "accel_size_effect.x_rx",
                              "gyro_magnetic.zy"};
  int right = 0, blamed = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const std::string key = keys[seed % 4];
    const FleetDiagnosis d = diagnose(100 + seed, [&](const DrawnUnit& u) {
      return u.station == "S3" ? DrawnEffects{{key, sigma_of(key)}} : DrawnEffects{};
    });
    bool here = false;
    for (const FleetEffect& e : d.effects) {
      here = here || e.level == "S3";
      blamed += e.level != "S3";
    }
    right += here;
  }
  EXPECT_EQ(right, seeds);
  EXPECT_EQ(blamed, 0);
}

TEST(FleetDiagnosis, DoesNotBlameAStationForItsUnits) {
  int blamed = 0;
  std::size_t listed = 0, meant = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {  // a rate of blame of 26 % is seen in 95 of 100
    const FleetDiagnosis d = diagnose(200 + seed, [&](const DrawnUnit& u) {
      if (std::uniform_real_distribution<>()(u.random) > 0.1) return DrawnEffects{};
      const std::string key = drawn_column(u.random);
      ++meant;
      const double size = std::exp(std::uniform_real_distribution<>(std::log(5.0), std::log(50.0))(u.random));
      return DrawnEffects{{key, size * sigma_of(key)}};
    });
    blamed += !d.effects.empty();
    listed += d.units.size();
  }
  EXPECT_EQ(blamed, 0);
  EXPECT_GE(listed, meant * 9 / 10);
}

// What no single component shows: a hundredth of the catalogue's directions with half a sigma each, at one station.
TEST(FleetDiagnosis, SaysThatSomethingIsLeft) {
  int said = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const UnitStatistics& one = statistics_of_one();
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    DrawnEffects everywhere;
    for (const std::string& key : one.columns)
      if (sigma_of(key) < 1e30) everywhere.emplace_back(key, 0.08 * normal(random) * sigma_of(key));
    const FleetDiagnosis d =
        diagnose(400 + seed, [&](const DrawnUnit& u) { return u.station == "S1" ? everywhere : DrawnEffects{}; });
    said += !d.explained() || !d.effects.empty();
  }
  EXPECT_GE(said, 4);
}

TEST(FleetDiagnosis, DatesTheDriftOfAStation) {
  int dated = 0;
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const std::string key = "accel_second_order.x";
    const FleetDiagnosis d = diagnose(300 + seed, [&](const DrawnUnit& u) {
      return u.station == "S2" ? DrawnEffects{{key, sigma_of(key) * std::max(0.0, u.day - 80.0) / 10.0}}
                               : DrawnEffects{};
    });
    for (const FleetEffect& e : d.effects) {
      if (e.level != "S2" || e.shape != FleetShape::ramp) continue;
      dated += e.begin_low <= 80.0 && e.begin_high >= 80.0;
      sum += std::abs(e.begin_day - 80.0);
      break;
    }
  }
  EXPECT_GE(dated, 7);
  EXPECT_LE(sum / seeds, 7.0);
}

// Its last recordings stand out by themselves, and what is left of it without them is no ramp.
TEST(FleetDiagnosis, DatesASteepDrift) {
  int dated = 0, to_a_week = 0, blamed = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::mt19937_64 random(seed);
    const std::string key = drawn_column(random);
    const double begin = std::uniform_real_distribution<>(40.0, 120.0)(random);
    const double days_a_sigma = std::uniform_real_distribution<>(2.0, 6.0)(random);
    const FleetDiagnosis d = diagnose(500 + seed, [&](const DrawnUnit& u) {
      return u.station == "S2" ? DrawnEffects{{key, sigma_of(key) * std::max(0.0, u.day - begin) / days_a_sigma}}
                               : DrawnEffects{};
    });
    bool first = true;
    for (const FleetEffect& e : d.effects) {
      blamed += e.level != "S2";
      if (e.level != "S2" || e.shape == FleetShape::constant || !first) continue;
      first = false;
      dated += e.begin_low <= begin && e.begin_high >= begin;
      to_a_week += std::abs(e.begin_day - begin) <= 7.0;
    }
  }
  EXPECT_EQ(blamed, 0);
  EXPECT_GE(dated, 7);
  EXPECT_GE(to_a_week, 7);
}

// ---- component model ----

constexpr double unit_sigma = 2.0, station_sigma = 3.0, noise_sigma = 1.0;

// `each`: recordings of a unit.
ComponentData drawn(std::uint64_t seed, int units, int each, const std::vector<int>& station_of,
                    std::vector<int>& station) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> at_station(20);
  for (double& s : at_station) s = station_sigma * normal(random);
  ComponentData d{
      Eigen::VectorXd(units * each), Eigen::VectorXd::Constant(units * each, noise_sigma * noise_sigma), {}};
  station.clear();
  for (int u = 0; u < units; ++u) {
    const double own = unit_sigma * normal(random);
    for (int k = 0; k < each; ++k) {
      const int s = station_of[std::size_t(u) % station_of.size()];
      d.y[u * each + k] =
          own + (station_of.size() > 1 ? at_station[std::size_t(s)] : 0.0) + noise_sigma * normal(random);
      d.unit.push_back(u);
      station.push_back(s);
    }
  }
  return d;
}

// 200 units with two recordings each: relative error of a variance is about sqrt(2 / 200) = 0.1.
TEST(ComponentModel, FindsTheScatterOfUnits) {
  double sum = 0.0;
  constexpr int seeds = 20;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::vector<int> station;
    const ComponentData d = drawn(seed, 200, 2, {0}, station);
    sum += unit_variance(d, Eigen::MatrixXd::Ones(400, 1));
  }
  EXPECT_NEAR(sum / seeds, unit_sigma * unit_sigma, 0.1 * unit_sigma * unit_sigma);
}

// 100 units with two recordings each, that change by 5 in between where noise is 1: relative error of the variance sqrt(2 / 100) = 0.14.
TEST(ComponentModel, FindsWhatUnitsChangeBy) {
  double sum = 0.0, none = 0.0;
  constexpr int seeds = 20;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::vector<int> station;
    ComponentData d = drawn(seed, 100, 2, {0}, station);
    none += recording_variance(d);
    std::mt19937_64 random(seed + 100);
    std::normal_distribution<double> change(0.0, 5.0);
    for (double& y : d.y) y += change(random);
    sum += recording_variance(d);
  }
  EXPECT_NEAR(sum / seeds, 25.0, 0.1 * 25.0);
  EXPECT_LT(none / seeds, 0.15);
  std::vector<int> station;
  EXPECT_EQ(recording_variance(drawn(1, 100, 1, {0}, station)), 0.0);
}

// The mean of 100 units with two recordings each: variance (4 + 1 / 2) / 100, though there are 200 numbers.
TEST(ComponentModel, RecordingsOfOneUnitAreNotIndependent) {
  std::vector<int> station;
  const ComponentData d = drawn(7, 100, 2, {0}, station);
  const double information = UnitWeights(d, unit_sigma * unit_sigma).diagonal(Eigen::MatrixXd::Ones(200, 1))[0];
  EXPECT_NEAR(1.0 / information, (unit_sigma * unit_sigma + 0.5) / 100.0, 1e-9);
}

TEST(ComponentModel, ProductIsThatOfTheInverse) {
  std::vector<int> station;
  ComponentData d = drawn(3, 5, 3, {0}, station);
  for (Eigen::Index i = 0; i < d.v.size(); ++i) d.v[i] = 0.5 + 0.1 * double(i);
  d.v[4] = std::numeric_limits<double>::infinity();
  Eigen::MatrixXd V = d.v.asDiagonal();
  V(4, 4) = 1e12;
  for (Eigen::Index i = 0; i < V.rows(); ++i)
    for (Eigen::Index j = 0; j < V.cols(); ++j)
      if (d.unit[std::size_t(i)] == d.unit[std::size_t(j)]) V(i, j) += 4.0;
  const Eigen::MatrixXd X = Eigen::MatrixXd::Random(15, 3);
  const Eigen::MatrixXd expected = X.transpose() * inverse(V) * X;
  const UnitWeights weights(d, 4.0);
  EXPECT_LT((weights.product(X, X) - expected).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT((weights.diagonal(X) - expected.diagonal()).cwiseAbs().maxCoeff(), 1e-8);
}

// 20 stations say their scatter to a third; over 20 seeds to 7 %.
TEST(ComponentModel, TellsStationsFromUnits) {
  double of_unit = 0.0, of_station = 0.0;
  std::vector<int> stations, station;
  for (int s = 0; s < 20; ++s) stations.push_back(s);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const ComponentData d = drawn(seed, 200, 1, stations, station);
    const std::vector<double> v = variance_components(d, {station});
    of_unit += v[0] / 20.0, of_station += v[1] / 20.0;
    const ComponentData at_one = drawn(seed, 200, 1, {0}, station);
    EXPECT_EQ(variance_components(at_one, {station})[1], 0.0) << "one station says nothing of how stations scatter";
  }
  EXPECT_NEAR(of_unit, unit_sigma * unit_sigma, 0.1 * unit_sigma * unit_sigma);
  EXPECT_NEAR(of_station, station_sigma * station_sigma, 3.0 * 0.33 / std::sqrt(20.0) * station_sigma * station_sigma);
}

// ---- unit statistics ----

// An effect refitted from the sums is the one that the whole estimate finds, and moves the parameters as it does.
TEST(UnitStatistics, RefitsAsTheEstimateDoes) {
  RigConfig config;
  *find_effect(config.effects, "accel_second_order.x") = 12.0;
  const RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  const JointResult base = joint_estimate(made.recording);
  const UnitStatistics u = unit_statistics(made.recording, base);
  const int k = column_of(u, "accel_second_order.x");
  ASSERT_GE(k, 0);
  const double value = u.s[k] / u.Q(k, k);

  JointOptions options;
  for (const EffectColumn& c : catalogue_columns(made.recording.info))
    if (c.key() == "accel_second_order.x") options.effects = {c};
  options.noise = base.noise;
  const JointResult whole = joint_estimate(made.recording, options);
  const double sigma = whole.effects.front().sigma;
  EXPECT_NEAR(value, whole.effects.front().value, 0.1 * sigma);
  EXPECT_NEAR(1.0 / std::sqrt(u.Q(k, k)), sigma, 0.02 * sigma);
  EXPECT_GT(value, 5.0 * sigma);
  const ParameterVector refitted = u.value + u.moves.col(k).cast<double>() * value,
                        expected = to_vector(whole.parameters);
  for (int p = 0; p < parameter_count; ++p)
    if (whole.sigma[p] > 0.0) {
      EXPECT_NEAR(refitted[p], expected[p], 0.1 * whole.sigma[p]) << parameter_keys[std::size_t(p)];
    }
}

// Whatever the biases did between two recordings, of two walks, so that what one bias imitates in one it does not in the other.
TEST(UnitStatistics, OfSeveralRecordingsIsOfWhatTheyHaveInCommon) {
  RigConfig config;
  *find_effect(config.effects, "accel_second_order.x") = 12.0;
  const RigRecording first = record_on_rig(must_read_sequence("short_demo.seq"), config);
  config.noise_seed = 2;
  config.truth[1] = 0.3;    // N02, deg/h
  config.truth[3] = 0.002;  // A01, g
  const RigRecording second = record_on_rig(must_read_sequence("forty_minutes.seq"), config);
  const UnitStatistics one = unit_statistics(first.recording, joint_estimate(first.recording));
  const std::optional<UnitStatistics> both = unit_statistics({&first.recording, &second.recording});
  ASSERT_TRUE(both.has_value());
  const int k = column_of(one, "accel_second_order.x");
  ASSERT_EQ(column_of(*both, "accel_second_order.x"), k);
  EXPECT_GT(both->Q(k, k), 2.0 * one.Q(k, k));
  EXPECT_NEAR(both->s[k] / both->Q(k, k), 12.0, 4.0 / std::sqrt(both->Q(k, k)));
}

StatisticsFile example() {
  StatisticsFile s;
  s.file = test::make_parameter_file();
  s.file.unit_serial = "SN 1";
  s.file.add_further("record.station", "line 3");
  s.file.add_further("quality.covariance.N01", "1");
  s.statistics = statistics_of_one();
  return s;
}

TEST(StatisticsFile, ReadsWhatWasWritten) {
  const StatisticsFile s = example();
  const auto bytes = must(format_statistics(s));
  EXPECT_LE(bytes.size(), 110000U);
  const StatisticsFile read = must(parse_statistics(bytes, "f"));
  EXPECT_EQ(read.file.unit_serial, "SN 1");
  EXPECT_EQ(*find_further(read.file, "record.station"), "line 3");
  EXPECT_EQ(read.statistics.columns, s.statistics.columns);
  EXPECT_EQ(read.statistics.s, s.statistics.s);
  const Eigen::VectorXf scale = s.statistics.Q.diagonal().cwiseSqrt().cwiseInverse();
  EXPECT_LT((scale.asDiagonal() * (read.statistics.Q - s.statistics.Q) * scale.asDiagonal()).cwiseAbs().maxCoeff(),
            3e-7F);
  EXPECT_LT(((read.statistics.moves - s.statistics.moves).array() / s.statistics.moves.array().abs().max(1e-30F))
                .abs()
                .maxCoeff(),
            1.6e-5F);
}

TEST(StatisticsFile, RefusesWhatIsDamaged) {
  const auto bytes = must(format_statistics(example()));
  for (std::size_t at = 0; at < bytes.size(); at += 997) {
    auto damaged = bytes;
    damaged[at] ^= std::byte{0x10};
    EXPECT_FALSE(parse_statistics(damaged, "f").ok()) << at;
  }
  for (std::size_t length = 0; length < bytes.size(); length += 1009)
    EXPECT_FALSE(parse_statistics(std::span(bytes).first(length), "f").ok()) << length;
}

// ---- fleet prior ----

// Units about a mean, in units of 1 for every parameter: they scatter by `scatter`, change by `change`, and are known to 0.5.
struct Fleet {
  double scatter = 3.0, change = 0.5, sigma = 0.5;
  std::mt19937_64 random;
  std::normal_distribution<double> normal;

  explicit Fleet(std::uint64_t seed) : random(seed) {}
  ParameterVector drawn(double size) {
    ParameterVector v = ParameterVector::Zero();
    for (int k = 0; k < parameter_count; ++k)
      if (parameter_is_free[std::size_t(k)]) v[k] = size * normal(random);
    return v;
  }
  EarlierCalibration calibrated(int unit, int time, const ParameterVector& truth) {
    return {"U" + std::to_string(1000 + unit),
            std::to_string(time),
            truth + drawn(sigma),
            sigma * sigma * Eigen::MatrixXd::Identity(parameter_count, parameter_count),
            {}};
  }
  // Each unit calibrated twice; `truth` is that of unit 0 afterwards.
  std::vector<EarlierCalibration> history(int units, ParameterVector& truth, int times = 2) {
    std::vector<EarlierCalibration> all;
    for (int u = units; u >= 0; --u) {
      truth = drawn(scatter);
      for (int t = 0; t < times; ++t) {
        all.push_back(calibrated(u, t, truth));
        truth += drawn(change);
      }
    }
    return all;
  }
  JointResult estimate(const ParameterVector& truth, double estimate_sigma) {
    JointResult e;
    e.converged = true;
    for (int k = 0; k < parameter_count; ++k) {
      if (!parameter_is_free[std::size_t(k)]) continue;
      e.free.push_back(k);
      e.determined[std::size_t(k)] = true;
    }
    e.parameters = from_vector(truth + drawn(estimate_sigma));
    e.covariance = estimate_sigma * estimate_sigma * Eigen::MatrixXd::Identity(21, 21);
    e.last.gradient = Eigen::VectorXd::Zero(parameter_count);
    return e;
  }
};

// 21 values each, 60 fleets: the mean of chi-square / 21 is 1 +- 0.04 if the sigmas are true. The fleet's spread is taken a little too wide.
TEST(FleetPrior, CombinedEstimateKeepsToItsSigmasAndIsBetter) {
  double nees = 0.0, data = 0.0, both = 0.0;
  constexpr int fleets = 60;
  for (int seed = 1; seed <= fleets; ++seed) {
    Fleet fleet(static_cast<std::uint64_t>(seed));
    ParameterVector truth;
    const std::optional<FleetPrior> prior = fleet_prior(fleet.history(80, truth), "U1000");
    ASSERT_TRUE(prior);
    EXPECT_EQ(prior->units, 80U);
    EXPECT_EQ(prior->own, 2U);
    JointResult e = fleet.estimate(truth, 2.0);
    data += (to_vector(e.parameters) - truth).squaredNorm() / fleets;
    const PriorEffect effect = use_prior(*prior, e);
    if (!effect.changed.empty()) continue;
    const ParameterVector error = to_vector(e.parameters) - truth;
    both += error.squaredNorm() / fleets;
    for (const int k : e.free) nees += error[k] * error[k] / (e.sigma[k] * e.sigma[k]) / 21.0 / fleets;
    EXPECT_GT(effect.share[0], 0.7);  // 1 / (0.5^2 / 2 + 0.5^2) against 1 / 2^2, about 0.91
    EXPECT_LT(effect.share[0], 0.97);
  }
  EXPECT_NEAR(nees, 1.0, 0.15);
  EXPECT_LT(both, 0.2 * data);
}

TEST(FleetPrior, NamesWhatHasChangedAndIsThenNotUsed) {
  int alarms = 0, found = 0;
  for (int seed = 1; seed <= 100; ++seed) {
    Fleet fleet(std::uint64_t(1000 + seed));
    ParameterVector truth;
    const std::optional<FleetPrior> prior = fleet_prior(fleet.history(80, truth), "U1000");
    JointResult same = fleet.estimate(truth, 0.5);
    alarms += !use_prior(*prior, same).changed.empty();
    truth[8] += 10.0;
    JointResult e = fleet.estimate(truth, 0.5);
    const ParameterVector before = to_vector(e.parameters);
    found += use_prior(*prior, e).changed == std::vector<int>{8};
    EXPECT_EQ(to_vector(e.parameters), before);
  }
  EXPECT_LE(alarms, 5);  // 1 % of 100
  EXPECT_GE(found, 95);
}

TEST(FleetPrior, NeedsUnitsAndPairs) {
  Fleet fleet(7);
  ParameterVector truth;
  EXPECT_FALSE(fleet_prior(fleet.history(9, truth), "U1000"));
  EXPECT_TRUE(fleet_prior(fleet.history(10, truth), "U1000"));
  const std::optional<FleetPrior> once = fleet_prior(fleet.history(80, truth, 1), "U1000");
  ASSERT_TRUE(once);
  EXPECT_EQ(once->own, 0U);
  EXPECT_NEAR(once->covariance(0, 0), 9.25, 4.0);
}

}  // namespace
}  // namespace turncal
