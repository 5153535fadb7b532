// A parameter file applied to a recording: what its effects read over each sample, the samples calibrated by one or more files as intervals
// of motion (calib/navigation/mechanisation.h), and what the file says of its own uncertainty.
//
// The terms of effects are those of the estimate itself (calib/joint/joint_filter.h): constant over a block, one second at rest and at most
// 0.1 s in a turn, evaluated at the rate, specific force, temperature, time and attitude of the block. Time counts from the
// first sample of the recording at hand.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/model/parameters.h"
#include "calib/navigation/drift.h"
#include "calib/navigation/free_navigation.h"
#include "calib/navigation/mechanisation.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

class EffectTerms {
 public:
  // Over the blocks of `recording`, or of the source, which is read once. An error when an effect is unknown, needs a temperature that the recording lacks, or needs an
  // attitude (earth rate, magnetic field) and the recording has no table angles.
  static Result<EffectTerms> of(const ParameterFile& file, const std::string& file_name, RecordingSource& source,
                                const CompressedRecording* recording);

  // For samples in counter order.
  struct Term {
    Eigen::Vector3d rate_radps = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();
  };
  const Term& at(std::int64_t counter);

 private:
  // Without segments nothing says when the unit was at rest: every block by its own readings. What follows a rotation is left out.
  Status of_motion_alone(RecordingSource& source, const ParameterFile& file, EffectModel model);

  std::vector<std::int64_t> starts_;
  std::vector<Term> terms_;
  std::size_t index_ = 0;
};

// The `noise.` keys; what is not there keeps the value of NoiseModel, and the pulses are those of the increments. has_noise: whether the
// random walks are there.
bool has_noise(const ParameterFile& file);
Result<NoiseModel> stored_noise(const ParameterFile& file, const std::string& file_name);

// Correlations of the `quality.covariance.` keys with the standard deviations `sigma.` (they can be wider than the covariance, where
// the fit is not trusted); without those keys the standard deviations alone, and zero where there is none.
//
// A file with effects gives none: its sigmas are those of parameters and effects together, and without their correlations a bias and its
// own drift would count as two errors that never cancel.
struct StoredCovariance {
  ParameterCovariance covariance = ParameterCovariance::Zero();
  const char* source = "none";  // covariance, sigmas, none or effects
};
Result<StoredCovariance> stored_covariance(const ParameterFile& file, const std::string& file_name);

// Samples that a recording lost, or marked as bad, between two that it has; and how that is said.
//
// n of them are filled in with the mean of their two neighbours, and err by n q / sqrt(12) of counting in pulses q, and by n N sqrt(dt / 2)
// of random walk N. With a pulse of 0.93" two are off by 0.54", in 300 s of alignment 0.008 deg of heading, a quarter of what 0.002
// deg/sqrt(h) leaves; it grows with n, and 5 s would be degrees. Nothing is aligned or navigated over more than two.
inline constexpr std::int64_t most_filled_samples = 2;

struct SampleGap {
  std::int64_t first = 0;      // counter of the first that is lost
  std::int64_t samples = 0;    // how many
  std::int64_t in_motion = 0;  // of them where the unit turned
  bool is_short() const { return samples <= most_filled_samples; }
};

// The first in [begin, end) that nothing goes over; null: none.
inline const SampleGap* long_gap_in(const std::vector<SampleGap>& gaps, std::int64_t begin, std::int64_t end) {
  for (const SampleGap& gap : gaps)
    if (!gap.is_short() && gap.first < end && gap.first + gap.samples > begin) return &gap;
  return nullptr;
}

inline std::string gap_words(const SampleGap& gap) {
  return std::to_string(gap.samples) + " samples lost from sample " + std::to_string(gap.first) + " on";
}

inline constexpr double motion_interval_s = 0.1;  // or a sample, where that is longer

// Parameters that follow the temperature (TemperaturePolynomials), and what the recording's was.
struct TemperatureCourse {
  TemperaturePolynomials polynomials;
  ParameterVector reference;
  RecordingInfo info;
  double lowest_c, highest_c;                             // of the samples
  float now_c = std::numeric_limits<float>::quiet_NaN();  // what the model is of
  bool leaves_range() const { return lowest_c < polynomials.low_c || highest_c > polynomials.high_c; }
};

// A parameter file made ready for the samples of a recording.
struct SampleCalibration {
  SensorModel model;
  EffectTerms effects;
  std::optional<TemperatureCourse> temperature = {};
  struct Increments {
    Eigen::Vector3d dtheta_rad, dv_mps;
  };
  //   dtheta = n counts_gyro - N0 dt,   dv = a counts_accel - A0 dt,   dt the sample period
  // Effects beyond the 24 parameters are taken off as the estimate modelled them. For samples in counter order.
  Increments of(const ImuSample& sample, double period_s);
  // Errors: the file, or that it is not of this unit and kind of increments. `path`: how the file is called. `recording`: of the source, where
  // it has been loaded.
  static Result<SampleCalibration> make(const ParameterFile& file, const std::string& path, RecordingSource& source,
                                        const CompressedRecording* recording = nullptr);
};

struct CalibratedIntervals {
  std::string path;  // of the parameter file
  ParameterFile file;
  SampleCalibration calibration;
  IncrementIntegrator integrator;
};

// Before any sample is read.
Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source);

struct Stretch {  // s from the first sample
  double from_s = 0.0;
  std::optional<double> to_s;  // default: the end
};
struct IntegratedSamples {
  std::int64_t first_sample = 0;  // counter of the first, where the first interval begins
  std::vector<SampleGap> gaps;
  std::vector<std::string> faults;  // what cannot be true, a line each
};
// Samples marked as bad count as lost, and so do those that cannot be true, by the same rules as in a calibration (compression.h,
// data_screen.h); an interval with a part of a long gap is not at rest. Without segments everything is at rest, but for what the reference
// says.
// Errors: also samples that are not finite, gyros or accelerometers that give nothing but zeros, and motion that nothing can make.
Result<IntegratedSamples> integrate_recording(RecordingSource& source, const Stretch& stretch,
                                              std::vector<CalibratedIntervals>& files,
                                              const ReferenceTrack* reference = nullptr);

// A recording with calibrated increments in place of those that the unit gave. Segments, counters, temperatures and flags stay. `source`
// outlives it.
class CalibratedSource : public RecordingSource {
 public:
  CalibratedSource(RecordingSource& source, SampleCalibration calibration);

 protected:
  Status stream(const Sink& sink) override;

 private:
  RecordingSource& source_;
  SampleCalibration calibration_;
};

}  // namespace turncal
