// The tables and lists of the report, each a piece of HTML. Headings and figures are report.cpp's.
#pragma once

#include <string>

#include "calib/diagnosis/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/report/diagnosis_text.h"

namespace turncal {

std::string html_identity(const DiagnosisContext& context);  // unit, recording, when
std::string html_verdict(const Diagnosis& diagnosis, const std::string& sentence, const std::string& reason);
std::string html_errors(const Diagnosis& diagnosis, const std::vector<ErrorRow>& rows);
std::string html_added_effects(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string html_scores(const Diagnosis& diagnosis, double threshold_z);      // one line an effect
std::string html_components(const Diagnosis& diagnosis, double threshold_z);  // one line a component, for the appendix
std::string html_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string html_noise(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string html_limits(const Diagnosis& diagnosis,
                        const DiagnosisContext& context);  // aliases, undetectable, undetermined, never visible
std::string html_faults(const Diagnosis& diagnosis, const DiagnosisContext& context);
std::string html_selection(const Diagnosis& diagnosis);

}  // namespace turncal
