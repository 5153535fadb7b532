// The parts of a diagnosis' document, each added to its end. Their order and their headings are diagnosis_document's (report.h).
#pragma once

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/document.h"

namespace turncal {

void add_identity(const DiagnosisContext& context, Document& document);  // unit, recording, when
void add_errors(const Diagnosis& diagnosis, const std::vector<ErrorRow>& rows, Document& document);
void add_effects(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
Table score_table(const Diagnosis& diagnosis, double threshold_z);      // one line an effect
Table component_table(const Diagnosis& diagnosis, double threshold_z);  // one line a component
void add_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
void add_noise(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
// Aliases, undetectable, undetermined, never visible.
void add_limits(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
void add_faults(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document);
void add_statements(const Statements& statements, Document& document);

}  // namespace turncal
