// Applies a parameter file to a recording: the readings of its effects over each sample, samples calibrated by one or more files as intervals
// of motion (calib/navigation/mechanisation.h), and the uncertainty that the file states.
//
// The terms of effects are those of the estimate itself (calib/joint/joint_filter.h): constant over a block, one second at rest and at most
// 0.1 s in a turn, evaluated at the rate, specific force, temperature, time and attitude of the block. Time counts from the
// first sample of the recording at hand.
#pragma once

#include <algorithm>
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
  // Evaluates the effects over the blocks of `recording` or, without it, of the source, which is read once. An error when an effect is unknown,
  // needs a temperature that the recording lacks, or needs an attitude (Earth rate, magnetic field) without table angles.
  static Result<EffectTerms> of(const ParameterFile& file, const std::string& file_name, RecordingSource& source,
                                const CompressedRecording* recording);

  // Returns the terms of a sample; call it in counter order.
  struct Term {
    Eigen::Vector3d rate_radps = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();
  };
  const Term& at(std::int64_t counter);

 private:
  // Uses each block's own readings, because without segments the rests are unknown. Effects that follow a rotation are left out.
  Status of_motion_alone(RecordingSource& source, const ParameterFile& file, EffectModel model);

  std::vector<std::int64_t> starts_;
  std::vector<Term> terms_;
  std::size_t index_ = 0;
};

// Read the `noise.` keys; missing ones keep the value of NoiseModel, and the pulses are those of the increments. has_noise: whether the
// random walks are there.
bool has_noise(const ParameterFile& file);
Result<NoiseModel> stored_noise(const ParameterFile& file, const std::string& file_name);

// Returns the correlations of the `quality.covariance.` keys with the standard deviations `sigma.` (which can be wider than the covariance when
// the fit is not trusted); without those keys the standard deviations alone, and zero where there is none.
//
// For a file with effects it returns none: its sigmas are those of parameters and effects together, and without their correlations a bias and its
// own drift would count as two errors that never cancel.
struct StoredCovariance {
  ParameterCovariance covariance = ParameterCovariance::Zero();
  const char* source = "none";  // covariance, sigmas, none or effects
};
Result<StoredCovariance> stored_covariance(const ParameterFile& file, const std::string& file_name);

// Samples that a recording lost, or marked as bad, between two good ones.
//
// Short gaps of n samples are filled with the mean of their two neighbours. The error is n q / sqrt(12) from counting pulses q, and n N sqrt(dt / 2)
// from the random walk N. With a pulse of 0.93" two samples are off by 0.54", in 300 s of alignment 0.008 deg of heading, a quarter of what
// 0.002 deg/sqrt(h) leaves. It grows with n, and 5 s would give degrees. Nothing is aligned or navigated across a longer gap.
inline constexpr std::int64_t most_filled_samples = 2;

struct SampleGap {
  std::int64_t first = 0;      // counter of the first lost sample
  std::int64_t samples = 0;    // how many
  std::int64_t in_motion = 0;  // those in which the unit turned
  bool is_short() const { return samples <= most_filled_samples; }
};

// Returns the first long gap in [begin, end); null: none.
inline const SampleGap* long_gap_in(const std::vector<SampleGap>& gaps, std::int64_t begin, std::int64_t end) {
  for (const SampleGap& gap : gaps)
    if (!gap.is_short() && gap.first < end && gap.first + gap.samples > begin) return &gap;
  return nullptr;
}

inline std::string gap_words(const SampleGap& gap) {
  return std::to_string(gap.samples) + " samples lost from sample " + std::to_string(gap.first) + " on";
}

inline constexpr double motion_interval_s = 0.1;  // or one sample, if that is longer

// Parameters as functions of temperature (TemperaturePolynomials), and the recording's temperatures.
struct TemperatureCourse {
  TemperaturePolynomials polynomials;
  ParameterVector reference;
  RecordingInfo info;
  double lowest_c, highest_c;                             // of the samples
  float now_c = std::numeric_limits<float>::quiet_NaN();  // temperature of the model
  bool leaves_range() const { return lowest_c < polynomials.low_c || highest_c > polynomials.high_c; }
};

// "parameters at the temperature of each sample, 11.00 to 27.50 C", and whether that leaves their range.
std::string describe(const TemperatureCourse& course);
// "FILE: not trusted: WHY"; empty: it is trusted.
std::string distrust_of(const ParameterFile& file, const std::string& path);

// A parameter file prepared for the samples of a recording.
struct SampleCalibration {
  SensorModel model;
  EffectTerms effects;
  std::optional<TemperatureCourse> temperature = {};
  struct Increments {
    Eigen::Vector3d dtheta_rad, dv_mps;
  };
  //   dtheta = n counts_gyro - N0 dt,   dv = a counts_accel - A0 dt,   dt the sample period
  // Effects beyond the 24 parameters are subtracted as the estimate modelled them. Call it in counter order.
  Increments of(const ImuSample& sample, double period_s);
  // Prepares the file. Errors: in the file, or a file of another unit or kind of increments. `path`: the file's name. `recording`: of the source, if
  // it has been loaded.
  static Result<SampleCalibration> make(const ParameterFile& file, const std::string& path, RecordingSource& source,
                                        const CompressedRecording* recording = nullptr);
};

struct CalibratedIntervals {
  std::string path;  // parameter file
  ParameterFile file;
  SampleCalibration calibration;
  IncrementIntegrator integrator;
};

// Call it before any sample is read.
Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source);

// Tells whether the unit rests during a sample; call at() in counter order.
class RestOf {
 public:
  explicit RestOf(const Segments& segments) : segments_(segments) {}
  bool at(std::int64_t counter) {
    if (segments_.empty()) return true;
    while (index_ < segments_.size() && counter >= segments_[index_].end_sample) ++index_;
    return index_ < segments_.size() && counter >= segments_[index_].start_sample &&
           segments_[index_].kind != SegmentKind::rotate;
  }
  // Counts the samples of [begin, end) in motion; begin must not be before the last sample of at().
  std::int64_t moving_in(std::int64_t begin, std::int64_t end) const {
    if (segments_.empty()) return 0;
    std::int64_t resting = 0;
    for (std::size_t k = index_; k < segments_.size() && segments_[k].start_sample < end; ++k)
      if (segments_[k].kind != SegmentKind::rotate)
        resting += std::max<std::int64_t>(
            0, std::min(end, segments_[k].end_sample) - std::max(begin, segments_[k].start_sample));
    return end - begin - resting;
  }

 private:
  const Segments& segments_;
  std::size_t index_ = 0;
};

struct Stretch {  // seconds from the first sample
  double from_s = 0.0;
  std::optional<double> to_s;  // default: the end
};
struct IntegratedSamples {
  std::int64_t first_sample = 0;  // counter at which the first interval begins
  std::vector<SampleGap> gaps;
  std::vector<std::string> faults;  // impossible samples, a line each
};
// Integrates the samples. Samples marked as bad count as lost, and so do impossible ones, by the rules of a calibration (compression.h,
// data_screen.h); an interval with a part of a long gap is not at rest. Without segments everything is at rest, unless the reference
// says otherwise.
// Errors include samples that are not finite, gyros or accelerometers that give only zeros, and physically impossible motion.
Result<IntegratedSamples> integrate_recording(RecordingSource& source, const Stretch& stretch,
                                              std::vector<CalibratedIntervals>& files,
                                              const ReferenceTrack* reference = nullptr);

// A recording with calibrated increments in place of the unit's. Segments, counters, temperatures and flags stay. `source`
// must outlive it.
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
