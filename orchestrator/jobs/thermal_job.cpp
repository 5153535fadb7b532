#include "orchestrator/jobs/thermal_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

#include "calib/prediction/predict.h"
#include "calib/statistics/data_screen.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

constexpr double not_known = std::numeric_limits<double>::quiet_NaN();

struct Leg {
  ThermalLeg leg;
  ParameterFile file;
  std::string path;  // of the parameter file, or of the recording
  std::string measured;
  std::optional<int> direction;
};

// Mean, and slope of the straight line through all samples.
Status follow_thermometer(RecordingSource& source, ThermalLeg& leg) {
  double n = 0.0, t = 0.0, T = 0.0, tt = 0.0, tT = 0.0;
  std::optional<std::int64_t> first;
  TRY(source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      if (!std::isfinite(sample.temperature_c) || !temperature_can_be(sample.temperature_c)) continue;
      if (!first) first = sample.counter;
      const double h = static_cast<double>(sample.counter - *first) * source.info().sample_period_s / 3600.0,
                   c = static_cast<double>(sample.temperature_c);
      n += 1.0, t += h, T += c, tt += h * h, tT += h * c;
    }
    return Status{};
  }));
  if (n == 0.0) return {};
  leg.temperature_c = T / n;
  const double spread = tt - t * t / n;
  leg.rate_c_per_h = spread > 0.0 ? (tT - t * T / n) / spread : 0.0;
  return {};
}

Status read_leg_conf(const std::string& path, Leg& leg) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  leg.leg.temperature_c =
      file.number_or("temperature_c", leg.leg.temperature_c, between(least_temperature_c, most_temperature_c));
  leg.leg.rate_c_per_h = file.number_or("rate_c_per_h", leg.leg.rate_c_per_h);
  leg.leg.switch_on = static_cast<int>(file.integer_or("switch_on", leg.leg.switch_on, 0, 1'000'000));
  if (file.has("direction")) {
    const std::string direction = file.one_of("direction", {"up", "down", "unknown"});
    leg.direction = direction == "up" ? 1 : direction == "down" ? -1 : 0;
  }
  return file.check_all_used();
}

Status take_covariance(const StoredCovariance& stored, Leg& leg) {
  leg.leg.value = leg.file.parameters;
  for (int key = 0; key < parameter_count; ++key)
    if (stored.covariance(key, key) > 0.0) leg.leg.free.push_back(key);
  leg.leg.covariance = stored.covariance(leg.leg.free, leg.leg.free);
  return {};
}

Result<Leg> read_leg(const std::string& path, int number, const ThermalRequest& request,
                     std::vector<std::string>& notes) {
  std::error_code error;
  const bool is_folder = fs::is_directory(path, error),
             is_file = !is_folder && recognise_file(path) == FileKind::parameters;
  const std::string folder = is_folder ? path : fs::path(path).parent_path().string();
  Leg leg;
  leg.leg.name = path;
  leg.leg.temperature_c = leg.leg.rate_c_per_h = not_known;
  leg.leg.switch_on = -number;  // its own
  leg.path = is_file ? path : path + "/" + parameters_name;
  const bool has_recording = !is_file && recognise_file(path) == FileKind::recording;
  std::string why;
  if (is_file || (is_folder && path_exists(leg.path))) {
    const Result<std::string> text = read_whole_file(leg.path);
    if (!text) return text.error();
    leg.file = TRY(parse_parameter_file(*text, leg.path));
    const StoredCovariance stored = TRY(stored_covariance(leg.file, leg.path));
    if (stored.source == std::string_view("covariance"))
      TRY(take_covariance(stored, leg));
    else
      why = leg.path + ": " +
            (leg.file.effects.empty() ? "holds no covariance of its parameters" : "has effects beside its parameters") +
            ": expected the joint estimate of the 24, or its recording beside it";
    if (leg.file.temperature) return input_error(leg.path + ": has temperature coefficients already: expected a leg");
    if (!why.empty() && !has_recording) return input_error(why);
  }
  if (has_recording || (leg.leg.free.empty() && why.empty())) {
    const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
    if (leg.leg.free.empty()) {
      request.phase("calibrating " + path);
      const LoadedRecording loaded = TRY(load_recording(*source));
      CalibrationRequest wanted;
      wanted.time_utc = request.time_utc;
      wanted.partial = true;
      const CalibrationOutput output = TRY(calibrate_recording(loaded, wanted));
      leg.path = path, leg.file = output.file;
      add_measured_utc(loaded.data.info, leg.file);
      const StoredCovariance stored = TRY(stored_covariance(leg.file, path));
      if (stored.source != std::string_view("covariance"))
        return input_error(path + ": its calibration gives no covariance: expected a recording with table angles");
      TRY(take_covariance(stored, leg));
    }
    TRY(follow_thermometer(*source, leg.leg));
  }
  if (!std::isfinite(leg.leg.temperature_c))
    leg.leg.temperature_c = leg.file.reference_temperature_c.value_or(not_known);
  if (const std::string conf = (folder.empty() ? "." : folder) + "/leg.conf"; path_exists(conf))
    TRY(read_leg_conf(conf, leg));
  for (const std::string& given : request.temperatures) {
    const std::size_t equals = given.rfind('=');
    if (equals == std::string::npos || given.substr(0, equals) != path) continue;
    const std::optional<double> value = parse_number(std::string_view(given).substr(equals + 1));
    if (!value) return input_error("--temperature " + given + ": expected a number of C behind the last =");
    leg.leg.temperature_c = *value;
  }
  if (!std::isfinite(leg.leg.temperature_c))
    return input_error(path + ": has no thermometer: expected --temperature " + path +
                       "=VALUE, or temperature_c in its leg.conf");
  if (!std::isfinite(leg.leg.rate_c_per_h)) leg.leg.rate_c_per_h = 0.0;
  if (const std::string* const measured = find_further(leg.file, "record.measured_utc")) leg.measured = *measured;
  if (!is_trusted(leg.file)) notes.push_back(path + ": its sigmas are not trusted");
  return leg;
}

// Of one unit, in one form; no recording twice.
Status check_together(const std::vector<Leg>& legs) {
  const ParameterFile& first = legs.front().file;
  for (std::size_t k = 1; k < legs.size(); ++k) {
    const ParameterFile& file = legs[k].file;
    if (file.unit_serial != first.unit_serial)
      return input_error(fmt::format("{}: is of unit '{}': expected '{}', as {}", legs[k].path, file.unit_serial,
                                     first.unit_serial, legs.front().path));
    if (file.gyro_increment != first.gyro_increment || file.accel_increment != first.accel_increment ||
        file.accel_pulse_mps != first.accel_pulse_mps || file.simulated != first.simulated)
      return input_error(legs[k].path + ": has other increments than " + legs.front().path +
                         ", or one is simulated: expected legs alike");
    for (std::size_t j = 0; j < k; ++j)
      if (legs[j].file.recording_hash == file.recording_hash)
        return input_error(legs[k].path + ": is the recording of " + legs[j].path + " again: expected each once");
  }
  return {};
}

// Directions, and switch-ons numbered in order.
void put_in_order(std::vector<Leg>& legs) {
  const bool timed = std::ranges::none_of(legs, [](const Leg& leg) { return leg.measured.empty(); });
  if (timed) std::ranges::stable_sort(legs, {}, &Leg::measured);
  for (std::size_t k = 0; k < legs.size(); ++k) {
    const double step = k == 0 ? 0.0 : legs[k].leg.temperature_c - legs[k - 1].leg.temperature_c;
    const int found = std::abs(step) > thermal_priors.same_temperature_c ? (step > 0.0 ? 1 : -1)
                      : k == 0                                           ? 0
                                                                         : legs[k - 1].leg.direction;
    legs[k].leg.direction = legs[k].direction.value_or(found);
  }
  std::map<int, int> numbers;
  for (Leg& leg : legs)
    leg.leg.switch_on = numbers.try_emplace(leg.leg.switch_on, static_cast<int>(numbers.size()) + 1).first->second;
}

// What parameters that are off by this, rms, are worth in an hour at rest.
double miles(const ParameterFile& file, const ParameterCovariance& off) {
  RecordingInfo info;
  info.gyro_increment = file.gyro_increment, info.accel_increment = file.accel_increment;
  info.accel_pulse_mps = file.accel_pulse_mps;
  info.sample_period_s = file.sample_period_s;
  FreeNavigationSetup setup;
  setup.site = {file.latitude_deg * rad_per_deg, file.gravity_mps2};
  setup.counts = counts_model(from_vector(file.parameters), info);
  setup.parameter_covariance = off;
  const DriftPlan plan;
  setup.align_s = plan.align_s;
  const ExpectedDrift::Point end = expected_drift(setup, plan.heading_rad, plan.free_s, plan.free_s).points.back();
  return expected_nm_per_h(end.covariance_m2 - end.noise_m2, end.time_s);
}

ParameterCovariance mean_square(const std::vector<ParameterVector>& all) {
  ParameterCovariance sum = ParameterCovariance::Zero();
  for (const ParameterVector& one : all) sum += one * one.transpose() / static_cast<double>(all.size());
  return sum;
}

ParameterFile file_of(const std::vector<Leg>& legs, const ThermalModel& model, const std::string& time_utc) {
  ParameterFile file = legs.front().file;
  std::erase_if(file.further, [](const auto& key) { return !key.first.starts_with("noise."); });
  describe_thermal(model, file);
  std::string hashes;
  bool trusted = find_further(file, undetermined_key) == nullptr;
  for (const Leg& leg : legs) {
    hashes += leg.file.recording_hash + "\n";
    trusted = trusted && is_trusted(leg.file);
  }
  file.add_further("quality.trusted", std::string(trusted ? "true" : "false"));
  for (std::size_t k = 0; k < legs.size(); ++k) {
    file.add_further(fmt::format("record.leg.{}.hash", k + 1), legs[k].file.recording_hash);
    file.add_further(fmt::format("record.leg.{}.temperature_c", k + 1), legs[k].leg.temperature_c);
  }
  file.recording_hash = hash_of_text(hashes);
  file.model = "temperature", file.method = "joint";
  file.software_version = software_version();
  file.time_utc = time_utc;
  return file;
}

}  // namespace

Result<ThermalOutput> thermal_calibration(const ThermalRequest& request) {
  ThermalOutput output;
  ThermalReport& report = output.report;
  std::vector<Leg> legs;
  for (const std::string& given : request.temperatures)
    if (std::ranges::none_of(request.legs, [&](const std::string& leg) { return given.starts_with(leg + "="); }))
      return input_error("--temperature " + given + ": expected LEG=VALUE, LEG one of the legs");
  for (const std::string& path : request.legs)
    legs.push_back(TRY(read_leg(path, static_cast<int>(legs.size()) + 1, request, report.notes)));
  TRY(check_together(legs));
  put_in_order(legs);
  for (const Leg& leg : legs) report.legs.push_back(leg.leg);
  request.phase("weighing models of temperature");
  report.model = TRY(fit_thermal_model(report.legs, {request.reference_c}));
  output.file = file_of(legs, report.model, request.time_utc);
  report.unit = output.file.unit_serial;
  report.gyro_increment = output.file.gyro_increment;
  report.simulated = output.file.simulated;
  const ThermalHoldout& held_out = report.model.holdout;
  report.before_nm_per_h = miles(output.file, mean_square(held_out.before));
  report.after_nm_per_h = miles(output.file, mean_square(held_out.after));
  report.noise_nm_per_h = miles(output.file, held_out.noise);
  return output;
}

}  // namespace turncal
