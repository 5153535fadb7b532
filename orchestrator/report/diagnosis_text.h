// A diagnosis in words: the verdict in one sentence, the errors, and what the terminal has of the rest.
#pragma once

#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/report/document.h"

namespace turncal {

inline constexpr std::size_t diagnosis_lines = 30;  // at most, on the terminal

std::string verdict_title(Verdict verdict);
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

// The components of an effect that were estimated.
std::vector<const EstimatedEffect*> components_of(const JointResult& result, std::string_view effect);

// What the terminal has in the place of the tables of the page.
Facts diagnosis_facts(const Diagnosis& diagnosis, const DiagnosisContext& context, const std::string& noise);
std::string noise_line(const JointResult& estimate, bool given);

// "one effect beyond the 24 parameters was found and added: ..." and "; this recording cannot tell ... from ...".
std::string effects_clause(const Diagnosis& diagnosis);
std::string alias_clause(const Diagnosis& diagnosis);

}  // namespace turncal
