// The document of a diagnosis (docs/report.md), read from the top: verdict, error before and after, residuals, scores, parameters, noise,
// limits, faults, selection.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/statistics/compression.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/report/document.h"

namespace turncal {

// Drift of free inertial navigation that the added effects remove, nautical miles per hour, rms over branches.
struct NavigationWorth {
  std::string source;  // which data: "second recording", "fitted recording"
  std::size_t branches = 0;
  double free_s = 0.0;                                  // of the first branch
  double before = 0.0, after = 0.0;                     // the 24 parameters alone; with the effects
  double noise = 0.0;                                   // what noise alone would give
  std::vector<std::pair<std::string, double>> effects;  // of each: drift of the track when it is left out
};

// One of several recordings of a unit.
struct SwitchOn {
  std::string hash;
  std::optional<std::int64_t> started_utc_s;  // where it says so
};

struct DiagnosisContext {
  explicit DiagnosisContext(const CompressedRecording& fitted) : recording(fitted) {}
  const CompressedRecording& recording;  // the one that was fitted, or several joined
  std::string recording_path;
  std::string recording_hash;         // of several: of the first
  std::vector<SwitchOn> switched_on;  // all
  std::string holdout_path;           // empty: none
  std::string time_utc;
  double false_alarm = 0.005;  // family-wise, as asked of diagnose()
  bool noise_given = false;    // configured, not fitted
  std::string method = "joint";
  bool of_run = false;       // made at the end of a run, which says the verdict on the unit itself
  bool hand_turned = false;  // no table angles: rests and rotations by hand
  std::optional<NavigationWorth> worth;
  std::vector<std::string> notes;  // on the data: damage, lost samples
};

inline constexpr std::size_t diagnosis_lines = 30;  // at most, on the terminal

std::string verdict_title(Verdict verdict);
// The same two lines on terminal, page and in JSON: verdict with trust, and the reason in a few words.
Facts verdict_facts(const std::string& verdict, const std::string& why_not_trusted, const std::string& reason);
std::string brief_reason(const Diagnosis& diagnosis);
// One sentence with numbers.
std::string verdict_sentence(const Diagnosis& diagnosis);

// One line of the table "error before and after". NaN: not known.
struct ErrorRow {
  std::string what;
  double before = 0.0, after = 0.0;
  std::string unit;  // as the catalogue writes it; of the normalised ones what 1 is
  bool normalised = false;
};
std::vector<ErrorRow> error_rows(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string error_text(const ErrorRow& row, double value);

// Change that the effects made to each parameter, in sigma of the extended model; NaN where it is not determined.
ParameterVector changes_in_sigma(const Diagnosis& diagnosis);

// What the terminal has in the place of the tables of the page.
Facts diagnosis_facts(const Diagnosis& diagnosis, const DiagnosisContext& context, const std::string& noise);
std::string noise_line(const JointResult& estimate, bool given);

// "one effect beyond the 24 parameters was found and added: ..." and "; this recording cannot tell ... from ...".
std::string effects_clause(const Diagnosis& diagnosis);
std::string alias_clause(const Diagnosis& diagnosis);

// What was diagnosed, and the verdict: all there is where nothing could be fitted. sentence: the verdict with numbers.
Document begin_document(const Diagnosis& diagnosis, const DiagnosisContext& context, const std::string& sentence);
Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context);
// How the verification of a run ended, below the verdict.
void say_verification(const std::string& words, Document& document);
// What a run added to settle a doubt, and the outcome: beside the verdict everywhere.
void say_settled(const std::string& words, Document& document);

// What differs between the report of a table's recording and of hand-turned data (rest_as_diagnosis.cpp).
struct DiagnosisParts {
  std::string sentence, statement;  // the verdict
  std::vector<ErrorRow> errors;
  std::string time_title, no_time;
  Figure time;
  std::vector<DwellResidual> residuals;  // one a dwell or rest
  std::string one_point;  // caption of the effects' figures: of gyros, of accelerometers; empty: their own
  std::string one_point_accel;
  std::string nothing_shown;  // instead of an effect's figure
  std::string residual_intro;
  std::string not_scored;  // why there are no scores; empty: there are
  std::string score_caption;
  std::string noise_line;       // of the terminal
  Document noise;               // blocks of its section
  std::string_view reading;     // how to read it: a label and words each line
  std::vector<Figure> further;  // after the noise
};
Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context, DiagnosisParts parts);

}  // namespace turncal
