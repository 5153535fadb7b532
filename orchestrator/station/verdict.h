// Judges a calibrated unit against its limits. The decision rule is that of ILAC-G8:09/2019, 4.2.3 (non-binary, with guard band):
//
//   U = 2 sigma, guard band w = guard_factor U, margin m = distance to the nearer limit, negative outside
//   pass m >= w | conditional pass 0 <= m < w | conditional fail -w <= m < 0 | fail m < -w
//
// Values without an uncertainty (sigma itself, the residual, temperatures) are judged with w = 0. The unit's clock is judged where a live
// run measured it. A parameter without a sigma passes conditionally at best; a missing value that has a limit fails. The unit's verdict is
// that of its worst value, or of its diagnosis where that is worse: a residual beyond the 24 parameters holds the unit. The rule, the reason
// and every judged value go into the parameter file (`verdict.*`).
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
inline constexpr NumberRange limit_range = between(1e-12, 1e9);  // for limits of a sigma or a residual

// Limits from the keys limit.* of the station file, in units of the parameter file.
struct VerdictLimits {
  std::array<Limit, parameter_count> parameter{};                  // limit.<key>.min, .max
  std::array<std::optional<double>, parameter_count> sigma_max{};  // limit.<key>.sigma_max
  std::optional<double> residual_max;                              // limit.residual_max, for quality.normalised_rms
  Limit temperature_c;        // limit.temperature_c.min, .max, for every second of the recording
  double guard_factor = 1.0;  // limit.guard_factor
  // Limits of a verification (docs/verification.md), not of a calibration.
  double heading_deg = 0.012;  // limit.heading_deg
  double level_deg = 0.012;    // limit.level_deg
  bool any() const;
};

VerdictLimits read_limits(KeyValueFile& file);

// Ordered from good to bad. hold: somebody has to decide; until then the unit's parameters are not put in use.
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

// How the station judges a diagnosis: keys diagnosis.extended = pass | hold | fail, diagnosis.parameters = base | extended.
struct DiagnosisPolicy {
  UnitVerdict extended = UnitVerdict::hold;  // verdict on a unit whose model was extended by an effect
  bool load_extended = true;                 // its parameter file is the one with the effects
};
DiagnosisPolicy read_diagnosis_policy(KeyValueFile& file);

struct VerdictReport {
  UnitVerdict verdict = UnitVerdict::not_judged;  // not_judged when there are no limits
  std::string rule;
  std::string reason;                  // one line: why it is not a plain pass
  std::string diagnosis = "not_made";  // the word of diagnosis.conf
  std::string verification;            // verdict and figures of the north seeking; empty: none was made
  std::vector<JudgedValue> values;     // those with a limit
};

std::optional<double> residual_of(const ParameterFile& file);  // empty: the estimation method gives none

// Returns the fields of a journal record; `values` is not among them.
Fields fields_of(VerdictReport& report);

// Judges one value by the rule above. Without a sigma its uncertainty is unknown.
UnitVerdict judge_value(double value, std::optional<double> sigma, const Limit& limit, double guard_factor);

// The error of the unit's clock against the station's, measured while the recording was made.
struct UnitClock {
  double ppm = 0.0;              // positive: the unit's clock is fast
  double uncertainty_ppm = 0.0;  // 1 sigma
  bool operator==(const UnitClock&) const = default;
};
struct ClockLimit {
  UnitClock clock;
  double max_ppm = 0.0;  // imu.clock_max_ppm
};

VerdictReport judge(const ParameterFile& file, const Limit& temperature_range_c, const VerdictLimits& limits,
                    const std::optional<ClockLimit>& clock = {});
// Applies the diagnosis to the verdict; clean and not_made change nothing. `finding`: what was found, in a few words.
// A file with unreliable sigmas is held, whatever they say; `distrust` says why, and is empty where they are reliable.
void judge_diagnosis(const std::string& diagnosis, const std::string& finding, const std::string& distrust,
                     const DiagnosisPolicy& policy, VerdictReport& report);
// Applies a north seeking to the verdict; `words`: its results and limits. `reason`: what of them the verdict does not say yet.
void judge_verification(UnitVerdict found, const std::string& words, const std::string& reason, VerdictReport& report);
void add_verdict(const VerdictReport& report, ParameterFile& file);
// Returns what add_verdict wrote for one key, without the value; empty when there is nothing, or not in that form.
std::optional<JudgedValue> recorded_judgement(const ParameterFile& file, const std::string& key);
// Returns what add_verdict wrote, with the parameters judged again by sigmas that include more than the estimate's own. The worse of both
// verdicts counts. `values`: those with a limit. An input error when a verdict.<parameter> is malformed.
Result<VerdictReport> judge_again(const ParameterFile& file, const std::array<double, parameter_count>& sigma);
// "gyro x bias (N01) 0.0634 deg/h, limits -0.3 .. 0.02, guard band 0.0041"
std::string judged_words(const JudgedValue& judged);
// "limits -0.01 .. 0.01", "at most 0.008"
std::string limits_words(const Limit& limit);
// Returns one line, as above and with ": fail" or another verdict, for each value that does not plainly pass.
std::vector<std::string> judged_lines(const VerdictReport& report);

// The accuracy that a unit has to reach before its run may end: `turncal run --until-sigma`.
//
// A parameter is known well enough when its standard deviation does not exceed the least of
//   stop.sigma.<key>        of the station file
//   limit.<key>.sigma_max   likewise
//   m / (2 guard_factor)    m: distance of the value from the nearer of limit.<key>.min, .max; the guard band then ends at that limit
// Units of the parameter file. A parameter that none of them names has no requirement.
using StopSigmas = std::array<std::optional<double>, parameter_count>;

// Keys stop.sigma.<key>, above zero.
StopSigmas read_stop_sigmas(KeyValueFile& file);

// Returns whether any requirement is given.
bool says_when(const StopSigmas& stop, const VerdictLimits& limits);

struct NeededSigma {
  std::size_t parameter = 0;  // parameter_keys[parameter]
  double sigma = 0.0;         // estimated
  double needed = 0.0;        // 0: no sigma is small enough, because the value lies beyond a limit
  double ratio() const;       // sigma / needed; infinite when no sigma is small enough
};

// Returns the needed sigmas of an estimate that has a sigma for every free parameter.
std::vector<NeededSigma> needed_sigmas(const ParameterFile& file, const StopSigmas& stop, const VerdictLimits& limits);

}  // namespace turncal
