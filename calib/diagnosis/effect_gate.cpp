#include "calib/diagnosis/effect_gate.h"

#include <algorithm>
#include <optional>

#include "calib/diagnosis/holdout.h"

namespace turncal {

namespace {

// The held-out data, in the order in which they are asked: holdout recordings, fitted ones left out in turn, dwells left out in turn.
class Gate {
 public:
  explicit Gate(const DiagnosisModel& m) : m_(m) {
    if (!m.options.holdouts.empty()) asked_.push_back(HoldoutGate::holdouts(m.options.holdouts));
    if (m.recordings.parts.size() > 1) asked_.push_back(HoldoutGate::recordings_in_turn(m.recordings, refit()));
    if (asked_.empty()) asked_.push_back(dwells());
  }
  const HoldoutGate& first() const { return asked_.front(); }
  HoldoutGain on_first(const JointResult& with, const JointResult& without) const {
    return gain_on(first(), with, without);
  }
  // Both are measured with the noise of `with`. Of an effect of one run another recording promises nothing that it could contradict.
  bool confirms(const JointResult& with, const JointResult& without, bool of_one_run) {
    const GateLimits& limits = m_.options.limits.gate;
    HoldoutGain gain;
    for (const HoldoutGate& gate : asked_) {
      const HoldoutGain on_it = gain_on(gate, with, without);
      if (!of_one_run && on_it.contradicted(limits.contradiction)) return false;
      gain += on_it;
    }
    if (gain.confirmed(limits.standard_errors)) return true;
    const bool other_recordings = !m_.options.holdouts.empty() || m_.recordings.parts.size() > 1;
    if (!other_recordings || gain.expected >= limits.expected_gain) return false;
    if (!left_out_) left_out_.emplace(dwells());
    gain += gain_on(*left_out_, with, without);
    return gain.confirmed(limits.standard_errors);
  }

 private:
  static HoldoutGain gain_on(const HoldoutGate& data, const JointResult& with, const JointResult& without) {
    return holdout_gain(data.error(without, with.noise), data.error(with));
  }
  HoldoutGate dwells() const { return HoldoutGate::dwells_in_turn(m_.recording, refit()); }
  HoldoutGate::Refit refit() const {
    return [this](const JointResult& from, const std::vector<char>& unobserved) {
      JointOptions o = m_.estimate_options(columns_beyond_base(from), &from);
      o.unobserved = unobserved;
      o.noise = m_.current.noise;
      o.faults_of = &from;
      // A quarter of the dwells moves no parameter by more than a few sigma: the problem is linear there.
      o.one_step = true;
      return joint_estimate(m_.recording, o);
    };
  }

  const DiagnosisModel& m_;
  std::vector<HoldoutGate> asked_;
  std::optional<HoldoutGate> left_out_;
};

// Was the effect of `name` found by chance? What it gained in the fit and what it loses on a second recording are 2 ln L of independent
// data: both together must exceed what the fit alone had to.
bool outweighed(const DiagnosisModel& m, const Diagnosis& d, const std::string& name, const HoldoutGain& held_out) {
  if (m.options.holdouts.empty()) return false;  // left-out dwells are part of the fit
  double beyond = held_out.gain;
  for (const SelectionStage& stage : d.stages)
    if (stage.accepted && stage.chosen.entry->name == name) beyond += stage.gain - stage.threshold;
  return beyond < 0.0;
}

// The effect of `name` did not help on held-out data; does another of its alias class, in its place?
bool replaced_by_rival(DiagnosisModel& m, Diagnosis& d, const std::string& name, const JointResult& without,
                       Gate& gate) {
  for (SelectionStage& stage : d.stages) {
    if (!stage.accepted || stage.chosen.entry->name != name) continue;
    for (const EffectColumn& rival : stage.rival_columns) {
      const std::string rival_name(rival.entry->name);
      if (std::find(d.gated_out.begin(), d.gated_out.end(), rival_name) != d.gated_out.end()) continue;
      if (m.has_chosen(rival)) continue;
      std::vector<EffectColumn> model = m.chosen_without(name);
      model.push_back(rival);
      JointResult other = m.fit(model, m.current);
      if (!gate.confirms(other, without, rival.entry->of_one_run)) continue;
      std::vector<std::string> names = d.aliases[name];
      std::replace(names.begin(), names.end(), rival_name, name);
      d.aliases.erase(name);
      d.aliases[rival_name] = names;
      d.separate_by[rival_name] = d.separate_by[name];
      d.separate_by.erase(name);
      stage.note += "; held-out data prefer " + rival.key() + " of the same alias class";
      m.chosen = model;
      m.current = std::move(other);
      return true;
    }
  }
  return false;
}

}  // namespace

void gate_effects(DiagnosisModel& m, Diagnosis& d) {
  Gate gate(m);
  d.holdout_source = gate.first().source();
  for (bool changed = true; changed && !m.chosen.empty();) {
    changed = false;
    for (const std::string& name : names_of(m.chosen)) {
      const std::vector<EffectColumn> without = m.chosen_without(name);
      // Judged at the noise of m.current, so it is fitted at that, too.
      JointOptions at_noise = m.estimate_options(without, &m.current);
      at_noise.noise = m.current.noise;
      at_noise.faults_of = &m.current;
      const JointResult reduced = without.empty() ? d.base : joint_estimate(m.recording, at_noise);
      const bool of_one_run = std::any_of(m.chosen.begin(), m.chosen.end(), [&](const EffectColumn& c) {
        return c.entry->name == name && c.entry->of_one_run;
      });
      if (gate.confirms(m.current, reduced, of_one_run)) continue;
      changed = true;
      if (replaced_by_rival(m, d, name, reduced, gate)) break;
      // Claimed or not, what it would do to the parameters goes into their sigmas.
      m.beside.push_back(m.current.parameters);
      if (!outweighed(m, d, name, gate.on_first(m.current, reduced))) d.gated_out.push_back(name);
      d.aliases.erase(name);
      d.separate_by.erase(name);
      m.chosen = without;
      m.current = m.fit(m.chosen, d.base);
      break;
    }
  }
  d.holdout_before = gate.first().error(d.base, m.current.noise);
  d.holdout_after = m.chosen.empty() ? d.holdout_before : gate.first().error(m.current);
}

}  // namespace turncal
