// One engine or two (docs/import.md): recordings turned by hand, fitted by the rest model and by the joint estimate.
//
//   study_hand SEED_FIRST SEED_COUNT ARW TREMOR      units drawn at random (hand_unit.h), ARW in deg/sqrt(h)
//   study_hand --measured EFFECT[,EFFECT]|- RECORDING...    as `turncal segment` leaves them, with these effects
// The joint estimate has the same rests and legs as the rest model, its result as the start, and attitudes carried on from it in place of
// the table's angles. Of every engine it is tried with:
//   rests   the rest model
//   joint   the joint estimate as it is
//   anew    its velocity begins anew at every rest
//   floor   the same, and the rest model's floor of the direction added to the variance of the attitude there
//   chains  at every rest nothing is known: the attitude is levelled, the heading free
// Drawn: a line a unit and engine with the mean square of error over sigma, the largest error over sigma, the errors in sigmas of the
// rest model (root mean square), that of gyro biases, of accelerometers and of n alone, how many parameters are not determined, the filter's
// level and seconds. Measured: cross-validation by quarters of the rests: gravity's norm and direction and the gyros there are predicted.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/model/attitude.h"
#include "calib/model/effects.h"
#include "calib/rests/rest_model.h"
#include "calib/statistics/block_motion.h"
#include "calib/statistics/segmentation.h"
#include "orchestrator/jobs/calibration_job.h"
#include "tests/calib/compress.h"
#include "tests/calib/hand_rotations.h"
#include "tests/study/hand_unit.h"

namespace turncal {
namespace {

enum class Engine { rests, joint, anew, floor, chains };
constexpr std::array<const char*, 5> engine_names = {"rests", "joint", "anew", "floor", "chains"};

struct Fitted {
  bool ok = false;
  std::string message;
  Parameters parameters;
  Eigen::VectorXd effects;
  Eigen::VectorXd sigma;  // of the 24; NaN: not determined
  double level = 0.0;
};

// The rests of the rest model, with the attitudes that its parameters carry from one to the next as table angles.
CompressedRecording with_angles(const RestData& data, const Parameters& parameters) {
  CompressedRecording recording = *data.recording;
  const SensorModel model = sensor_model(parameters, recording.info);
  const auto force = [&](const Rest& rest) {
    return Eigen::Vector3d(model.accel_scale * rest.whole.accel - model.accel_bias_mps2);
  };
  std::vector<char> at_rest(recording.blocks.size(), 0);
  Eigen::Matrix3d C = Eigen::Matrix3d::Identity();
  std::size_t next = data.rests.front().whole.first_block;
  for (const Rest& rest : data.rests) {
    for (; next < rest.whole.first_block; ++next)
      C *= rotation_exp(evaluate(recording.blocks[next], model, recording.info.sample_period_s).rotation);
    next = rest.whole.end_block;
    C = level(C, force(rest));
    Segment& segment = recording.segments[std::size_t(recording.blocks[rest.whole.first_block].segment)];
    segment.heading_deg = std::atan2(C(2, 0), C(0, 0)) / rad_per_deg;
    segment.pitch_deg = std::asin(C(1, 0)) / rad_per_deg;
    segment.roll_deg = std::atan2(-C(1, 2), C(1, 1)) / rad_per_deg;
    for (std::size_t k = rest.whole.first_block; k < next; ++k) at_rest[k] = 1;
  }
  for (std::size_t k = 0; k < at_rest.size(); ++k) recording.blocks[k].whole_second &= at_rest[k] != 0;
  return recording;
}

Fitted fit_joint(Engine engine, const RestData& data, const RestFit& from, const std::vector<EffectColumn>& effects) {
  const CompressedRecording recording = with_angles(data, from.parameters);
  JointOptions options;
  options.start = from.parameters;
  options.effects = effects;
  options.start_effects = from.effect_values;
  options.reference_temperature_c = 0.0;
  for (std::size_t k = 1; k < data.rests.size(); ++k) {
    Break cut{.block = data.rests[k].whole.first_block, .attitude_sigma_rad = 0.0};
    if (engine == Engine::floor) cut.attitude_sigma_rad = from.floors[index(RestKind::direction)];
    if (engine == Engine::chains || !data.legs[k - 1].fault.empty()) cut.attitude_sigma_rad = 1.0;
    if (engine != Engine::joint || cut.nothing_is_known()) options.breaks.push_back(cut);
  }
  const JointResult r = joint_estimate(recording, options);
  Fitted fitted;
  fitted.ok = r.converged;
  fitted.message = r.message;
  fitted.parameters = r.parameters;
  fitted.effects.resize(Eigen::Index(r.effects.size()));
  for (std::size_t k = 0; k < r.effects.size(); ++k) fitted.effects[Eigen::Index(k)] = r.effects[k].value;
  fitted.sigma = r.sigma;
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[std::size_t(k)] && !r.determined[std::size_t(k)]) fitted.sigma[k] = std::nan("");
  fitted.level = r.whiteness.level;
  return fitted;
}

Fitted of_rests(const RestFit& fit) {
  return {fit.converged, fit.message, fit.parameters, fit.effect_values, fit.sigma.head<parameter_count>(), 0.0};
}

struct Squares {
  double sum = 0.0;
  int count = 0;
  void add(double value) {
    sum += value * value;
    ++count;
  }
  double mean() const { return count > 0 ? sum / count : 0.0; }
};

void run_drawn(const HandUnitPlan& plan) {
  const HandUnit unit = draw_hand_unit(plan);
  const Segmentation found = find_rests(unit.info, unit.samples);
  const CompressedRecording recording = compress(unit.info, found.segments, unit.samples, rest_compression_options());
  const RestData data = make_rest_data(recording);
  const Result<RestFit> fit = fit_rests(data, EffectModel{});
  std::printf("# %u: %zu rests of %d found, %.1f s in the mean; %s\n", plan.seed, data.rests.size(), unit.rests,
              unit.rest_s, fit ? fit->message.c_str() : fit.error().message.c_str());
  if (!fit || !fit->converged) return;
  for (std::size_t e = 0; e < engine_names.size(); ++e) {
    const auto begin = std::chrono::steady_clock::now();
    const auto engine = static_cast<Engine>(e);
    const Fitted f = engine == Engine::rests ? of_rests(*fit) : fit_joint(engine, data, *fit, {});
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    const ParameterVector error = to_vector(f.parameters) - to_vector(unit.truth);
    Squares own, others, bias, accel, n;
    double largest = 0.0;
    int open = 0;
    for (const int k : free_parameters()) {
      if (std::isnan(f.sigma[k])) {
        ++open;
        continue;
      }
      own.add(error[k] / f.sigma[k]);
      largest = std::max(largest, std::abs(error[k] / f.sigma[k]));
      if (std::isnan(fit->sigma[k])) continue;
      const double in_sigmas = error[k] / fit->sigma[k];
      others.add(in_sigmas);
      (k < 3 ? bias : k >= 6 && k < 15 ? n : accel).add(in_sigmas);
    }
    std::printf("%-6s %u %g %g %d %.3f %.2f %.3f %.3f %.3f %.3f %d %.2f %.1f%s%s\n", engine_names[e], plan.seed,
                plan.angle_random_walk_deg_per_rt_h, plan.tremor, f.ok, own.mean(), largest, std::sqrt(others.mean()),
                std::sqrt(bias.mean()), std::sqrt(accel.mean()), std::sqrt(n.mean()), open, f.level, took.count(),
                f.ok ? "" : " # ", f.ok ? "" : f.message.c_str());
  }
  std::fflush(stdout);
}

// The rests from `first` to `end` left out, and the legs that touch them.
RestData without(const RestData& data, std::size_t first, std::size_t end) {
  RestData rest = data;
  const auto at = [](auto& list, std::size_t k) { return list.begin() + std::ptrdiff_t(k); };
  rest.rests.erase(at(rest.rests, first), at(rest.rests, end));
  rest.legs.erase(at(rest.legs, first > 0 ? first - 1 : 0), at(rest.legs, std::min(end, data.legs.size())));
  if (first > 0 && end < data.rests.size()) {
    RestLeg leg = data.legs[first];
    leg.from = first - 1;
    leg.first_block = data.rests[first - 1].whole.end_block;
    leg.end_block = data.rests[end].whole.first_block;
    leg.fault = "left out";
    rest.legs.insert(at(rest.legs, first - 1), leg);
  }
  for (std::size_t k = 0; k < rest.legs.size(); ++k) rest.legs[k].from = k;
  return rest;
}

// Rows of the rests from `first` to `end`, and of the legs between them.
RestErrors errors_of(const RestData& data, const Fitted& fit, EffectModel effects, std::size_t first, std::size_t end) {
  effects.values = fit.effects;
  const RestSystem system = make_rest_system(data, fit.parameters, effects, false);
  Eigen::VectorXd residual = system.residual;
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    const auto owner = std::size_t(system.owner[std::size_t(k)]);
    const bool leg = system.kind[std::size_t(k)] == RestKind::direction;
    if (owner < first || owner + (leg ? 1 : 0) >= end) residual[k] = std::nan("");
  }
  return rest_errors(system, residual);
}

void run_measured(const std::vector<EffectColumn>& columns, const char* path) {
  const Result<LoadedRecording> loaded = load_recording(path);
  if (!loaded) {
    std::printf("# %s: %s\n", path, loaded.error().message.c_str());
    return;
  }
  const RestData data = make_rest_data(loaded->data);
  const EffectModel effects = make_effect_model(columns, {loaded->data.info.latitude_deg}, 0.0);
  constexpr std::size_t parts = 4;
  std::array<Squares, engine_names.size()> norm, direction, gyro;
  std::array<int, engine_names.size()> failed{}, open{};
  std::array<double, engine_names.size()> level{};
  for (std::size_t part = 0; part < parts; ++part) {
    const std::size_t first = part * data.rests.size() / parts, end = (part + 1) * data.rests.size() / parts;
    const RestData kept = without(data, first, end);
    const Result<RestFit> fit = fit_rests(kept, effects);
    if (!fit || !fit->converged) {
      std::printf("# %s: %s\n", path, fit ? fit->message.c_str() : fit.error().message.c_str());
      return;
    }
    for (std::size_t e = 0; e < engine_names.size(); ++e) {
      const auto engine = static_cast<Engine>(e);
      const Fitted f = engine == Engine::rests ? of_rests(*fit) : fit_joint(engine, kept, *fit, columns);
      failed[e] += !f.ok;
      for (const int k : free_parameters()) open[e] += std::isnan(f.sigma[k]);
      level[e] += f.level / parts;
      if (f.effects.size() != fit->effect_values.size()) continue;
      const RestErrors errors = errors_of(data, f, effects, first, end);
      norm[e].add(errors.norm_rms_mps2);
      direction[e].add(errors.direction_rms_rad);
      gyro[e].add(errors.gyro_rms_radps);
    }
  }
  for (std::size_t e = 0; e < engine_names.size(); ++e)
    std::printf("%-6s %s norm %.3f mm/s^2 direction %.3f mrad gyros %.5f deg/s failed %d open %d level %.2f\n",
                engine_names[e], path, 1e3 * std::sqrt(norm[e].mean()), 1e3 * std::sqrt(direction[e].mean()),
                std::sqrt(gyro[e].mean()) / rad_per_deg, failed[e], open[e], level[e]);
  std::fflush(stdout);
}

std::vector<EffectColumn> columns_named(std::string names) {
  std::vector<EffectColumn> columns;
  for (char* name = std::strtok(names.data(), ","); name; name = std::strtok(nullptr, ","))
    if (const EffectEntry* entry = find_effect(name))
      for (std::size_t c = 0; c < entry->components.size(); ++c)
        columns.push_back({.entry = entry, .component = int(c)});
  return columns;
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc > 3 && std::strcmp(argv[1], "--measured") == 0) {
    for (int k = 3; k < argc; ++k) run_measured(columns_named(argv[2]), argv[k]);
  } else if (argc == 5) {
    const unsigned first = unsigned(std::atoi(argv[1])), count = unsigned(std::atoi(argv[2]));
    for (unsigned seed = first; seed < first + count; ++seed)
      run_drawn({std::strtod(argv[3], nullptr), std::strtod(argv[4], nullptr), seed});
  } else {
    std::fprintf(stderr,
                 "usage: study_hand SEED_FIRST SEED_COUNT ARW TREMOR | --measured EFFECT[,EFFECT]|- RECORDING...\n");
    return 1;
  }
  return 0;
}
