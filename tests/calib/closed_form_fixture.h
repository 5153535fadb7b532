// What the tests of the closed form share: the unit of Wang (2020) on the rig, and the fourteen steps in long and in short.
#pragma once

#include "calib/closed_form/closed_form.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {

// What the issue asks of noise-free data after three passes.
inline constexpr ParameterDistance demanded = {0.0005, 1e-7, 1.5e-7, 1.5e-7};

inline void expect_within(const ParameterDistance& found, const ParameterDistance& limit, const std::string& what) {
  EXPECT_LT(found.gyro_bias_degph, limit.gyro_bias_degph) << what;
  EXPECT_LT(found.accel_bias_g, limit.accel_bias_g) << what;
  EXPECT_LT(found.gyro_matrix, limit.gyro_matrix) << what;
  EXPECT_LT(found.accel_matrix, limit.accel_matrix) << what;
}

// The unit of Wang (2020), Table 1: biases, scale factors off by per cents (of the accelerometers up to 8), misalignments of arc-minutes.
inline Parameters wrong_unit() {
  Parameters p;
  p.N0_degph << -0.078921, 0.025013, 0.084675;
  p.A0_g << 0.003576, -0.0016021, -0.0059875;
  p.n << 0.932978, 0.001801, -0.000801, -0.001657, 0.932801, 0.000914, 0.000510, -0.004321, 0.932801;
  p.a << 0.980101, 0.000801, -0.000330, 0.0, 1.080798, 0.000986, 0.0, 0.0, 0.953105;
  return p;
}

// That unit on a table that is 3 arc-minutes off level and north, without noise.
inline RigConfig paper_unit() {
  RigConfig config = noise_free(default_rig_config());
  config.table_errors.random_arcmin = 0.0;
  const ParameterVector table1 = to_vector(wrong_unit());
  std::ranges::copy(table1, config.truth.begin());
  config.table_errors.tilt_north_arcmin = 3.0;
  config.table_errors.tilt_east_arcmin = -3.0;
  config.table_errors.north_arcmin = 3.0;
  return config;
}

// The same unit on a table that is level and points north.
inline RigConfig unit_on_a_perfect_table() {
  RigConfig config = paper_unit();
  config.table_errors = {};
  config.table_errors.random_arcmin = 0.0;
  return config;
}

// The fourteen steps at four times the rate with dwells of 15 s (some of 20 s: V1 and V2 over different lengths), 60 s
// in 13 and 14: for what does not depend on lengths.
inline Sequence short_steps() {
  std::string text = fourteen_steps().text;
  const auto replace = [&](const std::string& from, const std::string& to) {
    for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
      text.replace(at, from.size(), to);
  };
  replace("align 12000", "align 2400");
  replace("dwell 120000", "dwell 12000");
  replace("dwell 20000", "dwell 3000");
  replace("rate_degps = 10", "rate_degps = 40");
  replace("rotate R -180\n  dwell 3000", "rotate R -180\n  dwell 4000");
  replace("rotate P -360\n  dwell 3000", "rotate P -360\n  dwell 4000");
  return must(parse_sequence(text, "short_steps"));
}

inline const CompressedRecording& short_recording() {
  static const CompressedRecording recording = record_on_rig(short_steps(), paper_unit()).recording;
  return recording;
}

inline ClosedFormResult calibrated(const CompressedRecording& recording, const ClosedFormOptions& options = {}) {
  return must(closed_form_calibrate(recording, start_parameters(recording.info), options));
}

inline ClosedFormOptions passes(int count) {
  return {.max_passes = count, .tolerance = {}};  // never enough
}

}  // namespace turncal
