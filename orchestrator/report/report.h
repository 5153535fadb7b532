// The document of a diagnosis (docs/report.md), in this order: verdict, error before and after, residuals, scores, parameters, noise,
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

// Drift of free inertial navigation with and without the added effects, nautical miles per hour, rms over branches.
struct NavigationWorth {
  std::string source;  // which data: "second recording", "fitted recording"
  std::size_t branches = 0;
  double free_s = 0.0;                                  // of the first branch
  double before = 0.0, after = 0.0;                     // the 24 parameters alone; with the effects
  double noise = 0.0;                                   // drift from noise alone
  std::vector<std::pair<std::string, double>> effects;  // drift of the track without each effect
};

// One of several recordings of a unit.
struct SwitchOn {
  std::string hash;
  std::optional<std::int64_t> started_utc_s;  // if the recording has it
};

struct DiagnosisContext {
  explicit DiagnosisContext(const CompressedRecording& fitted) : recording(fitted) {}
  const CompressedRecording& recording;  // the fitted one, or several joined
  std::string recording_path;
  std::string recording_hash;         // of the first, if there are several
  std::vector<SwitchOn> switched_on;  // all
  std::string holdout_path;           // empty: none
  std::string time_utc;
  bool noise_given = false;  // configured, not fitted
  std::string method = "joint";
  bool of_run = false;       // made at the end of a run, which gives the unit's verdict itself
  bool hand_turned = false;  // no table angles: rests and rotations by hand
  std::optional<NavigationWorth> worth;
  std::vector<std::string> notes;  // about the data: damage, lost samples
};

inline constexpr std::size_t diagnosis_lines = 30;  // upper limit on the terminal

std::string verdict_title(std::string_view word);  // of a file: "Noise model"
// Returns the two lines that terminal, page and JSON share: verdict with trust, and the reason in a few words.
Facts verdict_facts(const std::string& verdict, bool trusted, const std::string& reason);
std::string brief_reason(const Diagnosis& diagnosis);
// Returns the verdict as one sentence with numbers.
std::string verdict_sentence(const Diagnosis& diagnosis);

// One line of the table "error before and after". NaN: not known.
struct ErrorRow {
  std::string what;
  double before = 0.0, after = 0.0;
  std::string unit;  // as in the catalogue; for normalised errors what 1 means
  bool normalised = false;
};
std::vector<ErrorRow> error_rows(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string error_text(const ErrorRow& row, double value);

// Returns the change of each parameter due to the effects, in sigma of the extended model; NaN when undetermined.
ParameterVector changes_in_sigma(const Diagnosis& diagnosis);

// Returns what the terminal shows in place of the page's tables.
Facts diagnosis_facts(const Diagnosis& diagnosis, const std::string& noise);
std::string noise_line(const JointResult& estimate, bool given);

// Return "one effect beyond the 24 parameters was found and added: ..." and "; this recording cannot tell ... from ...".
std::string effects_clause(const Diagnosis& diagnosis);
std::string alias_clause(const Diagnosis& diagnosis);

// Begins a document with the subject and the verdict, which is everything when nothing could be fitted. sentence: the verdict with numbers.
Document begin_document(const Diagnosis& diagnosis, const DiagnosisContext& context, const std::string& sentence);
Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context);
// Adds the outcome of a run's verification below the verdict.
void say_verification(const std::string& words, Document& document);
// Adds the legs that a run added to settle a doubt, and the outcome, beside the verdict.
void say_settled(const std::string& words, Document& document);

// The parts in which the reports of a table's recording and of hand-turned data differ (rest_as_diagnosis.cpp).
struct DiagnosisParts {
  std::string sentence, statement;  // the verdict
  std::vector<ErrorRow> errors;
  std::string time_title, no_time;
  Figure time;
  std::vector<DwellResidual> residuals;  // one for each dwell or rest
  std::string one_point;  // caption of the effects' figures, for gyros and for accelerometers; empty: the default
  std::string one_point_accel;
  std::string nothing_shown;  // instead of an effect's figure
  std::string residual_intro;
  std::string not_scored;  // why there are no scores; empty: there are some
  std::string score_caption;
  std::string noise_line;       // for the terminal
  Document noise;               // blocks of the noise section
  std::string_view reading;     // how to read the report: a label and words in each line
  std::vector<Figure> further;  // after the noise
};
Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context, DiagnosisParts parts);

}  // namespace turncal
