// What selection and gate of a diagnosis share: the columns that may be added, the model so far, and fits beside it.
//
// `columns` are the catalogue's, then patterns (unexplained.h). `chosen` is what has been added, `current` the fit with it.
// Used by diagnosis.cpp only; see diagnosis.h for the method.
#pragma once

#include <optional>
#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "calib/joint/score_algebra.h"

namespace turncal {

double minus_two_log_likelihood(const JointResult& result);
// Every column has a score; one of which the model already imitates all but a billionth says nothing.
bool visible(const Scores& scores, int column);

// Of the effects, each once.
std::vector<std::string> names_of(const std::vector<EffectColumn>& columns);
// The name of an effect none of whose components is twice the sigma that is handed out with it: another of its class, or of another
// effect's, may take all of it. Effects that are alone come to six times and more. Empty: none.
std::string lost_in_its_class(const std::vector<EstimatedEffect>& effects);
// Those of a fit beyond the base model: turn-on columns are of the base model.
std::vector<EffectColumn> columns_beyond_base(const JointResult& result);

struct DiagnosisModel {
  DiagnosisModel(const JoinedRecordings& recordings, const DiagnosisOptions& options);

  // Of `effects` beyond the base model, which of several recordings has their turn-on columns, too; those begin at the values of `from`.
  JointOptions estimate_options(const std::vector<EffectColumn>& effects, const JointResult* from) const;
  // A trial beside a finished fit: its faults are known, and its noise is a good start; or `noise` is taken for its own.
  JointResult fit(const std::vector<EffectColumn>& effects, const JointResult& from,
                  const NoiseModel* noise = nullptr) const;
  // -2 log L when the bias instability is as slow as a third of a run. Flicker noise wanders on every time scale, and what
  // a process of ten minutes cannot follow must not be taken for a drift: what an effect gains must hold here too.
  double misfit_beside_slow_noise(const std::vector<EffectColumn>& effects, const JointResult& from) const;
  // One filter pass at `current` with candidates after its effects, and what each of them would bring.
  // At each of these, which may differ from the fitted one in bias instability only.
  std::vector<Scores> scores(const std::vector<EffectColumn>& candidates, const std::vector<NoiseModel>& noises) const;
  // With whatever time constant: a component is in a model once.
  bool has_chosen(const EffectColumn& column) const;
  std::vector<EffectColumn> chosen_without(const std::string& name) const;
  NoiseModel bare_noise() const;  // the fitted one without bias instability

  const JoinedRecordings& recordings;
  const CompressedRecording& recording;  // all of them
  const DiagnosisOptions& options;
  std::vector<EffectColumn> catalogue;
  std::vector<EffectColumn> columns;
  double threshold = 0.0;           // of 2 ln L, family-wise over all columns
  double threshold_of_times = 0.0;  // likewise over all that a time or a period may be (unexplained.h, refined())
  double near = 0.0;                // as `threshold`, SelectionLimits::near_family_wise
  std::vector<EffectColumn> chosen;
  JointResult current;
  // Fitted with what may be the truth as well: the pattern that explains the residual best, families that explain about as much as a
  // name (name_check.h), an effect that came near to its limit.
  std::vector<Parameters> beside;
};

}  // namespace turncal
