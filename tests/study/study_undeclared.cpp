// Effects drawn at random, that nobody declared: what does the diagnosis say of them, beside what could be said? (docs/diagnosis-study.md)
//
//   study_undeclared SEED_FIRST SEED_COUNT [--clean | --catalogue] [--draws N] [--z LOW HIGH] [--only WORD] [--grade NAME] [--sequence NAME]
// A seed is a unit of a grade (navigation, tactical, mems) on a table at a place, with sample rate, noise, (three in ten) bias instability
// and random walk, and temperature history of its own. On its recording and its holdout N effects are laid, one after another:
//   drawn        bias, scale factor or direction (of another axis it reads a part) of one sensor, times a shape or the product of two; what of it
//                a bias and the sensor's row of the matrix take up is taken off, so that the truth of the parameters stands (taken_up.h)
//   --catalogue  one of the rig's effects, at twice what the clean recording detects (5 sigma)
//   --clean      nothing
// --z: ideal z is drawn log-uniform from there to there. --only: what is drawn holds the word in column 4.
//
// The ideal is a fit beside that knows the course of the effect and not its size, and the noise: one pass over the clean recording, with
// the effect's true column beside the 21 parameters. z: size over sigma, then.
// One line a run, columns:
//    1 kind: drawn, catalogue, clean   2 seed   3 number   4 sensor:quantity:shapes, or component   5 grade   6 instability: 0, 1   7 ideal z
//    8 P(something is missing)   9 verdict   10 trusted (0, 1)   11 what is said
//   12 largest error over sigma   13 of which parameter   14, 15 sigma over ideal sigma: median, largest   16, 17 error over ideal sigma: same
//   18 parameters that the effect does not touch   19 sum of squares of their errors over sigma   20 of all 21: of the ideal fit's
//   21 seconds of the diagnosis
// Column 11: nodes of 0.8 and more, sensor:quantity:driver:formula=P,right,branch right,deepest that is said with 0.95,correlation; "-" where a
// node is not that deep. A node is right when it is what was drawn, either driver of a product; or when the truth is hardly told from it by this
// recording: multiple correlation of the truth's column with functions of that driver (span_of), the 21 eliminated, of 0.97 and more.
// A formula is right when the node above is, and all formulas together leave less than 4 of ideal z, or correlate by 0.97.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include <Eigen/Core>

#if __has_include("calib/evidence/diagnosis.h")
#include "calib/evidence/diagnosis.h"
#else
#include "calib/diagnosis/diagnosis.h"
#endif
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

using Eigen::Vector3d;
using Random = std::mt19937_64;
using Strings = std::vector<std::string>;
using Number = std::function<double(const DisturbedMoment&)>;

double uniform(Random& r, double low, double high) { return std::uniform_real_distribution<double>(low, high)(r); }
double log_uniform(Random& r, double low, double high) { return std::exp(uniform(r, std::log(low), std::log(high))); }
int one_of(Random& r, int n) { return std::uniform_int_distribution<int>(0, n - 1)(r); }
double normal(Random& r) { return std::normal_distribution<double>()(r); }
bool contains(const Strings& all, const std::string& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

constexpr double usual_run_s = 6342.0, usual_rate_radps = 0.1745, longest_run_s = 20000.0;

// Shapes ------------------------------------------------------------------------------------------------------------------------------

// On [-1, 1], or periodic in 2 pi: of order one.
std::function<double(double)> smooth(Random& r, bool periodic) {
  struct Wave {
    double size, frequency, phase;
  };
  std::vector<Wave> waves;
  for (int k = 0, n = 1 + one_of(r, 4); k < n; ++k)
    waves.push_back({normal(r), periodic ? 1.0 + one_of(r, 5) : uniform(r, 0.3, 8.0), uniform(r, 0.0, 2.0 * pi)});
  return [waves](double x) {
    double sum = 0.0;
    for (const Wave& w : waves) sum += w.size * std::cos(w.frequency * x + w.phase);
    return sum / std::sqrt(static_cast<double>(waves.size()));
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
  switch (one_of(r, 6)) {
    case 0:
      return {{"time"}, "smooth", [f = smooth(r, false)](const DisturbedMoment& m) {
                return f(2.0 * m.time_s / usual_run_s - 1.0);
              }};
    case 1:
      return {{"time"},
              "sine",
              [period = log_uniform(r, 30.0, 2.0 * usual_run_s), phase = uniform(r, 0.0, 2.0 * pi)](
                  const DisturbedMoment& m) { return std::sin(2.0 * pi * m.time_s / period + phase); }};
    case 2:
      return {{"time"}, "exponential", [tau = log_uniform(r, 30.0, 4000.0)](const DisturbedMoment& m) {
                return std::exp(-m.time_s / tau);
              }};
    case 3:
      return {
          {"time"}, "walk", [w = normals(r, static_cast<int>(longest_run_s / 10.0), true)](const DisturbedMoment& m) {
            return w[static_cast<std::size_t>(m.time_s / 10.0)];
          }};
    default: {
      // Steps of any size, or a telegraph.
      const bool telegraph = one_of(r, 2) == 0;
      const double every_s = telegraph ? log_uniform(r, 100.0, 1500.0) : 3000.0;
      std::vector<std::pair<double, double>> steps;
      for (double t = 0.0; (t -= every_s * std::log(uniform(r, 1e-9, 1.0))) < longest_run_s;)
        steps.emplace_back(t, telegraph ? (steps.size() % 2 == 0 ? 1.0 : -1.0) : normal(r));
      return {{"time"}, telegraph ? "telegraph" : "steps", [steps](const DisturbedMoment& m) {
                double sum = 0.0;
                for (const auto& [time, size] : steps) sum += m.time_s > time ? size : 0.0;
                return sum;
              }};
    }
  }
}

Shape of_turns(Random& r) {
  const int kind = one_of(r, 3);
  if (kind == 2)
    return {{"turns"}, "decay", [tau = log_uniform(r, 3.0, 600.0)](const DisturbedMoment& m) {
              return std::exp(-m.since_turn_s / tau);
            }};
  // A walk from turn to turn is one in time, too.
  return {kind == 1 ? Strings{"turns", "time"} : Strings{"turns"}, kind == 1 ? "turn_walk" : "scatter",
          [w = normals(r, 1000, kind == 1)](const DisturbedMoment& m) { return w[static_cast<std::size_t>(m.turn)]; }};
}

Shape draw_shape(Random& r) {
  const int axis = one_of(r, 3);
  const std::string of = std::string("_") + "xyz"[axis];
  const auto f = smooth(r, false), round = smooth(r, true);
  switch (one_of(r, 8)) {
    case 0:
      return {
          {"temperature"}, "temperature", [f](const DisturbedMoment& m) { return f((m.temperature_c - 27.0) / 3.0); }};
    case 1:
      return {{"angle"}, "angle" + of, [round, axis](const DisturbedMoment& m) { return round(m.table_rad[axis]); }};
    case 2: return {{"force"}, "force" + of, [f, axis](const DisturbedMoment& m) { return f(m.force_g[axis]); }};
    case 3:
      return {{"rate"}, "rate" + of, [f, axis](const DisturbedMoment& m) {
                return f(m.rate_radps[axis] / usual_rate_radps) - f(0.0);
              }};
    case 4:
    case 5: return of_turns(r);
    default: return of_time(r);
  }
}

// Sensors -----------------------------------------------------------------------------------------------------------------------------

const Strings sensors = {"gyro x", "gyro y", "gyro z", "accelerometer x", "accelerometer y", "accelerometer z"};
const Strings quantities = {"bias", "scale factor", "direction"};

// What a sensor reads more by `number`, of its own axis or, direction, of another.
Disturbance on(std::size_t sensor, std::size_t quantity, int from, const Number& number) {
  return [=](const DisturbedMoment& m) {
    AddedReading added;
    const auto axis = static_cast<Eigen::Index>(sensor % 3);
    const double value = number(m);
    if (sensor < 3) added.gyro_radps[axis] = value * (quantity == 0 ? 1.0 : m.rate_radps[from]);
    if (sensor >= 3) added.accel_mps2[axis] = value * standard_gravity_mps2 * (quantity == 0 ? 1.0 : m.force_g[from]);
    return added;
  };
}

struct Effect {
  std::string what, sensor, quantity;
  Strings drivers;
  Disturbance added;  // without what the parameters take up; of a catalogue effect: what one unit of it reads
  double z = 0.0;     // ideal
  std::string key;    // of the catalogue, and its value
  double value = 0.0;
};

Effect draw_effect(Random& r) {
  Shape shape = draw_shape(r);
  if (one_of(r, 4) == 0) {
    const Shape other = draw_shape(r);
    shape.drivers.insert(shape.drivers.end(), other.drivers.begin(), other.drivers.end());
    shape.name += "*" + other.name;
    shape.at = [a = shape.at, b = other.at](const DisturbedMoment& m) { return a(m) * b(m); };
  }
  const auto sensor = static_cast<std::size_t>(one_of(r, 6)), quantity = static_cast<std::size_t>(one_of(r, 3));
  const int axis = static_cast<int>(sensor % 3), from = quantity == 2 ? (axis + 1 + one_of(r, 2)) % 3 : axis;
  Effect e;
  e.what = sensors[sensor] + ":" + quantities[quantity] + ":" + shape.name;
  std::replace(e.what.begin(), e.what.end(), ' ', '_');
  e.sensor = sensors[sensor];
  e.quantity = quantities[quantity];
  e.drivers = shape.drivers;
  e.added = on(sensor, quantity, from, shape.at);
  return e;
}

// Units -------------------------------------------------------------------------------------------------------------------------------

struct Unit {
  std::string grade;
  RigConfig config;
  bool unsteady = false;  // bias instability and random walk
  Number temperature_c;   // empty: the rig's
};

Unit draw_unit(Random& r, std::uint64_t seed, const std::string& grade, bool rig_temperature) {
  static constexpr const char* grades[] = {"navigation", "tactical", "mems"};
  static constexpr double walks[][2] = {{0.001, 0.01}, {0.02, 0.1}, {0.15, 0.6}},
                          forces[][2] = {{4.0, 16.0}, {20.0, 80.0}, {80.0, 300.0}};
  static constexpr double biases_degph[] = {0.08, 1.0, 30.0}, pulses_mps[] = {0.0005, 0.001, 0.004};
  const std::size_t drawn = std::array<std::size_t, 4>{0, 0, 1, 2}[static_cast<std::size_t>(one_of(r, 4))];
  const auto found = std::find(std::begin(grades), std::end(grades), grade);
  const std::size_t g = found == std::end(grades) ? drawn : static_cast<std::size_t>(found - std::begin(grades));
  Unit u{grades[g], default_rig_config(), false, {}};
  RigConfig& c = u.config;
  c.seed = 20000 + seed;
  c.noise_seed = 300000 + seed;
  c.table_errors.random_arcmin = uniform(r, 0.5, 10.0);
  c.site.latitude_deg = uniform(r, -65.0, 65.0);
  c.sample_period_s = std::array<double, 4>{0.005, 0.005, 0.01, 0.0025}[static_cast<std::size_t>(one_of(r, 4))];
  c.accel_pulse_mps = pulses_mps[g];
  for (std::size_t k = 0; k < 3; ++k) c.truth[k] = biases_degph[g] * normal(r);
  c.noise.gyro_random_walk_deg_per_rt_h = log_uniform(r, walks[g][0], walks[g][1]);
  c.noise.accel_random_walk_ug_per_rt_hz = log_uniform(r, forces[g][0], forces[g][1]);
  c.temperature.rise_c = uniform(r, -4.0, 10.0);
  c.temperature.tau_s = uniform(r, 900.0, 6000.0);
  c.noise.gyro_bias_instability_degph = c.noise.accel_bias_instability_ug = 0.0;
  if ((u.unsteady = one_of(r, 10) < 3)) {
    const double gyro = c.noise.gyro_random_walk_deg_per_rt_h / 0.002,
                 accel = c.noise.accel_random_walk_ug_per_rt_hz / 8.0;
    c.noise.gyro_bias_instability_degph = gyro * uniform(r, 0.0005, 0.003);
    c.noise.accel_bias_instability_ug = accel * uniform(r, 0.3, 2.0);
    c.noise.gyro_rate_random_walk_degph_per_rt_h = gyro * uniform(r, 0.0, 0.002);
    c.noise.accel_acceleration_random_walk_ug_per_rt_h = accel * uniform(r, 0.0, 1.0);
  }
  const double size_c = uniform(r, 1.0, 8.0), phase = uniform(r, 0.0, 2.0 * pi),
               long_s = log_uniform(r, 1500.0, 20000.0);
  const int history = one_of(r, 4);
  if (rig_temperature || history < 2) return u;
  u.temperature_c = [=](const DisturbedMoment& m) {
    const double wave = std::sin(2.0 * pi * m.time_s / long_s + phase);
    return 24.0 + size_c * (history == 2 ? wave : 1.0 - std::exp(-m.time_s / 900.0) + 0.2 * wave);
  };
  return u;
}

void give_temperature(CompressedRecording& recording, const Parameters& truth, const Number& temperature_c) {
  if (!temperature_c) return;
  double sum = 0.0, time_s = 0.0;
  each_moment(recording, truth, [&](std::size_t k, const DisturbedMoment& m) {
    Block& b = recording.blocks[k];
    b.temperature_c = static_cast<float>(1e-3 * std::round(1e3 * temperature_c(m)));
    sum += b.duration_s * static_cast<double>(b.temperature_c);
    time_s += b.duration_s;
  });
  recording.mean_temperature_c = sum / time_s;
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

// Noise as it was drawn. A flicker is as a Markov process of 300 s whose sigma is its B, a walk is as one that is as large at its corner.
NoiseModel known_noise(const RigNoise& drawn, const NoiseModel& fitted) {
  NoiseModel noise = fitted;
  noise.angle_random_walk.setConstant(drawn.gyro_random_walk_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(drawn.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz);
  const double walked_rt_h = std::sqrt(noise.bias_correlation_s / 3600.0);
  noise.gyro_bias_instability_radps =
      radps_per_degph *
      std::hypot(drawn.gyro_bias_instability_degph, walked_rt_h * drawn.gyro_rate_random_walk_degph_per_rt_h);
  noise.accel_bias_instability_mps2 =
      1e-6 * standard_gravity_mps2 *
      std::hypot(drawn.accel_bias_instability_ug, walked_rt_h * drawn.accel_acceleration_random_walk_ug_per_rt_h);
  return noise;
}

// A clean recording, its fit, and what one pass at the known noise says of columns laid beside the 21 parameters.
class Clean {
 public:
  Clean(const CompressedRecording& recording, const Parameters& unit, const RigNoise& noise)
      : recording_(recording), fit(joint_estimate(recording)), setup_(fit.setup) {
    setup_.noise = known_noise(noise, fit.noise);
    each_moment(recording, unit, [&](std::size_t, const DisturbedMoment& m) { moments_.push_back(m); });
  }

  FilterResult pass(const std::vector<EffectColumn>& catalogue, const std::vector<Disturbance>& others) const {
    EffectModel model = make_effect_model(catalogue, {recording_.info.latitude_deg}, recording_.mean_temperature_c);
    model.columns += static_cast<int>(others.size());
    model.values = Eigen::VectorXd::Zero(model.columns);
    model.regressors = [this, &others, of_catalogue = model.regressors](const BlockState& s, EffectRegressors& out) {
      of_catalogue(s, out);
      const auto m = std::lower_bound(moments_.begin(), moments_.end(), s.time_s - 1e-6,
                                      [](const DisturbedMoment& a, double time_s) { return a.time_s < time_s; });
      for (std::size_t k = 0, first = static_cast<std::size_t>(out.gyro.cols()) - others.size(); k < others.size();
           ++k) {
        const AddedReading added = others[k](*m);
        out.gyro.col(static_cast<Eigen::Index>(first + k)) = added.gyro_radps;
        out.accel.col(static_cast<Eigen::Index>(first + k)) = added.accel_mps2;
      }
    };
    FilterResult result = run_filter(recording_, fit.parameters, model, setup_);
    result.gradient.head<parameter_count>() -= fit.noise_pull;
    return result;
  }

 private:
  const CompressedRecording& recording_;
  std::vector<DisturbedMoment> moments_;

 public:
  const JointResult fit;

 private:
  FilterSetup setup_;
};

struct Ideal {  // of the 21
  Eigen::VectorXd sigma, error;
  std::vector<char> untouched;
  double z = 0.0;  // of one unit of the column
};
// `column`: of the pass; negative: none. `z`: as large as it is.
Ideal ideal_of(const FilterResult& pass, const JointResult& fit, const Parameters& truth, int column, double z) {
  const std::vector<int>& base = free_parameters();
  const SubsetSolution plain = solve_subset(pass.information, pass.gradient, base, fit.ranges);
  Ideal ideal;
  Eigen::VectorXd variance = plain.covariance.diagonal();
  ideal.error = (to_vector(fit.parameters) - to_vector(truth))(base) + plain.step;
  ideal.untouched.assign(base.size(), 1);
  if (column >= 0) {
    const Scores scores = eliminate(pass.information, pass.gradient, base, {column});
    const Eigen::VectorXd shift = plain.covariance * pass.information(base, std::vector<int>{column});
    const Eigen::VectorXd more = shift.cwiseAbs2() / scores.Q(0, 0);
    ideal.z = std::sqrt(scores.Q(0, 0));
    ideal.error -= shift * (scores.s[0] / scores.Q(0, 0));
    for (Eigen::Index k = 0; k < variance.size(); ++k)
      ideal.untouched[static_cast<std::size_t>(k)] =
          more[k] < 0.1025 * variance[k] && z * z * more[k] < 0.09 * (variance[k] + more[k]);
    variance += more;
  }
  ideal.sigma = variance.cwiseSqrt();
  return ideal;
}

// What is said ------------------------------------------------------------------------------------------------------------------------

struct Node {
  std::string sensor, quantity, driver, formula;
  double probability = 0.0;
  bool deepest = false, right = false, right_branch = false;
  double correlation = 0.0;
};
struct Said {
  double anything = 0.0;
  std::vector<Node> nodes;
};

std::string sensor_of(const EffectColumn& column) {
  const std::string name(column.entry->name);
  const char axis = column.entry->components[static_cast<std::size_t>(column.component)].front();
  if (name == "earth_rate" || name == "sample_period") return "earth rate";
  const bool one = axis >= 'x' && axis <= 'z';
  return (name.starts_with("gyro") ? "gyro" : "accelerometer") + (one ? std::string(" ") + axis : std::string());
}

// Branches of the catalogue for a diagnosis that has no statements.
std::pair<std::string, std::string> branch_of(const std::string& name) {
  const auto has = [&name](const char* word) { return name.find(word) != std::string::npos; };
  const bool scale =
      name.starts_with("gyro_scale") || name == "gyro_lock_in" || has("rate_nonl") || has("accel_scale_");
  const std::string quantity = has("flexure")                             ? "direction"
                               : scale && name != "accel_scale_asymmetry" ? "scale factor"
                                                                          : "bias";
  if (has("temperature")) return {quantity, "temperature"};
  if (has("drift") || has("warm_up")) return {quantity, "time"};
  if (has("creep") || has("relaxation")) return {quantity, "turns"};
  if (has("size_effect") || has("delay") || has("rectif") || has("nonlin") || has("lock_in") ||
      name == "gyro_scale_asymmetry")
    return {quantity, "rate"};
  return {quantity, has("magnetic") || has("earth_rate") || has("period") ? "field" : "force"};
}

template <class D>
Said said_by(const D& d) {
  Said said;
  if constexpr (requires { d.statements; }) {
    said.anything = d.statements.anything;
    for (const auto& s : d.statements.nodes)
      said.nodes.push_back({s.sensor, s.quantity, s.driver, s.formula, s.probability});
  } else {
    said.anything = d.verdict == Verdict::clean ? 0.0 : 1.0;
    for (const std::string& name : d.effect_names)
      for (const EstimatedEffect& e : d.extended.effects) {
        if (e.column.entry->name != name) continue;
        auto [quantity, driver] = branch_of(name);
        if (const auto found = d.aliases.find(name); found != d.aliases.end())
          for (const std::string& other : found->second) {
            if (branch_of(other).first != quantity) quantity.clear();
            if (branch_of(other).second != driver) driver.clear();
          }
        const std::string sensor = sensor_of(e.column);
        if (std::none_of(said.nodes.begin(), said.nodes.end(),
                         [&](const Node& n) { return n.sensor == sensor && n.formula == name; }))
          said.nodes.push_back({sensor, quantity, driver, name, 1.0});
      }
  }
  std::erase_if(said.nodes, [](const Node& n) { return n.probability < 0.8; });
  const auto above = [](const Node& a, const Node& b) {
    const auto holds = [](const std::string& x, const std::string& y) { return x.empty() || x == y; };
    return holds(a.quantity, b.quantity) && holds(a.driver, b.driver) && holds(a.formula, b.formula) &&
           a.sensor == b.sensor &&
           (a.quantity.empty() != b.quantity.empty() || a.driver.empty() != b.driver.empty() ||
            a.formula.empty() != b.formula.empty());
  };
  for (Node& a : said.nodes)
    a.deepest = a.probability >= 0.95 && std::none_of(said.nodes.begin(), said.nodes.end(), [&](const Node& b) {
                  return b.probability >= 0.95 && above(a, b);
                });
  return said;
}

// Functions of a driver, of order one; `axis`: the sensor's own.
std::vector<Number> functions_of(const std::string& driver, int axis) {
  std::vector<Number> all;
  const auto add = [&all](Number f) { all.push_back(std::move(f)); };
  if (driver == "time") {
    for (int k = 1; k <= 10; ++k)
      add([k](const DisturbedMoment& m) { return std::cos(k * pi * m.time_s / m.length_s); });
    for (const double tau : {60.0, 240.0, 960.0})
      add([tau](const DisturbedMoment& m) { return std::exp(-m.time_s / tau); });
  }
  if (driver == "temperature")
    for (int k = 1; k <= 5; ++k)
      add([k](const DisturbedMoment& m) { return std::pow((m.temperature_c - 27.0) / 5.0, k); });
  if (driver == "turns")
    for (const double tau : {3.0, 10.0, 30.0, 100.0, 300.0, 1000.0}) {
      add([tau](const DisturbedMoment& m) { return std::exp(-m.since_turn_s / tau); });
      add([tau, axis](const DisturbedMoment& m) { return m.force_g[axis] * std::exp(-m.since_turn_s / tau); });
    }
  for (int i = 0; i < 3; ++i) {
    if (driver == "angle")
      for (int k = 1; k <= 4; ++k) {
        add([i, k](const DisturbedMoment& m) { return std::cos(k * m.table_rad[i]); });
        add([i, k](const DisturbedMoment& m) { return std::sin(k * m.table_rad[i]); });
      }
    if (driver != "force" && driver != "rate") continue;
    const Number x = [i, force = driver == "force"](const DisturbedMoment& m) {
      return force ? m.force_g[i] : m.rate_radps[i] / usual_rate_radps;
    };
    add(x);
    add([x](const DisturbedMoment& m) { return std::abs(x(m)); });
    add([x](const DisturbedMoment& m) { return x(m) * x(m); });
    add([x](const DisturbedMoment& m) { return x(m) * std::abs(x(m)); });
    add([x](const DisturbedMoment& m) { return std::pow(x(m), 3); });
    for (int j = 0; j < 3; ++j) add([x, j](const DisturbedMoment& m) { return x(m) * m.force_g[j]; });
    if (driver == "rate") {
      add([x, i](const DisturbedMoment& m) { return x(m) * m.rate_radps[(i + 1) % 3] / usual_rate_radps; });
      add([](const DisturbedMoment& m) { return m.at_rest ? 0.0 : 1.0; });
    }
  }
  return all;
}

// Which of what is said is right.
class Judge {
 public:
  Judge(const Clean& clean, const CompressedRecording& recording, const Effect& truth)
      : clean_(clean), recording_(recording), truth_(truth) {}

  void judge(std::vector<Node>& nodes) const {
    std::vector<EffectColumn> named;
    bool right = true;
    for (Node& n : nodes) {
      n.right = n.right_branch = is_branch_right(n);
      if (n.formula.empty()) continue;
      right = right && n.right;
      for (const EffectColumn& c : catalogue_columns(recording_.info))
        if (c.entry->name == n.formula && sensor_of(c) == n.sensor) named.push_back(c);
    }
    if (named.empty()) return;
    const double left = correlation(named, {});
    for (Node& n : nodes) {
      if (n.formula.empty()) continue;
      n.correlation = left;
      const bool by_name = truth_.key.substr(0, truth_.key.find('.')) == n.formula && sensor_is(n.sensor);
      n.right = by_name || (n.right && (left >= same || truth_.z * std::sqrt(1.0 - left * left) < 4.0));
    }
  }

 private:
  static constexpr double same = 0.97;

  bool sensor_is(const std::string& sensor) const { return truth_.sensor.empty() || sensor == truth_.sensor; }
  bool is_branch_right(Node& n) const {
    if (truth_.what == "none") return false;
    if (n.sensor == truth_.sensor && (n.quantity.empty() || n.quantity == truth_.quantity) &&
        (n.driver.empty() || contains(truth_.drivers, n.driver)))
      return true;
    for (const char* driver : {"time", "temperature", "turns", "angle", "force", "rate", "field"})
      for (const std::string& quantity : quantities)
        if ((n.driver.empty() || n.driver == driver) && (n.quantity.empty() || n.quantity == quantity)) {
          std::vector<Disturbance> span;
          std::vector<EffectColumn> field;
          for (std::size_t s = 0; s < sensors.size(); ++s)
            for (int from = 0; sensors[s].starts_with(n.sensor) && from < 3; ++from)
              if ((from == static_cast<int>(s % 3)) == (quantity != "direction"))
                for (const Number& f : functions_of(driver, static_cast<int>(s % 3)))
                  span.push_back(on(s, quantity == "bias" ? 0 : 1, from, f));
          if (driver == std::string("field") && quantity == "bias")
            for (const EffectColumn& c : catalogue_columns(recording_.info))
              if ((c.entry->name == "gyro_magnetic" || c.entry->name == "earth_rate") && sensor_of(c) == n.sensor)
                field.push_back(c);
          if (!span.empty() || !field.empty()) n.correlation = std::max(n.correlation, correlation(field, span));
        }
    return n.correlation >= same;
  }

  // Multiple correlation of the truth with all of these, the 21 eliminated.
  double correlation(const std::vector<EffectColumn>& catalogue, std::vector<Disturbance> others) const {
    others.push_back(truth_.added);
    const FilterResult pass = clean_.pass(catalogue, others);
    std::vector<int> columns, group;
    for (int k = parameter_count; k < pass.gradient.size(); ++k) columns.push_back(k);
    const Scores scores = eliminate(pass.information, pass.gradient, free_parameters(), columns);
    const int truth = static_cast<int>(columns.size()) - 1;
    for (int k = 0; k < truth; ++k)
      if (scores.kept[k] > 1e-7) group.push_back(k);  // below is rounding
    return group.empty() ? 0.0 : multiple_correlation(scores, truth, group);
  }

  const Clean& clean_;
  const CompressedRecording& recording_;
  const Effect& truth_;
};

// A line ------------------------------------------------------------------------------------------------------------------------------

double median(std::vector<double> v) {
  if (v.empty()) return 0.0;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}
double largest(const std::vector<double>& v) { return v.empty() ? 0.0 : *std::max_element(v.begin(), v.end()); }

void print(const char* kind, std::uint64_t seed, int number, const Unit& unit, const Effect& truth, const Diagnosis& d,
           const Said& said, const ErrorsOverRecording& errors, const Ideal& ideal, double seconds) {
  std::string nodes;
  for (const Node& n : said.nodes) {
    char text[64];
    std::snprintf(text, sizeof text, "=%.4f,%d,%d,%d,%.3f", n.probability, n.right, n.right_branch, n.deepest,
                  n.correlation);
    const auto word = [](const std::string& s) { return s.empty() ? std::string("-") : s; };
    nodes += (nodes.empty() ? "" : ";") + n.sensor + ":" + word(n.quantity) + ":" + word(n.driver) + ":" +
             word(n.formula) + text;
  }
  std::replace(nodes.begin(), nodes.end(), ' ', '_');
  std::vector<double> sigmas, errors_ideal;
  double worst = 0.0, squares = 0.0, all = 0.0;
  std::string_view parameter = "-";
  int untouched = 0;
  for (std::size_t i = 0; i < free_parameters().size(); ++i) {
    const int k = free_parameters()[i];
    const auto at = static_cast<Eigen::Index>(i);
    all += std::pow(ideal.error[at] / ideal.sigma[at], 2);
    if (errors.sigma[k] <= 0.0) continue;
    const double z = errors.error[k] / errors.sigma[k];
    sigmas.push_back(errors.sigma[k] / ideal.sigma[at]);
    errors_ideal.push_back(std::abs(errors.error[k]) / ideal.sigma[at]);
    if (std::abs(z) > worst) worst = std::abs(z), parameter = parameter_keys[static_cast<std::size_t>(k)];
    if (ideal.untouched[i]) squares += z * z, ++untouched;
  }
  std::printf("%s %llu %d %s %s %d %.2f %.4f %s %d %s %.2f %s %.3f %.2f %.3f %.2f %d %.2f %.2f %.2f\n", kind,
              static_cast<unsigned long long>(seed), number, truth.what.c_str(), unit.grade.c_str(), unit.unsteady,
              truth.z, said.anything, to_string(d.verdict), d.trusted, nodes.empty() ? "-" : nodes.c_str(), worst,
              std::string(parameter).c_str(), median(sigmas), largest(sigmas), median(errors_ideal),
              largest(errors_ideal), untouched, squares, all, seconds);
  std::fflush(stdout);
}

// A seed ------------------------------------------------------------------------------------------------------------------------------

struct Options {
  std::string kind = "drawn", only, grade, sequence = "fourteen_step.seq";
  int draws = 4;
  double least_z = 0.7, most_z = 100.0;
};

Effect draw_of_catalogue(Random& r, const RigConfig& config, const CompressedRecording& recording,
                         const JointResult& fit) {
  const Strings keys = rig_effect_keys();
  Effect e;
  e.key = e.what = keys[static_cast<std::size_t>(one_of(r, static_cast<int>(keys.size())))];
  for (EffectColumn c : catalogue_columns(recording.info)) {
    if (c.key() != e.key) continue;
    if (c.tau_s > 0.0)
      c.tau_s = e.key.starts_with("gyro_warm_up") ? config.effects.gyro_warm_up_tau_s
                                                  : config.effects.post_rotation_relaxation_tau_s;
    e.sensor = sensor_of(c);
    std::vector<AddedReading> readings = readings_of(c, fit, recording);
    std::vector<double> times_s;
    for (const Block& b : recording.blocks) times_s.push_back(recording.middle_s(b));
    e.added = [readings, times_s](const DisturbedMoment& m) {
      return readings[static_cast<std::size_t>(std::lower_bound(times_s.begin(), times_s.end(), m.time_s - 1e-6) -
                                               times_s.begin())];
    };
    break;
  }
  return e;
}

void run(std::uint64_t seed, const Options& options, const Sequence& sequence, const Sequence& second) {
  Random r(seed * 1000003u + 17u);
  const bool catalogue = options.kind == "catalogue";
  const Unit unit = draw_unit(r, seed, options.grade, catalogue);
  RigConfig again = unit.config;
  again.noise_seed = 600000 + seed;
  RigRecording made = record_on_rig(sequence, unit.config), held = record_on_rig(second, again);
  give_temperature(made.recording, made.truth, unit.temperature_c);
  give_temperature(held.recording, held.truth, unit.temperature_c);
  const Parameters truth = truth_over(made, sequence, unit.config);
  const Clean clean(made.recording, made.truth, unit.config.noise);

  std::vector<Effect> effects;
  std::vector<Disturbance> columns;
  while (options.kind != "clean" && static_cast<int>(effects.size()) < options.draws) {
    Effect e = catalogue ? draw_of_catalogue(r, unit.config, made.recording, clean.fit) : draw_effect(r);
    e.z = catalogue ? 10.0 : log_uniform(r, options.least_z, options.most_z);
    if (!e.added || e.what.find(options.only) == std::string::npos) continue;
    if (!catalogue) e.added = without_parameters(e.added, made.recording, made.truth);
    columns.push_back(catalogue ? without_parameters(e.added, made.recording, made.truth) : e.added);
    effects.push_back(e);
  }
  const FilterResult pass = clean.pass({}, columns);
  if (options.kind == "clean") effects.emplace_back().what = "none";
  for (std::size_t k = 0; k < effects.size(); ++k) {
    Effect& e = effects[k];
    const int column = columns.empty() ? -1 : parameter_count + static_cast<int>(k);
    const Ideal ideal = ideal_of(pass, clean.fit, truth, column, e.z);
    const double size = (r() % 2 == 0 ? 1.0 : -1.0) * (columns.empty() ? 0.0 : e.z / ideal.z);
    CompressedRecording recording = made.recording, holdout = held.recording;
    Parameters right = truth;
    if (catalogue) {
      RigConfig with = unit.config;
      with.temperature.reference_c = made.recording.mean_temperature_c;
      *find_effect(with.effects, e.key) = size;
      recording = record_on_rig(sequence, with).recording;
      with.noise_seed = again.noise_seed;
      holdout = record_on_rig(second, with).recording;
      const auto whole = [&](std::size_t, const DisturbedMoment& m) { return e.added(m); };
      right =
          from_vector(to_vector(truth) + size * as_parameters(taken_up(whole, made.recording, made.truth), made.truth));
      e.added = columns[k];
    } else if (!columns.empty()) {
      const Disturbance laid = [&e, size](const DisturbedMoment& m) {
        const AddedReading one = e.added(m);
        return AddedReading{size * one.gyro_radps, size * one.accel_mps2};
      };
      disturb(recording, made.truth, laid);
      disturb(holdout, made.truth, laid);
    }
    DiagnosisOptions diagnosis;
    diagnosis.holdouts = {&holdout};
    const auto began = std::chrono::steady_clock::now();
    const Diagnosis d = diagnose(recording, diagnosis);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    Said said = said_by(d);
    Judge(clean, made.recording, e).judge(said.nodes);
    print(options.kind.c_str(), seed, static_cast<int>(k), unit, e, d, said,
          errors_over_recording(d.extended, recording, right), ideal, seconds);
  }
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  Options options;
  std::uint64_t first = 0, count = 0;
  bool understood = argc >= 3;
  for (int k = 1; understood && k < argc; ++k) {
    const std::string word = argv[k];
    const auto next = [&] { return std::string(k + 1 < argc ? argv[++k] : ""); };
    if (k == 1)
      first = std::strtoull(argv[k], nullptr, 10);
    else if (k == 2)
      count = std::strtoull(argv[k], nullptr, 10);
    else if (word == "--clean" || word == "--catalogue")
      options.kind = word.substr(2);
    else if (word == "--draws")
      options.draws = std::atoi(next().c_str());
    else if (word == "--z")
      options.least_z = std::atof(next().c_str()), options.most_z = std::atof(next().c_str());
    else if (word == "--only")
      options.only = next();
    else if (word == "--grade")
      options.grade = next();
    else if (word == "--sequence")
      options.sequence = next();
    else
      understood = false;
  }
  if (!understood) {
    std::fprintf(stderr,
                 "usage: study_undeclared SEED_FIRST SEED_COUNT [--clean | --catalogue] [--draws N] [--z LOW HIGH] "
                 "[--only WORD] "
                 "[--grade NAME] [--sequence NAME]\n");
    return 1;
  }
  const Sequence sequence = must_read_sequence(options.sequence), second = must_read_sequence("holdout.seq");
  for (std::uint64_t seed = first; seed < first + count; ++seed) {
    run(seed, options, sequence, second);
    std::fprintf(stderr, "%s: seed %llu, %llu of %llu\n", options.kind.c_str(), static_cast<unsigned long long>(seed),
                 static_cast<unsigned long long>(seed - first + 1), static_cast<unsigned long long>(count));
  }
}
