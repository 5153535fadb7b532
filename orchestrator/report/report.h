// The document of a diagnosis (docs/report.md), read from the top: verdict, error before and after, residuals, scores, parameters, noise,
// limits, faults, selection.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/report/diagnosis_text.h"

namespace turncal {

Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context);
// How the verification of a run ended, below the verdict.
void say_verification(const std::string& words, Document& document);

// What is said differently of a table's recording and of hand-turned data (rest_as_diagnosis.cpp).
struct DiagnosisParts {
  std::string sentence, reason;  // the verdict
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
  std::string noise_line;             // of the terminal
  Document noise, limits, selection;  // blocks of these sections
  std::string_view reading;           // how to read it: a label and words each line
  std::vector<Figure> further;        // after the noise
};
Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context, DiagnosisParts parts);

// Of the sections `limits` (aliases, undetectable, undetermined, never visible) and `selection`.
void add_limits(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
void add_statements(const Statements& statements, Document& document);

}  // namespace turncal
