#include "calib/diagnosis/diagnosis.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/diagnosis/diagnosis_model.h"
#include "calib/diagnosis/effect_gate.h"
#include "calib/diagnosis/effect_selection.h"
#include "calib/diagnosis/holdout.h"

namespace turncal {
namespace {

void judge(DiagnosisModel& m, Diagnosis& d) {
  char text[256];
  const bool noise_given = m.options.estimate.noise.has_value();
  // Where even the noise does not fit, neither names nor patterns mean anything.
  if (!m.current.whiteness.white) {
    d.verdict = Verdict::noise_model;
    d.reason = m.current.whiteness.message + (noise_given ? " (the noise was given, not measured)" : "") +
               ": no claim on effects";
    m.chosen.clear();
    d.aliases.clear();
    d.separate_by.clear();
    d.unexplained_pattern.clear();
    m.current = d.base;
    d.holdout_after = d.holdout_before;
    return;
  }
  if (d.verdict == Verdict::unexplained) {
    d.reason = "a residual beyond noise that no catalogue effect explains; it looks like: " + d.unexplained_pattern;
    return;
  }
  if (m.chosen.empty()) {
    d.verdict = Verdict::clean;
    d.reason = d.gated_out.empty()
                   ? "the base model explains the data"
                   : "the base model explains the data; what was found on them did not help on held-out data";
    return;
  }
  d.verdict = Verdict::extended;
  std::snprintf(text, sizeof text, "held-out error %.4f before, %.4f after", d.holdout_before.normalised_rms,
                d.holdout_after.normalised_rms);
  d.reason = text;
}

void collect_residuals(const DiagnosisModel& m, Diagnosis& d) {
  FilterSetup setup = m.current.setup;
  setup.with_columns = false;
  setup.keep_innovations = true;
  const auto run = [&](const JointResult& r) {
    return run_filter(m.recording, r.parameters, effect_model_of(r, m.recording.info.latitude_deg), setup);
  };
  const FilterResult before = run(d.base);
  const FilterResult after = m.chosen.empty() ? before : run(m.current);
  const auto rms = [](const FilterResult& r) {
    return std::sqrt(r.chi_square / static_cast<double>(std::max<std::int64_t>(r.observations, 1)));
  };
  d.error_before = rms(before);
  d.error_after = rms(after);
  const SensorModel model = sensor_model(m.current.parameters, m.recording.info);
  double rotation_end = -1e9;
  std::size_t next = 0;
  for (std::size_t i = 0; i < before.innovations.size() && i < after.innovations.size(); ++i) {
    const Innovation& b = before.innovations[i];
    const Innovation& a = after.innovations[i];
    for (; next < b.block; ++next)
      if (m.recording.segments[m.recording.blocks[next].segment].kind == SegmentKind::rotate)
        rotation_end =
            static_cast<double>(m.recording.blocks[next].start_sample - m.recording.blocks.front().start_sample) *
                m.recording.info.sample_period_s +
            m.recording.blocks[next].duration_s;
    const Block& block = m.recording.blocks[b.block];
    d.residuals.push_back({b.block, block.segment, b.time_s, b.normalised, a.normalised, b.free_velocity_mps,
                           a.free_velocity_mps,
                           model.accel_scale * block.accel / block.duration_s - model.accel_bias_mps2,
                           block.temperature_c, b.time_s - rotation_end});
  }
}

std::vector<std::string> strongest_first(std::vector<EstimatedEffect> effects) {
  std::sort(effects.begin(), effects.end(), [](const EstimatedEffect& a, const EstimatedEffect& b) {
    return std::abs(a.value) * b.sigma > std::abs(b.value) * a.sigma;
  });
  std::vector<std::string> names;
  for (const EstimatedEffect& e : effects)
    if (std::find(names.begin(), names.end(), e.column.entry->name) == names.end())
      names.emplace_back(e.column.entry->name);
  return names;
}

}  // namespace
const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::clean: return "clean";
    case Verdict::extended: return "extended";
    case Verdict::unexplained: return "unexplained";
    case Verdict::noise_model: return "noise_model";
  }
  return "?";
}

Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options) {
  DiagnosisModel m(recording, options);
  Diagnosis d;
  d.base = options.base ? *options.base : joint_estimate(recording, m.estimate_options({}, nullptr));
  m.current = d.base;
  if (!d.base.converged) {
    d.reason = "the base model could not be fitted: " + d.base.message;
    d.extended = d.base;
    return d;
  }
  d.verdict = Verdict::clean;
  select_effects(m, d);
  if (!m.chosen.empty()) m.current = joint_estimate(recording, m.estimate_options(m.chosen, &m.current));
  gate_effects(m, d);
  judge(m, d);
  collect_residuals(m, d);
  d.effect_names = strongest_first(m.current.effects);
  d.extended = m.current;
  return d;
}

}  // namespace turncal
