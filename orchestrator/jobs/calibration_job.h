// From a recording to a parameter file: the estimate of one, or of several of one unit.
//
// And to verdict, report and files of a diagnosis: the one place where a diagnosis is called, by `turncal diagnose` and at the end of
// every run.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/fleet/unit_statistics.h"
#include "calib/joint/joint_estimate.h"
#include "calib/statistics/compression.h"
#include "calib/statistics/segmentation.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {

// What is said of a recording turned by hand, which has no other mark (segmentation.h, without_table_angles).
inline constexpr const char* no_table_angles = "all table angles are 0, as of a unit turned by hand";

// A recording read once, from its beginning, into the sufficient statistics that calibration and diagnosis both start from.
struct LoadedRecording {
  std::string path;
  CompressedRecording data;
  RecordingDamage damage;
  std::string hash;          // of the contents (RecordingSource::content_hash)
  double recorded_s = 0.0;   // of all its segments
  bool by_hand = false;      // no table angles
  std::string dead_channel;  // data_screen.h
  std::string segmented;     // how, where it came without segments; empty: it came with its own
};

// The rests of data without a table (segmentation.h); an error where there are none.
Result<Segmentation> find_rests(RecordingSource& source, const SegmentationOptions& options = {});

// A recording without segments is segmented by its rests. Blocks as short as the recording needs: those of rests found by hand where it has
// no table angles. `progress`, if given, is told the number of samples read so far; `blocks`: others; `before_step`: what later steps
// recorded is left out (0: nothing is).
Result<LoadedRecording> load_recording(RecordingSource& source, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);
Result<LoadedRecording> load_recording(const std::string& path, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);

// An error when there is nothing to calibrate from: a channel that does not live, units that are
// plainly wrong, not one whole second at rest.
Status check_data(const LoadedRecording& loaded);

// What --method may be; the first one is the default. joint: least squares over every static second, any sequence, with
// standard deviations. closed-form: the fourteen steps of Wang (2020).
inline constexpr const char* calibration_methods[] = {"joint", "closed-form"};

// What a recording without table angles is calibrated by, whatever joint asks for: its rests (calib/rests/rest_model.h).
inline constexpr const char* rest_method = "rests";

struct CalibrationRequest {
  std::string method = calibration_methods[0];
  std::string time_utc = {};  // for the record
  // Accept parameters that the recording does not determine: `quality.undetermined`, and the file is not trusted.
  bool partial = false;
  bool test_fit = true;                  // by the lack-of-fit tests; false where a diagnosis follows, which makes them
  std::optional<Parameters> known = {};  // from another recording of the unit (several_recordings.h, estimate_beside)
};

struct CalibrationOutput {
  ParameterFile file;
  std::optional<double> mean_temperature_c;
  std::optional<double> min_temperature_c, max_temperature_c;  // of the blocks of a few samples up to a second
  std::vector<std::string> notes;  // for the operator: what the data lacked, how the solution went
  std::optional<JointResult> fit;  // of the joint estimate: what a diagnosis begins with
  std::string distrust;  // distrust_of(); the file is not trusted without it where there is too little to judge
};

// record.measured_utc, where the recording says it and the file does not.
void add_measured_utc(const RecordingInfo& info, ParameterFile& file);

// Parameters stay open: of the kind of the verdict not_tested, so that one outcome has one exit code.
Error not_determined(const std::string& what);

// Errors: kind input for a recording that cannot be calibrated, unit_failed when the solution does not settle, leaves parameters open,
// or the data are plainly wrong (check_data).
Result<CalibrationOutput> calibrate_recording(const LoadedRecording& recording, const CalibrationRequest& request);

// One unit in several recordings (calib/joint/several_recordings.h): table data of one unit and one kind of increment, method joint.
Result<CalibrationOutput> calibrate_recordings(const std::vector<LoadedRecording>& recordings,
                                               const CalibrationRequest& request);

// What speaks against the sigmas of a joint estimate; empty: nothing, or too little to judge by. The lack-of-fit tests take as long as the estimate.
std::string distrust_of(const CompressedRecording& recording, const JointResult& result, bool test_fit = true);

// What they leave for the fleet: all recordings of `output`, the joint estimate of them. Nothing without such an estimate.
std::optional<UnitStatistics> statistics_of(const std::vector<LoadedRecording>& recordings,
                                            const CalibrationOutput& output);

struct DiagnosisRequest {
  std::string time_utc = {};  // for the record
  std::span<const LoadedRecording> holdouts = {};
  std::optional<NoiseModel> noise = {};  // given, not measured
  const JointResult* base = nullptr;     // the joint estimate of this recording, where there is one already
  std::string samples = {};  // path of what is navigated for it, of the holdout where there is one; empty: nothing is
  bool of_run = false;       // the verdict on the unit is the run's to say
  std::function<void(const std::string&)> phase = [](const std::string&) {};  // told what is going on
};

struct DiagnosisOutput {
  Diagnosis diagnosis;
  DiagnosisFiles files;
};

// Of one recording, or of several of one unit (calib/joint/several_recordings.h), which are of a table then.
// Errors: kind input for recordings that cannot be diagnosed (together), unit_failed when the base model does not settle.
Result<DiagnosisOutput> diagnose_recordings(std::span<const LoadedRecording> recordings,
                                            const DiagnosisRequest& request);

}  // namespace turncal
