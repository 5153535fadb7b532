#include "calib/diagnosis/fit_pass.h"

#include "calib/diagnosis/holdout.h"
#include "calib/joint/coarser_recording.h"

namespace turncal {

FitPass run_fit_pass(const CompressedRecording& recording, const JointResult& fit, const FilterSetup& given) {
  FilterSetup setup = given;
  setup.with_columns = setup.keep_steps = true;
  setup.narrow_columns = 0;
  const EffectModel model = effect_model_of(fit, recording.info.latitude_deg);
  FitPass pass;
  pass.recording = coarser(recording, coarseness_of_scores, setup);
  pass.filter = run_filter(pass.recording, fit.parameters, model, setup);
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)]) pass.columns.push_back(k);
  for (int k = 0; k < model.columns; ++k) pass.columns.push_back(parameter_count + k);
  return pass;
}

}  // namespace turncal
