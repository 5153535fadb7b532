// What the parts of a diagnosis of rests share: the data, what is still in question, the model so far, and fits beside it.
// Used by rest_diagnosis.cpp only; see rest_diagnosis.h for the method.
#pragma once

#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "calib/rest_diagnosis/rest_diagnosis.h"
#include "calib/rest_diagnosis/rest_selection.h"

namespace turncal {

// Effects with one physical cause, "time" or "temperature": found on one triad, they are looked for on the other. Else empty.
std::string_view cause_of(const EffectEntry& entry);

struct RestModelFit {
  std::vector<EffectColumn> columns;
  RestFit fit;
};

struct RestDiagnosisModel {
  RestDiagnosisModel(const RestData& data, const RestDiagnosisOptions& options);

  EffectModel effect_model(const std::vector<EffectColumn>& columns, const Eigen::VectorXd& values) const;
  EffectModel effect_model(const RestModelFit& of) const { return effect_model(of.columns, of.fit.effect_values); }
  // `model` with one column more; with these columns, from these values.
  RestModelFit refit(const EffectColumn& added) const;
  RestModelFit refit(std::vector<EffectColumn> columns, const Eigen::VectorXd& start_values) const;
  double rows() const { return static_cast<double>(data.rests.size() * 4 + data.legs.size() * 2); }
  std::vector<int> members(const EffectEntry& entry, double tau_s) const;  // of `testable`
  bool in_model(const EffectEntry* entry) const;

  const RestData& data;
  const RestDiagnosisOptions& options;
  Site site;
  double reference_c = 0.0;
  double duration_s = 0.0;
  std::vector<EffectColumn> testable;  // what is still in question
  std::set<std::string> struck;        // effects the gate refused
  RestModelFit model;
};

}  // namespace turncal
