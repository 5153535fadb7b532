// Does a calibrated unit keep its limits? The decision rule is that of ILAC-G8:09/2019, 4.2.3 (non-binary, with guard band):
//
//   U = 2 sigma, guard band w = guard_factor U, margin m = distance to the nearer limit, negative outside
//   pass m >= w | conditional pass 0 <= m < w | conditional fail -w <= m < 0 | fail m < -w
//
// What has no uncertainty (sigma itself, the residual, temperatures) is judged with w = 0. The unit's clock is judged where a live run
// measured it. A parameter without a sigma can at best pass conditionally, and a value that a limit asks for and that is missing fails. A
// unit's verdict is that of its worst value, or of its diagnosis where that is worse: a residual beyond the 24 parameters holds the unit
// back. The rule, the reason and every judged value go into the parameter file (`verdict.*`).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/model/parameters.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/station/fields.h"

namespace turncal {

struct Limit {
  std::optional<double> min, max;
};
inline constexpr NumberRange limit_range = between(1e-12, 1e9);  // of a sigma or a residual

// Of the station file's keys limit.*; units of the parameter file.
struct VerdictLimits {
  std::array<Limit, parameter_count> parameter{};                  // limit.<key>.min, .max
  std::array<std::optional<double>, parameter_count> sigma_max{};  // limit.<key>.sigma_max
  std::optional<double> residual_max;                              // limit.residual_max, of quality.normalised_rms
  Limit temperature_c;        // limit.temperature_c.min, .max: every second of the recording
  double guard_factor = 1.0;  // limit.guard_factor
  // Of a verification (docs/verification.md), not of a calibration.
  double heading_deg = 0.012;  // limit.heading_deg
  double level_deg = 0.012;    // limit.level_deg
  bool any() const;
};

VerdictLimits read_limits(KeyValueFile& file);

// From good to bad. hold: somebody has to decide; until then its parameters are not put in use.
enum class UnitVerdict { not_judged, pass, conditional_pass, hold, conditional_fail, fail };
template <>
inline constexpr auto enum_words<UnitVerdict> = std::to_array({"not_judged", "pass", "conditional_pass", "hold",
                                                               "conditional_fail", "fail"});
Field verdict_field(const std::string& key, UnitVerdict& verdict);
constexpr bool is_accepted(UnitVerdict verdict) { return verdict <= UnitVerdict::conditional_pass; }

struct JudgedValue {
  std::string key;  // "N01", "sigma.N01", "residual", "temperature_c.min"
  std::optional<double> value;
  Limit limit;
  double guard_band = 0.0;
  UnitVerdict verdict = UnitVerdict::not_judged;
};

// What the station makes of a diagnosis: keys diagnosis.extended = pass | hold | fail, diagnosis.parameters = base | extended.
struct DiagnosisPolicy {
  UnitVerdict extended = UnitVerdict::hold;  // of a unit in which an effect was found and added
  bool load_extended = true;                 // its parameter file is the one with the effects
};
DiagnosisPolicy read_diagnosis_policy(KeyValueFile& file);

struct VerdictReport {
  UnitVerdict verdict = UnitVerdict::not_judged;  // not judged: there are no limits
  std::string rule;
  std::string reason;                  // one line: why it is not a plain pass
  std::string diagnosis = "not_made";  // the word of diagnosis.conf
  std::string verification;            // of a north seeking: its verdict and figures; empty: not made
  std::vector<JudgedValue> values;     // those with a limit
};

std::optional<double> residual_of(const ParameterFile& file);  // empty: the method tells none

// As a record of the journal has it; the values are not in it.
Fields fields_of(VerdictReport& report);

// One value by the rule above. No sigma: nothing is known of its uncertainty.
UnitVerdict judge_value(double value, std::optional<double> sigma, const Limit& limit, double guard_factor);

// The unit's clock against the station's, as it was measured while the recording was made.
struct UnitClock {
  double ppm = 0.0;              // positive: the unit's is fast
  double uncertainty_ppm = 0.0;  // 1 sigma
  bool operator==(const UnitClock&) const = default;
};
struct ClockLimit {
  UnitClock clock;
  double max_ppm = 0.0;  // imu.clock_max_ppm
};

VerdictReport judge(const ParameterFile& file, const Limit& temperature_range_c, const VerdictLimits& limits,
                    const std::optional<ClockLimit>& clock = {});
// Takes the diagnosis into the verdict. clean and not_made change nothing; `finding`: what was found, in a few words.
// A file whose sigmas cannot be believed is held, whatever they say; `distrust` is why, empty where they can be.
void judge_diagnosis(const std::string& diagnosis, const std::string& finding, const std::string& distrust,
                     const DiagnosisPolicy& policy, VerdictReport& report);
// Takes a north seeking into the verdict; `figures`: what was found and the limits, in a few words.
void judge_verification(UnitVerdict found, const std::string& figures, VerdictReport& report);
void add_verdict(const VerdictReport& report, ParameterFile& file);
// What add_verdict wrote of one key, without the value; empty: nothing, or not in its form.
std::optional<JudgedValue> recorded_judgement(const ParameterFile& file, const std::string& key);
// What add_verdict wrote, with the parameters judged again by these sigmas, which hold more than the estimate's own; the worse of both
// counts. `values`: those with a limit. An input error where a verdict.<parameter> is not of its form.
Result<VerdictReport> judge_again(const ParameterFile& file, const std::array<double, parameter_count>& sigma);
// "gyro x bias (N01) 0.0634 deg/h, limits -0.3 .. 0.02, guard band 0.0041"
std::string judged_words(const JudgedValue& judged);
// "limits -0.01 .. 0.01", "at most 0.008"
std::string limits_words(const Limit& limit);
// The same with ": fail" or another verdict, a line for each value that does not plainly pass.
std::vector<std::string> judged_lines(const VerdictReport& report);

// How well a unit has to be known before its run may end: `turncal run --until-sigma`.
//
// A parameter is known well enough when its standard deviation is not above the least of
//   stop.sigma.<key>        of the station file
//   limit.<key>.sigma_max   the same
//   m / (2 guard_factor)    m: distance of the value from the nearer of limit.<key>.min, .max; there the guard band ends
// Units of the parameter file. Parameters that none of them names are free to be anything.
using StopSigmas = std::array<std::optional<double>, parameter_count>;

// Keys stop.sigma.<key>, above zero.
StopSigmas read_stop_sigmas(KeyValueFile& file);

// Whether anything says when it is enough.
bool says_when(const StopSigmas& stop, const VerdictLimits& limits);

struct NeededSigma {
  std::size_t parameter = 0;  // parameter_keys[parameter]
  double sigma = 0.0;         // as estimated
  double needed = 0.0;        // 0: no sigma is small enough, its value lies beyond a limit
  double ratio() const;       // sigma / needed; infinite where nothing is enough
};

// Of an estimate with a sigma for every free parameter.
std::vector<NeededSigma> needed_sigmas(const ParameterFile& file, const StopSigmas& stop, const VerdictLimits& limits);

}  // namespace turncal
