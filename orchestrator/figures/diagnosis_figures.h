// The report's figures that every diagnosis has: residual velocity against time, Allan deviation.
#pragma once

#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/report_figure.h"

namespace turncal {

// Effects were added: two curves, before and after; else one.
bool has_after(const Diagnosis& diagnosis);
// One series or two, without points: residual, or before and after.
std::vector<Series> before_after_series(bool with_after);

Figure time_figure(const Diagnosis& diagnosis);
// On every axis of time ("time, h", "time, min") where the steps of the sequence begin.
void mark_steps(const CompressedRecording& recording, Figure& figure);
Figure allan_figure(const AllanResult& allan);

}  // namespace turncal
