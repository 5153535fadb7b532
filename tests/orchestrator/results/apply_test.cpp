// `turncal apply` with effects beyond the 24 parameters. Its forms: tests/golden/applied.sh.
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class Apply : public RigUnit {};

// With the effect in the file, what is left in the calibrated increments is the effect-free unit: the x accelerometer up and
// down reads g both ways. Without it the two differ by twice the square term.
TEST_F(Apply, TakesEffectsOff) {
  record("k2", std::string(without_noise) + "effect.accel_second_order.x = 200\n",
         "step 1\n  initial H 0 P 90 R 0\n  align 4000\n  rotate P -180\n  dwell 4000\n");
  ParameterFile file = truth_of("k2");
  // Mean of x over the last seconds of both dwells: (up + down) / 2 g, in ug.
  const auto asymmetry_ug = [&](const std::string& name) {
    keep(file, name + ".conf");
    ends({"apply", "k2", "--parameters", path(name + ".conf"), "--out", name + ".csv"}, 0);
    std::vector<double> x;
    for (const std::string& row : lines_of(file_text(folder_ / (name + ".csv"))))
      if (!row.starts_with("sample")) x.push_back(std::stod(lines_of(row, ',')[4]));
    const auto mean = [&](std::size_t first) {
      return std::accumulate(x.begin() + std::ptrdiff_t(first), x.begin() + std::ptrdiff_t(first + 3000), 0.0) / 3000.0;
    };
    return 0.5 * (mean(500) + mean(x.size() - 3500)) / 0.005 / 9.80665e-6;
  };
  const double without = asymmetry_ug("without");
  file.effects.push_back({"accel_second_order", "x", 200.0, 1.0});
  file.model = "extended";
  const double with = asymmetry_ug("with");
  EXPECT_NEAR(without, 200.0, 5.0);  // (9.7914 / 9.80665)^2 of 200, and half a pulse in 15 s
  EXPECT_NEAR(with, 0.0, 4.0);
}

// The rests of a north seeking are no part of a calibration; effects act in them all the same.
TEST_F(Apply, EvaluatesEffectsInTheNorthSeekingToo) {
  const std::string said =
      ends({"run", "--dry-run", "--verify", "--no-diagnosis", "--unit", "SN1", "--out", "v"}, 0).out;
  EXPECT_EQ(said.find("] verdict "), said.rfind("] verdict ")) << "a unit has one: " << said;
  ParameterFile file = truth_of("v");
  file.effects.push_back({"accel_second_order", "y", 200.0, 1.0});
  const auto source = good(RecordingSource::open(path("v")));
  const CompressedRecording whole = good(load_recording(path("v"), {}, {}, all_steps))->data;
  EXPECT_LT(good(load_recording(path("v")))->data.blocks.size(), whole.blocks.size());
  auto of_source = good(EffectTerms::of(file, "v.conf", **source, nullptr));
  auto of_blocks = good(EffectTerms::of(file, "v.conf", **source, &whole));
  const std::int64_t last = whole.blocks.back().start_sample;
  EXPECT_EQ(of_source->at(last).force_mps2, of_blocks->at(last).force_mps2);
}

TEST_F(Apply, SaysThatParametersAreNotTrusted) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 1000\n  dwell 1000\n");
  ParameterFile file = truth_of("rec");
  describe_trust("it fell", file);
  keep(file, "fell.conf");
  EXPECT_SAYS(ends("apply rec --parameters fell.conf --out fell.csv", 0).err, "fell.conf: not trusted: it fell\n");
}

}  // namespace
}  // namespace turncal
