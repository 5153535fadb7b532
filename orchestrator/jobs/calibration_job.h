// Calibrates from recordings: one, or several of one unit, give a parameter file.
//
// Diagnoses them: verdict, report and files. This is the only place where a diagnosis is called, for `turncal diagnose` and at the end of
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

// Description of a recording turned by hand, which has no other mark (segmentation.h, without_table_angles).
inline constexpr const char* no_table_angles = "all table angles are 0, as of a unit turned by hand";

// A recording read once, from the start, into the sufficient statistics that calibration and diagnosis begin with.
struct LoadedRecording {
  std::string path;
  CompressedRecording data;
  RecordingDamage damage;
  std::string hash;                // of the contents (RecordingSource::content_hash)
  double recorded_s = 0.0;         // of all its segments
  bool by_hand = false;            // no table angles
  std::string dead_channel;        // data_screen.h
  std::vector<std::string> stuck;  // channels that stick at rest, a line each
  std::string segmented;           // how it was segmented; empty: it came with its own segments
};

// Finds the rests of data without a table (segmentation.h); an error when there are none.
Result<Segmentation> find_rests(RecordingSource& source, const SegmentationOptions& options = {});

// Loads a recording; one without segments is segmented by its rests. By default its blocks are those of hand-turned data where there are no
// table angles. `progress`, if given, gets the number of samples read so far; `blocks`: other block lengths; `before_step`: this and later steps
// are left out; 0: those of the north seeking of a complete run.
inline constexpr int all_steps = 1 << 30;
Result<LoadedRecording> load_recording(RecordingSource& source, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);
Result<LoadedRecording> load_recording(const std::string& path, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);

// Returns an error when the data cannot be calibrated: a dead channel, units that are plainly wrong, or less than one
// whole second at rest.
Status check_data(const LoadedRecording& loaded);

// The values of --method; the first is the default. joint: least squares over every static second, any sequence, with
// standard deviations. closed-form: the fourteen steps of Wang (2020).
inline constexpr const char* calibration_methods[] = {"joint", "closed-form"};

// The method for a recording without table angles, even when joint is asked for: its rests (calib/rests/rest_model.h).
inline constexpr const char* rest_method = "rests";

struct CalibrationRequest {
  std::string method = calibration_methods[0];
  std::string time_utc = {};  // for the record
  // Accepts parameters that the recording does not determine: `quality.undetermined`, and the file is not trusted.
  bool partial = false;
  bool test_fit = true;                  // run the lack-of-fit tests; false when a diagnosis follows, which runs them
  std::optional<Parameters> known = {};  // from another recording of the unit (several_recordings.h, estimate_beside)
};

struct CalibrationOutput {
  ParameterFile file;
  std::optional<double> mean_temperature_c;
  std::optional<double> min_temperature_c, max_temperature_c;  // over blocks of a few samples up to a second
  std::vector<std::string> notes;  // for the operator: defects of the data, course of the solution
  std::optional<JointResult> fit;  // joint estimate, from which a diagnosis begins
  std::string distrust;  // distrust_of(); with too little data to judge it may be empty for a file that is not trusted
};

// Adds record.measured_utc when the recording knows it and the file lacks it.
void add_measured_utc(const RecordingInfo& info, ParameterFile& file);

// Returns which parameters stay undetermined, and why; empty: none. `found`: a diagnosis of the same recordings, so that none is made here.
std::string what_is_open(std::span<const LoadedRecording> recordings, const JointResult& result,
                         const Diagnosis* found = nullptr);
// Returns the error for undetermined parameters. Its kind is that of the verdict not_tested, so that one outcome has one exit code.
Error not_determined(const std::string& what);

// Calibrates one recording. Errors: kind input when it cannot be calibrated; unit_failed when the solution does not converge, parameters stay
// undetermined, or the data are plainly wrong (check_data).
Result<CalibrationOutput> calibrate_recording(const LoadedRecording& recording, const CalibrationRequest& request);

// Calibrates one unit from several recordings (calib/joint/several_recordings.h): table data, one kind of increment, method joint.
Result<CalibrationOutput> calibrate_recordings(const std::vector<LoadedRecording>& recordings,
                                               const CalibrationRequest& request);

// Returns what speaks against the sigmas of a joint estimate; empty: nothing, or too little data. The lack-of-fit tests cost as much as the estimate.
std::string distrust_of(const CompressedRecording& recording, const JointResult& result, bool test_fit = true);

// Returns the statistics kept for the fleet: `output` is the joint estimate of all `recordings`. Empty without such an estimate.
std::optional<UnitStatistics> statistics_of(const std::vector<LoadedRecording>& recordings,
                                            const CalibrationOutput& output);

struct DiagnosisRequest {
  std::string time_utc = {};  // for the record
  std::span<const LoadedRecording> holdouts = {};
  std::optional<NoiseModel> noise = {};  // given, not measured
  const JointResult* base = nullptr;     // the joint estimate of this recording, if there is one already
  std::string samples = {};              // recording to navigate, the holdout if there is one; empty: none
  bool of_run = false;                   // the verdict on the unit is left to the run
  std::function<void(const std::string&)> phase = [](const std::string&) {};  // gets the name of each phase
};

struct DiagnosisOutput {
  Diagnosis diagnosis;
  DiagnosisFiles files;
};

// Diagnoses one recording, or several of one unit (calib/joint/several_recordings.h), which must then be table data.
// Errors: kind input for recordings that cannot be diagnosed (together), unit_failed when the base model does not converge.
Result<DiagnosisOutput> diagnose_recordings(std::span<const LoadedRecording> recordings,
                                            const DiagnosisRequest& request);

}  // namespace turncal
