#include "calib/closed_form/closed_form.h"

#include <cstdio>

#include "calib/closed_form/closed_form_layout.h"

namespace turncal {
namespace {

bool within(const ParameterDistance& moved, const ParameterDistance& limit) {
  return moved.gyro_bias_degph <= limit.gyro_bias_degph && moved.accel_bias_g <= limit.accel_bias_g &&
         moved.gyro_matrix <= limit.gyro_matrix && moved.accel_matrix <= limit.accel_matrix;
}

std::string describe(const ParameterDistance& moved) {
  char text[160];
  std::snprintf(text, sizeof text, "N0 %.2g deg/h, A0 %.2g g, n %.2g, a %.2g", moved.gyro_bias_degph,
                moved.accel_bias_g, moved.gyro_matrix, moved.accel_matrix);
  return text;
}

}  // namespace

ParameterDistance distance(const Parameters& one, const Parameters& other, const RecordingInfo& info) {
  const double nominal = start_parameters(info).n(0, 0);
  return {(one.N0_degph - other.N0_degph).cwiseAbs().maxCoeff(), (one.A0_g - other.A0_g).cwiseAbs().maxCoeff(),
          (one.n - other.n).cwiseAbs().maxCoeff() / nominal, (one.a - other.a).cwiseAbs().maxCoeff()};
}

Result<ClosedFormResult> closed_form_calibrate_with(const CompressedRecording& recording, const Parameters& start,
                                                    const ClosedFormOptions& options, const StepCorrection& correct) {
  ClosedFormLayout layout(recording, options.min_dwell_s, options.max_misfit_deg);
  if (Status status = layout.find(); !status.ok()) return status.error();
  if (Status status = layout.check_data(sensor_model(start, recording.info)); !status.ok()) return status.error();

  ClosedFormResult result;
  result.parameters = start;
  Parameters& parameters = result.parameters;
  while (result.passes < options.max_passes && !result.converged) {
    const Parameters before = parameters;
    for (int step = 1; step <= closed_form_steps; ++step)
      correct(layout.measure(step, sensor_model(parameters, recording.info)), parameters);
    ++result.passes;
    if (!to_vector(parameters).allFinite()) {
      result.message = "diverged in pass " + std::to_string(result.passes);
      return result;
    }
    result.corrections.push_back(distance(parameters, before, recording.info));
    result.converged = within(result.corrections.back(), options.tolerance);
  }
  const std::string passes = std::to_string(result.passes) + (result.passes == 1 ? " pass" : " passes");
  result.message = (result.converged ? "converged in " : "not converged in ") + passes;
  if (!result.corrections.empty()) result.message += ", the last one moved " + describe(result.corrections.back());
  return result;
}

Result<ClosedFormResult> closed_form_calibrate(const CompressedRecording& recording, const Parameters& start,
                                               const ClosedFormOptions& options) {
  return closed_form_calibrate_with(recording, start, options, correct_parameters);
}

}  // namespace turncal
