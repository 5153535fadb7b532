// Effects drawn at random, that nobody declared: what does the diagnosis say of them, beside what could be said? (docs/diagnosis.md)
//
//   study_undeclared drawn|catalogue|clean SEED_FIRST SEED_COUNT [--draws N] [--least-z Z] [--most-z Z] [--only WORD] [--grade NAME]
//                    [--sequence NAME]
// A seed is a unit of a grade (navigation, tactical, mems) on a table at a place, with sample rate, noise, (three in ten) bias instability
// and random walk, and temperature history of its own. On its recording and its holdout N effects are laid, one after another:
//   drawn        bias, scale factor or direction (it reads a part of another axis) of one sensor, times a shape or the product of two; what of it
//                a bias and the sensor's row of the matrix take up is taken off, so that the truth of the parameters stands (taken_up.h)
//   catalogue    one of the rig's effects, at twice what the clean recording detects (5 sigma)
//   clean        nothing
// Ideal z, of both recordings, is drawn log-uniform. What is more than a unit of that grade has, or to nine tenths other values of the parameters, is drawn again.
// --only: column 4 holds the word.
//
// The ideal is the fit that knows the noise, and of the effect all but its size: one pass over the clean recording with the effect's true column
// beside the 21 parameters. z is the size over its sigma, then. One line a run, columns:
//    1 kind: drawn, catalogue, clean   2 seed   3 number   4 sensor:quantity:shapes, or component   5 grade   6 instability (0, 1)   7 ideal z
//    8 ideal z of the fitted recording alone   9 P(something is missing)   10 verdict   11 trusted (0, 1)   12 what is said
//   13 seconds of the diagnosis
// and, of the 21 parameters, with commas between them:
//   14 error over sigma; nan: not determined   15 sigma over ideal sigma   16 the ideal fit's error over ideal sigma   17 the effect touches it (0, 1):
//      its ideal sigma grows by more than 5 %, or a plain fit is off by more than 0.3 of it
// Column 12: nodes of 0.8 and more, sensor:quantity:driver:formula=P,right,branch right,deepest that is said with 0.95,correlation; empty where a
// node is not that deep. A branch is right when it was drawn, with either driver of a product, or when this recording hardly tells it
// from what was drawn: 0.97 of correlation, the 21 eliminated, between the true column and curves of the driver (curves_of). A formula is
// right when its branch is, and all formulas together correlate by 0.97 or leave less than 4 of ideal z; by 0.97 of them what is above them
// is right, too. Of the catalogue the names that were given, and what stands beside them, are listed as of the sensor "class".
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <string>
#include <tuple>

#include <fmt/format.h>
#include <Eigen/Core>

#include "calib/evidence/diagnosis.h"
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

using Eigen::Vector3d;
using Random = std::mt19937_64;
using Strings = std::vector<std::string>;
using Moment = DisturbedMoment;
using Number = std::function<double(const Moment&)>;

double uniform(Random& r, double low, double high) { return std::uniform_real_distribution<double>(low, high)(r); }
double log_uniform(Random& r, double low, double high) { return std::exp(uniform(r, std::log(low), std::log(high))); }
int one_of(Random& r, int n) { return std::uniform_int_distribution<int>(0, n - 1)(r); }
double normal(Random& r) { return std::normal_distribution<double>()(r); }

constexpr double usual_run_s = 6342.0, longest_run_s = 20000.0, usual_rate_radps = 0.1745, usual_c = 27.0;

// Shapes, of order one ----------------------------------------------------------------------------------------------------------------

// On [-1, 1], or periodic in 2 pi.
std::function<double(double)> smooth(Random& r, bool periodic) {
  std::vector<Vector3d> waves;  // size, frequency, phase
  for (int k = 0, n = 1 + one_of(r, 4); k < n; ++k)
    waves.emplace_back(normal(r) / std::sqrt(n), periodic ? 1.0 + one_of(r, 5) : uniform(r, 0.3, 8.0),
                       uniform(r, 0.0, 2.0 * pi));
  return [waves](double x) {
    double sum = 0.0;
    for (const Vector3d& w : waves) sum += w[0] * std::cos(w[1] * x + w[2]);
    return sum;
  };
}

std::vector<double> normals(Random& r, int count, bool summed) {
  std::vector<double> all;
  for (int k = 0; k < count; ++k) all.push_back(normal(r) + (summed && k > 0 ? all.back() : 0.0));
  return all;
}

struct Shape {
  Strings drivers;
  std::string name;
  Number at;
};

Shape of_time(Random& r) {
  const auto f = smooth(r, false);
  const double tau = log_uniform(r, 30.0, 4000.0), omega = 2.0 * pi / log_uniform(r, 30.0, 2.0 * usual_run_s),
               phase = uniform(r, 0.0, 2.0 * pi);
  const auto walk = normals(r, int(longest_run_s / 10.0), true);
  const int kind = one_of(r, 6);
  if (kind == 0) return {{"time"}, "smooth", [=](const Moment& m) { return f(2.0 * m.time_s / usual_run_s - 1.0); }};
  if (kind == 1) return {{"time"}, "sine", [=](const Moment& m) { return std::sin(omega * m.time_s + phase); }};
  if (kind == 2) return {{"time"}, "exponential", [=](const Moment& m) { return std::exp(-m.time_s / tau); }};
  if (kind == 3) return {{"time"}, "walk", [=](const Moment& m) { return walk[std::size_t(m.time_s / 10.0)]; }};
  const bool telegraph = kind == 4;
  const double every_s = telegraph ? log_uniform(r, 100.0, 1500.0) : 3000.0;
  std::vector<std::pair<double, double>> steps;
  for (double t = uniform(r, 200.0, 4000.0); t < longest_run_s; t -= every_s * std::log(uniform(r, 1e-9, 1.0)))
    steps.emplace_back(t, telegraph ? (steps.size() % 2 == 0 ? 1.0 : -1.0) : normal(r));
  return {{"time"}, telegraph ? "telegraph" : "steps", [=](const Moment& m) {
            double sum = 0.0;
            for (const auto& [time, size] : steps) sum += m.time_s > time ? size : 0.0;
            return sum;
          }};
}

Shape of_turns(Random& r) {
  const int kind = one_of(r, 3);
  const double tau = log_uniform(r, 3.0, 600.0);
  if (kind == 2) return {{"turns"}, "decay", [=](const Moment& m) { return std::exp(-m.since_turn_s / tau); }};
  const auto values = normals(r, 1000, kind == 1);
  const Number at = [=](const Moment& m) { return values[std::size_t(m.turn)]; };
  return kind == 0 ? Shape{{"turns"}, "scatter", at} : Shape{{"turns", "time"}, "turn_walk", at};
}

Shape draw_shape(Random& r) {
  const int axis = one_of(r, 3);
  const std::string of = std::string("_") + "xyz"[axis];
  const auto f = smooth(r, false), round = smooth(r, true);
  const int kind = one_of(r, 8);
  if (kind == 0)
    return {{"temperature"}, "temperature", [=](const Moment& m) { return f((m.temperature_c - usual_c) / 3.0); }};
  if (kind == 1) return {{"angle"}, "angle" + of, [=](const Moment& m) { return round(m.table_rad[axis]); }};
  if (kind == 2) return {{"force"}, "force" + of, [=](const Moment& m) { return f(m.force_g[axis]); }};
  if (kind == 3)
    return {{"rate"}, "rate" + of, [=](const Moment& m) { return f(m.rate_radps[axis] / usual_rate_radps) - f(0.0); }};
  return kind < 6 ? of_turns(r) : of_time(r);
}

// Effects -----------------------------------------------------------------------------------------------------------------------------

const Strings sensors = {"gyro x", "gyro y", "gyro z", "accelerometer x", "accelerometer y", "accelerometer z"};
const Strings quantities = {"bias", "scale factor", "direction"};

// What a sensor reads more by `number`: of the rate or force along axis `from`, or, negative, by itself.
Disturbance on(std::size_t sensor, int from, const Number& number) {
  return [=](const Moment& m) {
    AddedReading added;
    const auto axis = Eigen::Index(sensor % 3);
    if (sensor < 3) added.gyro_radps[axis] = number(m) * (from < 0 ? 1.0 : m.rate_radps[from]);
    if (sensor >= 3) added.accel_mps2[axis] = number(m) * standard_gravity_mps2 * (from < 0 ? 1.0 : m.force_g[from]);
    return added;
  };
}
// Of the block in whose middle it is; times are from the first sample.
std::size_t block_at(const CompressedRecording& recording, double time_s) {
  const auto next = std::upper_bound(recording.blocks.begin(), recording.blocks.end(), time_s + 1e-6,
                                     [&](double t, const Block& b) { return t < recording.middle_s(b); });
  return std::size_t(next - recording.blocks.begin()) - 1;
}
Disturbance times(double size, const Disturbance& one) {
  return [=](const Moment& m) {
    const AddedReading added = one(m);
    return AddedReading{size * added.gyro_radps, size * added.accel_mps2};
  };
}

struct Effect {
  std::string what = "none", sensor, quantity, key;  // key: of the catalogue
  Strings drivers;
  Number part;         // of a scale factor or direction: of its input; empty: of a bias, or of the catalogue
  Disturbance whole;   // one unit of it
  Disturbance column;  // without what the parameters take up
  double z = 0.0;      // ideal, of both recordings
};

Effect draw_any(Random& r) {
  Shape shape = draw_shape(r);
  if (one_of(r, 4) == 0) {
    const Shape other = draw_shape(r);
    shape.drivers.insert(shape.drivers.end(), other.drivers.begin(), other.drivers.end());
    shape.name += "*" + other.name;
    shape.at = [a = shape.at, b = other.at](const Moment& m) { return a(m) * b(m); };
  }
  const auto sensor = std::size_t(one_of(r, 6)), quantity = std::size_t(one_of(r, 3));
  const int axis = int(sensor % 3), other = (axis + 1 + one_of(r, 2)) % 3;
  Effect e;
  e.sensor = sensors[sensor];
  e.quantity = quantities[quantity];
  e.drivers = shape.drivers;
  e.what = e.sensor + ":" + e.quantity + ":" + shape.name;
  e.whole = on(sensor, quantity == 0 ? -1 : quantity == 1 ? axis : other, shape.at);
  if (quantity > 0) e.part = shape.at;
  return e;
}

std::string sensor_of(const EffectColumn& column) {
  const std::string name(column.entry->name);
  const char axis = column.entry->components[std::size_t(column.component)].front();
  if (name == "earth_rate" || name == "sample_period") return "earth rate";
  return (name.starts_with("gyro") ? "gyro" : "accelerometer") +
         (axis >= 'x' && axis <= 'z' ? std::string(" ") + axis : "");
}

// Quantity and driver of an entry of the catalogue.
std::pair<std::string, std::string> branch_of(const EffectEntry& entry) {
  return {std::string(to_string(entry.quantity)), std::string(to_string(entry.driver))};
}

Effect draw_of_catalogue(Random& r, const RigEffects& rig, const CompressedRecording& recording,
                         const JointResult& fit) {
  const Strings keys = rig_effect_keys();
  Effect e;
  e.what = e.key = keys[std::size_t(one_of(r, int(keys.size())))];
  for (EffectColumn c : catalogue_columns(recording.info)) {
    if (c.key() != e.key) continue;
    if (c.tau_s > 0.0)
      c.tau_s = e.key.starts_with("gyro_warm_up") ? rig.gyro_warm_up_tau_s : rig.post_rotation_relaxation_tau_s;
    e.sensor = sensor_of(c);
    e.drivers.resize(1);
    std::tie(e.quantity, e.drivers[0]) = branch_of(*c.entry);
    e.whole = [readings = readings_of(c, fit, recording), &recording](const Moment& m) {
      return readings[block_at(recording, m.time_s)];
    };
    break;
  }
  return e;
}

// Units -------------------------------------------------------------------------------------------------------------------------------

struct Grade {
  const char* name;
  double least_arw, most_arw, least_vrw, most_vrw;          // deg/sqrt(h), ug/sqrt(Hz)
  double bias_degph, accel_pulse_mps, most_degph, most_ug;  // most: that an effect reads; in ppm as in ug
};
constexpr std::array<Grade, 3> grades = {{{"navigation", 0.001, 0.01, 4.0, 16.0, 0.08, 0.0005, 40.0, 1e3},
                                          {"tactical", 0.02, 0.1, 20.0, 80.0, 1.0, 0.001, 400.0, 5e3},
                                          {"mems", 0.15, 0.6, 80.0, 300.0, 30.0, 0.004, 4000.0, 5e4}}};

struct Unit {
  Grade grade;
  RigConfig config;
  bool unsteady = false;  // bias instability and random walk
  Number temperature_c;   // empty: the rig's
};

// North, up, east in gauss, as it is about there: a dipole's to 15 %, and 15 deg of declination.
std::array<double, 3> draw_field(double latitude_deg, std::uint64_t seed) {
  Random r(seed + 7u);
  const double declination = uniform(r, -15.0, 15.0) * pi / 180.0, latitude = latitude_deg * pi / 180.0;
  const double horizontal = 0.31 * uniform(r, 0.85, 1.15) * std::cos(latitude);
  return {horizontal * std::cos(declination), -0.62 * uniform(r, 0.85, 1.15) * std::sin(latitude),
          horizontal * std::sin(declination)};
}

Unit draw_unit(Random& r, std::uint64_t seed, const std::string& grade, bool rig_temperature) {
  const auto named = std::ranges::find_if(grades, [&](const Grade& g) { return g.name == grade; });
  const auto drawn = std::size_t(std::max(0, one_of(r, 4) - 1));
  Unit u{named != grades.end() ? *named : grades[drawn], default_rig_config(), one_of(r, 10) < 3, {}};
  RigConfig& c = u.config;
  c.seed = 20000 + seed;
  c.noise_seed = 300000 + seed;
  c.table_errors.random_arcmin = uniform(r, 0.5, 10.0);
  c.site.latitude_deg = uniform(r, -65.0, 65.0);
  c.site.magnetic_field_gauss = draw_field(c.site.latitude_deg, seed);
  c.sample_period_s = std::array<double, 4>{0.005, 0.005, 0.01, 0.0025}[std::size_t(one_of(r, 4))];
  c.accel_pulse_mps = u.grade.accel_pulse_mps;
  for (std::size_t k = 0; k < 3; ++k) c.truth[k] = u.grade.bias_degph * normal(r);
  RigNoise& noise = c.noise;
  noise.gyro_random_walk_deg_per_rt_h = log_uniform(r, u.grade.least_arw, u.grade.most_arw);
  noise.accel_random_walk_ug_per_rt_hz = log_uniform(r, u.grade.least_vrw, u.grade.most_vrw);
  const double gyro = noise.gyro_random_walk_deg_per_rt_h / 0.002, accel = noise.accel_random_walk_ug_per_rt_hz / 8.0;
  noise.gyro_bias_instability_degph = u.unsteady ? gyro * uniform(r, 0.0005, 0.003) : 0.0;
  noise.accel_bias_instability_ug = u.unsteady ? accel * uniform(r, 0.3, 2.0) : 0.0;
  noise.gyro_rate_random_walk_degph_per_rt_h = u.unsteady ? gyro * uniform(r, 0.0, 0.002) : 0.0;
  noise.accel_acceleration_random_walk_ug_per_rt_h = u.unsteady ? accel * uniform(r, 0.0, 1.0) : 0.0;
  c.temperature.rise_c = uniform(r, -4.0, 10.0);
  c.temperature.tau_s = uniform(r, 900.0, 6000.0);
  const double size_c = uniform(r, 1.0, 8.0), phase = uniform(r, 0.0, 2.0 * pi),
               omega = 2.0 * pi / log_uniform(r, 1500.0, 20000.0);
  const int history = one_of(r, 4);
  if (rig_temperature || history < 2) return u;
  u.temperature_c = [=](const Moment& m) {
    const double wave = std::sin(omega * m.time_s + phase);
    return 24.0 + size_c * (history == 2 ? wave : 1.0 - std::exp(-m.time_s / 900.0) + 0.2 * wave);
  };
  return u;
}

void give_temperature(RigRecording& made, const Number& temperature_c) {
  if (!temperature_c) return;
  double sum = 0.0, time_s = 0.0;
  each_moment(made.recording, made.truth, [&](std::size_t k, const Moment& m) {
    Block& b = made.recording.blocks[k];
    b.temperature_c = float(1e-3 * std::round(1e3 * temperature_c(m)));
    sum += b.duration_s * double(b.temperature_c);
    time_s += b.duration_s;
  });
  made.recording.mean_temperature_c = sum / time_s;
}

// A unit that wanders: its biases over the whole recording, by the same unit with the same noise and no walk.
Parameters truth_over(const RigRecording& made, const Sequence& sequence, RigConfig config) {
  Parameters truth = made.truth;
  double& gyro = config.noise.gyro_rate_random_walk_degph_per_rt_h;
  double& accel = config.noise.accel_acceleration_random_walk_ug_per_rt_h;
  if (gyro == 0.0 && accel == 0.0) return truth;
  gyro = accel = 0.0;
  const RigRecording steady = record_on_rig(sequence, config);
  Vector3d turned = Vector3d::Zero(), pushed = Vector3d::Zero();
  double time_s = 0.0;
  for (const Block& b : made.recording.blocks) turned += b.gyro, pushed += b.accel, time_s += b.duration_s;
  for (const Block& b : steady.recording.blocks) turned -= b.gyro, pushed -= b.accel;
  const SensorModel model = sensor_model(made.truth, made.recording.info);
  truth.N0_degph += model.gyro_scale * turned / time_s / radps_per_degph;
  truth.A0_g += model.accel_scale * pushed / time_s / standard_gravity_mps2;
  return truth;
}

// The ideal ---------------------------------------------------------------------------------------------------------------------------

// Noise as it was drawn. A flicker is as a Markov process of 300 s whose sigma is its B; a walk, as one that is as large at its corner.
NoiseModel known_noise(const RigNoise& drawn, NoiseModel noise) {
  noise.angle_random_walk.setConstant(drawn.gyro_random_walk_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(drawn.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz);
  const double rt_h = std::sqrt(noise.bias_correlation_s / 3600.0);
  const double gyro = std::hypot(drawn.gyro_bias_instability_degph, rt_h * drawn.gyro_rate_random_walk_degph_per_rt_h);
  const double accel =
      std::hypot(drawn.accel_bias_instability_ug, rt_h * drawn.accel_acceleration_random_walk_ug_per_rt_h);
  noise.gyro_bias_instability_radps = gyro * radps_per_degph;
  noise.accel_bias_instability_mps2 = accel * mpsprs_per_ugprHz;
  return noise;
}

struct Clean {  // a recording before anything is laid on it
  const CompressedRecording& recording;
  JointResult fit;
  FilterSetup setup;  // with the known noise
  std::vector<Moment> moments;
};
Clean clean_of(const CompressedRecording& recording, JointResult fit, const Parameters& truth, const RigNoise& noise) {
  Clean c{recording, std::move(fit), {}, {}};
  c.setup = c.fit.setup;
  c.setup.noise = known_noise(noise, c.fit.noise);
  each_moment(recording, truth, [&](std::size_t, const Moment& m) { c.moments.push_back(m); });
  return c;
}

// Columns: the 24 parameters, of the catalogue, others.
FilterResult pass_with(const Clean& clean, const std::vector<EffectColumn>& catalogue,
                       const std::vector<Disturbance>& others) {
  auto model = make_effect_model(catalogue, {clean.recording.info.latitude_deg}, clean.recording.mean_temperature_c);
  model.columns += int(others.size());
  model.values = Eigen::VectorXd::Zero(model.columns);
  model.regressors = [&, of_catalogue = model.regressors](const BlockState& s, EffectRegressors& out) {
    of_catalogue(s, out);
    const Moment& moment = clean.moments[block_at(clean.recording, s.time_s)];
    Eigen::Index column = out.gyro.cols() - Eigen::Index(others.size());
    for (const Disturbance& other : others) {
      const AddedReading added = other(moment);
      out.gyro.col(column) = added.gyro_radps;
      out.accel.col(column++) = added.accel_mps2;
    }
  };
  FilterResult pass = run_filter(clean.recording, clean.fit.parameters, model, clean.setup);
  pass.gradient.head<parameter_count>() -= clean.fit.noise_pull;
  return pass;
}

struct Ideal {
  Eigen::VectorXd sigma, error;  // of the 21
  Eigen::VectorXd more;          // variance that the column adds, of sigma^2
  double z_of_one = 0.0;         // of one unit of the column; 0: to nine tenths it is other parameters
};
Ideal ideal_of(const Clean& clean, const Parameters& truth, const Disturbance& column) {
  const std::vector<int>& base = free_parameters();
  const FilterResult pass =
      pass_with(clean, {}, column ? std::vector<Disturbance>{column} : std::vector<Disturbance>{});
  const SubsetSolution plain = solve_subset(pass.information, pass.gradient, base, clean.fit.ranges);
  Ideal ideal{plain.covariance.diagonal(), (to_vector(clean.fit.parameters) - to_vector(truth))(base) + plain.step,
              Eigen::VectorXd::Zero(plain.step.size())};
  if (column) {
    const Scores scores = eliminate(pass.information, pass.gradient, base, {parameter_count});
    const Eigen::VectorXd shift = plain.covariance * pass.information(base, std::vector<int>{parameter_count});
    ideal.z_of_one = scores.kept[0] > 0.1 ? std::sqrt(scores.Q(0, 0)) : 0.0;
    ideal.more = shift.cwiseAbs2() / scores.Q(0, 0);
    ideal.error -= shift * (scores.s[0] / scores.Q(0, 0));
  }
  ideal.sigma = (ideal.sigma + ideal.more).cwiseSqrt();
  return ideal;
}

// z of one unit of the column in both recordings: what is not of a switch-on is common.
double z_of_both(const Clean& clean, const Clean& held, const Disturbance& column) {
  const std::vector<int>& base = free_parameters();
  const FilterResult one = pass_with(clean, {}, {column}), other = pass_with(held, {}, {column});
  const int p = parameter_count, own = p + 1;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(own + 6, own + 6);
  A.topLeftCorner(own, own) = one.information.topLeftCorner(own, own);
  std::vector<int> place, columns = base;
  for (int k = 0; k < own; ++k) place.push_back(k < 6 ? own + k : k);
  A(place, place) += other.information.topLeftCorner(own, own);
  for (int k = 0; k < 6; ++k) columns.push_back(own + k);
  const Scores scores = eliminate(A, Eigen::VectorXd::Zero(A.rows()), columns, {p});
  return std::sqrt(scores.Q(0, 0));
}

bool is_usual(const Clean& clean, const Grade& grade, double size, const Effect& effect) {
  return std::ranges::all_of(clean.moments, [&](const Moment& m) {
    const AddedReading a = times(size, effect.column)(m);
    return (!effect.part || std::abs(size * effect.part(m)) < 1e-6 * grade.most_ug) &&
           a.gyro_radps.cwiseAbs().maxCoeff() < grade.most_degph * radps_per_degph &&
           a.accel_mps2.cwiseAbs().maxCoeff() < grade.most_ug * mpsprs_per_ugprHz;
  });
}

// What is said, and is it right? ------------------------------------------------------------------------------------------------------

struct Node {
  std::string sensor, quantity, driver, formula;
  double probability = 0.0;
  bool right = false, right_branch = false, deepest = false;
  double correlation = 0.0;
};
struct Said {
  double anything = 0.0;
  std::vector<Node> nodes;
};

Said said_by(const Diagnosis& d) {
  Said said;
  said.anything = d.statements.anything;
  for (const Statement& s : d.statements.nodes)
    said.nodes.push_back({s.sensor, s.quantity, s.driver, s.formula, s.probability});
  std::erase_if(said.nodes, [](const Node& n) { return n.probability < 0.8; });
  const auto is_below = [](const Node& a, const Node& b) {  // a below b
    int deeper = 0;
    for (const auto field : {&Node::quantity, &Node::driver, &Node::formula}) {
      if ((b.*field).empty())
        deeper += !(a.*field).empty();
      else if (a.*field != b.*field)
        return false;
    }
    return a.sensor == b.sensor && deeper > 0;
  };
  for (Node& n : said.nodes)
    n.deepest = n.probability >= 0.95 && std::ranges::none_of(said.nodes, [&](const Node& other) {
                  return other.probability >= 0.95 && is_below(other, n);
                });
  return said;
}

// Sets of a few functions that a curve of the driver is made of: of each angle, of each component. `axis`: the sensor's own.
std::vector<std::vector<Number>> curves_of(const std::string& driver, int axis) {
  std::vector<Number> f;
  if (driver == "time") {
    for (int k = 1; k <= 5; ++k) f.push_back([k](const Moment& m) { return std::cos(k * pi * m.time_s / m.length_s); });
    f.push_back([](const Moment& m) { return std::exp(-m.time_s / 300.0); });
  }
  if (driver == "temperature")
    for (int k = 1; k <= 4; ++k)
      f.push_back([k](const Moment& m) { return std::pow((m.temperature_c - usual_c) / 5.0, k); });
  if (driver == "turns")
    for (const double tau : {5.0, 40.0, 300.0}) {
      f.push_back([=](const Moment& m) { return std::exp(-m.since_turn_s / tau); });
      f.push_back([=](const Moment& m) { return m.force_g[axis] * std::exp(-m.since_turn_s / tau); });
    }
  if (!f.empty()) return {f};
  std::vector<std::vector<Number>> all(3);
  for (int i = 0; i < 3; ++i) {
    if (driver == "angle")
      for (int k = 0; k < 6; ++k)
        all[std::size_t(i)].push_back(
            [=](const Moment& m) { return std::cos((1 + k / 2) * m.table_rad[i] - k % 2 * 0.5 * pi); });
    for (int k = 1; k <= 4 && (driver == "force" || driver == "rate"); ++k)
      all[std::size_t(i)].push_back([=, force = driver == "force"](const Moment& m) {
        const double x = force ? m.force_g[i] : m.rate_radps[i] / usual_rate_radps;
        return k == 4 ? std::abs(x) : std::pow(x, k);
      });
  }
  return all;
}

// Multiple correlation of the true column with all of these, the 21 eliminated.
double correlation(const Clean& clean, const Effect& truth, const std::vector<EffectColumn>& catalogue,
                   std::vector<Disturbance> others) {
  if (catalogue.empty() && others.empty()) return 0.0;
  others.push_back(truth.column);
  const FilterResult pass = pass_with(clean, catalogue, others);
  std::vector<int> columns, group;
  for (int k = parameter_count; k < pass.gradient.size(); ++k) columns.push_back(k);
  const Scores scores = eliminate(pass.information, pass.gradient, free_parameters(), columns);
  const int last = int(columns.size()) - 1;
  for (int k = 0; k < last; ++k)
    if (scores.kept[k] > 1e-7) group.push_back(k);
  return group.empty() ? 0.0 : multiple_correlation(scores, last, group);
}

// The largest with any curve of the node's driver on its sensor and quantity. What a node does not say may be anything.
double correlation(const Clean& clean, const Effect& truth, const Node& n) {
  double largest = 0.0;
  for (const char* driver : {"time", "temperature", "turns", "angle", "force", "rate"})
    for (std::size_t s = 0; s < sensors.size(); ++s)
      for (int from = -1; from < 3; ++from) {
        const int axis = int(s % 3);
        const std::string& quantity = quantities[from < 0 ? 0 : from == axis ? 1 : 2];
        if (!sensors[s].starts_with(n.sensor) || (!n.quantity.empty() && n.quantity != quantity) ||
            (!n.driver.empty() && n.driver != driver))
          continue;
        for (const std::vector<Number>& curve : curves_of(driver, axis)) {
          std::vector<Disturbance> columns;
          for (const Number& f : curve) columns.push_back(on(s, from, f));
          largest = std::max(largest, correlation(clean, truth, {}, columns));
        }
      }
  return largest;
}

void judge(std::vector<Node>& nodes, const Clean& clean, const Effect& truth) {
  if (!truth.column) return;
  constexpr double same = 0.97;
  std::vector<EffectColumn> named;
  for (Node& n : nodes) {
    const bool driven = std::ranges::count(truth.drivers, n.driver) > 0;
    // statement.h: what goes with the force is a bias of an accelerometer, what goes with the rate a scale factor of a gyro.
    const auto goes_with = [&](const char* driver) {
      return std::ranges::count(truth.drivers, driver) > 0 && (n.driver.empty() || n.driver == driver);
    };
    const char* input = n.sensor.starts_with("gyro") ? "rate" : "force";
    const bool of_input = std::ranges::count(truth.drivers, input) > 0;
    // A bias that goes with the input and something else is a scale factor or direction that goes with that.
    const bool same_thing =
        (n.quantity == (n.sensor.starts_with("gyro") ? "scale factor" : "bias") && goes_with(input)) ||
        (of_input && truth.drivers.size() > 1 && truth.quantity == "bias" && n.driver != input);
    const bool drawn = n.sensor == truth.sensor && (n.quantity.empty() || n.quantity == truth.quantity || same_thing) &&
                       (n.driver.empty() || driven);
    if (!drawn) n.correlation = correlation(clean, truth, n);
    n.right = n.right_branch = drawn || n.correlation >= same;
    for (const EffectColumn& c : catalogue_columns(clean.recording.info))
      if (c.entry->name == n.formula && sensor_of(c) == n.sensor) named.push_back(c);
  }
  const double of_names = correlation(clean, truth, named, {});
  for (Node& n : nodes) {
    if (n.formula.empty()) continue;
    n.correlation = of_names;
    n.right = n.right_branch && (truth.key.starts_with(n.formula + ".") || of_names >= same ||
                                 truth.z * std::sqrt(1.0 - of_names * of_names) < 4.0);
  }
  if (of_names < same) return;
  for (Node& n : nodes)
    for (const EffectColumn& c : named) {
      const auto [quantity, driver] = branch_of(*c.entry);
      if (n.sensor == sensor_of(c) && (n.quantity.empty() || n.quantity == quantity) &&
          (n.driver.empty() || n.driver == driver))
        n.right = n.right_branch = true;
    }
}

// Of the catalogue: every name that was given, and what stands beside it as what it could as well be.
std::vector<Node> class_of(const Diagnosis& d, const Effect& truth) {
  std::vector<Node> nodes;
  const auto add = [&](const std::string& name) {
    nodes.push_back({"class", "", "", name, 1.0});
    nodes.back().right = truth.key.starts_with(name + ".");
  };
  for (const std::string& name : d.effect_names) {
    add(name);
    for (const std::string& other : d.aliases.at(name)) add(other);
  }
  return nodes;
}

// A run -------------------------------------------------------------------------------------------------------------------------------

std::string text_of(const std::vector<Node>& nodes) {
  std::string text;
  for (const Node& n : nodes)
    text += fmt::format("{}{}:{}:{}:{}={:.4f},{:d},{:d},{:d},{:.3f}", text.empty() ? "" : ";", n.sensor, n.quantity,
                        n.driver, n.formula, n.probability, n.right, n.right_branch, n.deepest, n.correlation);
  return text.empty() ? "-" : text;
}
std::string text_of(const Eigen::VectorXd& values) {
  std::string text;
  for (const double v : values) text += fmt::format("{}{:.3f}", text.empty() ? "" : ",", v);
  return text;
}

void run(const std::string& kind, std::uint64_t seed, const std::map<std::string, std::string>& options,
         const Sequence& sequence, const Sequence& second) {
  Random r(seed * 1000003u + 17u);
  const bool catalogue = kind == "catalogue", nothing = kind == "clean";
  const Unit unit = draw_unit(r, seed, options.at("--grade"), catalogue);
  RigConfig again = unit.config;
  again.noise_seed = 600000 + seed;
  RigRecording made = record_on_rig(sequence, unit.config), held = record_on_rig(second, again);
  give_temperature(made, unit.temperature_c);
  give_temperature(held, unit.temperature_c);
  const Parameters over_run = truth_over(made, sequence, unit.config);
  const Clean clean = clean_of(made.recording, joint_estimate(made.recording), made.truth, unit.config.noise);
  const Clean other =
      clean_of(held.recording, estimate_beside(held.recording, clean.fit.parameters), held.truth, unit.config.noise);
  const int draws = nothing ? 1 : std::stoi(options.at("--draws"));
  for (int k = 0, tries = 0; k < draws && tries < 1000; ++tries) {
    Effect e;
    Ideal ideal;
    double size = 0.0;
    if (nothing) {
      ideal = ideal_of(clean, over_run, {});
    } else {
      e = catalogue ? draw_of_catalogue(r, unit.config.effects, made.recording, clean.fit) : draw_any(r);
      e.z = catalogue ? 10.0 : log_uniform(r, std::stod(options.at("--least-z")), std::stod(options.at("--most-z")));
      if (!e.whole || e.what.find(options.at("--only")) == std::string::npos) continue;
      e.column = without_parameters(e.whole, made.recording, made.truth);
      ideal = ideal_of(clean, over_run, e.column);
      const double z_of_one = catalogue ? ideal.z_of_one : z_of_both(clean, other, e.column);
      size = (r() % 2 == 0 ? 1.0 : -1.0) * e.z / z_of_one;
      if (ideal.z_of_one == 0.0 || !is_usual(clean, unit.grade, size, e)) continue;
    }
    CompressedRecording recording = made.recording, holdout = held.recording;
    Parameters truth = over_run;
    if (catalogue) {
      RigConfig with = unit.config;
      with.temperature.reference_c = made.recording.mean_temperature_c;
      *find_effect(with.effects, e.key) = size;
      recording = record_on_rig(sequence, with).recording;
      with.noise_seed = again.noise_seed;
      holdout = record_on_rig(second, with).recording;
      const auto whole = [&](std::size_t, const Moment& m) { return e.whole(m); };
      truth =
          from_vector(to_vector(truth) + size * as_parameters(taken_up(whole, made.recording, made.truth), made.truth));
    } else if (!nothing) {
      disturb(recording, made.truth, times(size, e.column));
      disturb(holdout, made.truth, times(size, e.column));
    }
    DiagnosisOptions diagnosis;
    diagnosis.holdouts = {&holdout};
    const auto began = std::chrono::steady_clock::now();
    const Diagnosis d = diagnose(recording, diagnosis);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    Said said = said_by(d);
    judge(said.nodes, clean, e);
    if (catalogue)
      for (Node& n : class_of(d, e)) said.nodes.push_back(std::move(n));
    const ErrorsOverRecording errors = errors_over_recording(d.extended, recording, truth);
    const std::vector<int>& free = free_parameters();
    const Eigen::VectorXd sigma = (errors.sigma.array() > 0.0).select(errors.sigma, std::nan(""))(free);
    const Eigen::ArrayXd variance = ideal.sigma.cwiseAbs2(), more = ideal.more;
    const Eigen::VectorXd touched =
        (more > 0.093 * variance || std::pow(size * ideal.z_of_one, 2) * more > 0.09 * variance).cast<double>();
    std::string line = fmt::format(
        "{}|{}|{}|{}|{}|{:d}|{:.2f}|{:.2f}|{:.4f}|{}|{:d}|{}|{:.2f}|{}|{}|{}|{}", kind, seed, k++, e.what,
        unit.grade.name, unit.unsteady, e.z, std::abs(size) * ideal.z_of_one, said.anything, to_string(d.verdict),
        d.trusted(), text_of(said.nodes), seconds, text_of(errors.error(free).cwiseQuotient(sigma)),
        text_of(sigma.cwiseQuotient(ideal.sigma)), text_of(ideal.error.cwiseQuotient(ideal.sigma)), text_of(touched));
    std::ranges::replace(line, ' ', '_');
    std::ranges::replace(line, '|', ' ');
    std::puts(line.c_str());
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  std::map<std::string, std::string> options = {{"--draws", "4"},    {"--least-z", "0.7"},
                                                {"--most-z", "100"}, {"--only", ""},
                                                {"--grade", ""},     {"--sequence", "fourteen_step.seq"}};
  const std::string kind = argc > 1 ? argv[1] : "";
  bool understood = argc >= 4 && argc % 2 == 0 && (kind == "drawn" || kind == "catalogue" || kind == "clean");
  for (int k = 4; understood && k < argc; k += 2) {
    understood = options.count(argv[k]) > 0;
    options[argv[k]] = argv[k + 1];
  }
  if (!understood) {
    std::fprintf(
        stderr,
        "usage: study_undeclared drawn|catalogue|clean SEED_FIRST SEED_COUNT [--draws N] [--least-z Z] [--most-z Z] "
        "[--only WORD] [--grade NAME] [--sequence NAME]\n");
    return 1;
  }
  const Sequence sequence = must_read_sequence(options["--sequence"]), second = must_read_sequence("holdout.seq");
  const std::uint64_t first = std::stoull(argv[2]), count = std::stoull(argv[3]);
  for (std::uint64_t seed = first; seed < first + count; ++seed) {
    run(kind, seed, options, sequence, second);
    fmt::print(stderr, "{}: seed {}, {} of {}\n", kind, seed, seed - first + 1, count);
  }
}
