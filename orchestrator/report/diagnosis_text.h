// A diagnosis in words: the verdict in one sentence, and the table for the terminal (at most 30 lines of 100 columns).
#pragma once

#include <string>
#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {

inline constexpr std::size_t table_lines = 30;
inline constexpr std::size_t table_columns = 100;

std::string verdict_title(Verdict verdict);
// One sentence with numbers.
std::string verdict_sentence(const Diagnosis& diagnosis, const DiagnosisContext& context, Alphabet alphabet);

// One line of the table "error before and after". NaN: not known.
struct ErrorRow {
  std::string what;
  double before = 0.0, after = 0.0;
  std::string unit;  // plain alphabet; of the normalised ones what 1 is
  bool normalised = false;
};
std::vector<ErrorRow> error_rows(const Diagnosis& diagnosis, const DiagnosisContext& context);
// What each effect is worth in free navigation, as a sentence; empty: not known.
std::string worth_sentence(const DiagnosisContext& context);
std::string error_text(const ErrorRow& row, double value);
// Share of the energy beyond noise: (chi-square - observations) / observations, not below 0.
double excess_energy(const HoldoutError& error);

// Change that the effects made to each parameter, in sigma of the extended model; NaN where it is not determined.
ParameterVector changes_in_sigma(const Diagnosis& diagnosis);

// The strongest of the scores.
const CandidateScore* strongest_candidate(const Diagnosis& diagnosis);

// What is said differently of a table's recording and of a hand-turned one (rest_as_diagnosis.h).
struct DiagnosisWords {
  std::string sentence;  // the verdict
  std::vector<ErrorRow> errors;
  std::string noise;
};
std::vector<std::string> terminal_table(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::vector<std::string> terminal_table(const Diagnosis& diagnosis, const DiagnosisContext& context,
                                        const DiagnosisWords& words);

// "one effect beyond the 24 parameters was found and added: ..." and "; this recording cannot tell ... from ...".
std::string effects_clause(const Diagnosis& diagnosis, Alphabet alphabet);
std::string alias_clause(const Diagnosis& diagnosis);

}  // namespace turncal
