// Every printed formula of Wang (2020) beside the derived one, on noise-free data: does it find the truth? The table that
// this test prints is the one of docs/estimator.md.

#include "calib/closed_form/closed_form.h"
#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

double V1(const StepMeasurement& m) { return m.leg1.velocity_mps.z(); }
double V2(const StepMeasurement& m) { return m.leg2.velocity_mps.z(); }
double gT(const StepMeasurement& m) { return m.gravity_mps2 * m.leg1.dwell_s; }
constexpr double tau_s = 0.005;
constexpr double earth_radius_m = 6378137.0;

// After how many passes a formula has found the truth (0: not even after ten).
struct Passes {
  int alone;  // every other parameter true and left alone: the formula on its own
  int whole;  // in its place among the derived ones, from start_parameters(), table 3 arc-minutes off
};

struct Printed {
  const char* equation;
  int step;
  std::vector<std::string> keys;  // what it determines
  // From the parameters before the step to those after it; only `keys` are taken from it.
  std::function<void(const StepMeasurement&, Parameters&)> apply;
  Passes verdict;
};

// The formulas as they stand there, with V1, V2 for its eastward velocities and T for T100.
const std::vector<Printed>& printed_formulas() {
  using M = StepMeasurement;
  using P = Parameters;
  const auto half_sum = [](const M& m) { return (V1(m) + V2(m)) / 2.0 / (2.0 * gT(m)); };
  const auto sum = [](const M& m) { return (V1(m) + V2(m)) / (2.0 * gT(m)); };
  const auto scale = [](const M& m) { return 1.0 - (V1(m) - V2(m)) / 2.0 / (2.0 * pi * gT(m) * tau_s); };
  const auto by_radius = [](double v) { return 3600.0 * 180.0 / pi * v / (2.0 * earth_radius_m); };
  const auto drift = [](const M& m) { return 3600.0 * 180.0 / pi * m.leg1.heading_change_rad / m.leg1.dwell_s; };
  const auto five_and_six = [](const M& m, P& p) {
    for (int i = 0; i < 3; ++i) {
      const double up = m.up[i][i], down = m.down[i][i];
      p.A0_g[i] += (up + down) / 2.0 / standard_gravity_mps2;
      p.a(i, i) /= (up - down) / 2.0 / m.gravity_mps2;
    }
  };
  static const std::vector<Printed> list = {
      {"(5) (6)", 1, {"A01", "A02", "A03", "a11", "a22", "a33"}, five_and_six, {3, 0}},
      {"(7)", 2, {"n11"}, [=](const M& m, P& p) { p.n(0, 0) *= scale(m); }, {0, 0}},
      {"(8)", 3, {"n33"}, [=](const M& m, P& p) { p.n(2, 2) *= scale(m); }, {0, 0}},
      {"(9)", 4, {"n22"}, [=](const M& m, P& p) { p.n(1, 1) *= scale(m); }, {0, 0}},
      {"(10) =", 5, {"A03"}, [=](const M& m, P& p) { p.A0_g[2] = half_sum(m); }, {0, 0}},
      {"(10) as +=", 5, {"A03"}, [=](const M& m, P& p) { p.A0_g[2] += half_sum(m); }, {0, 3}},
      {"(11)", 6, {"A01"}, [=](const M& m, P& p) { p.A0_g[0] += half_sum(m); }, {3, 3}},
      {"(12)", 7, {"A02"}, [=](const M& m, P& p) { p.A0_g[1] += (V1(m) - V2(m)) / 2.0 / (2.0 * gT(m)); }, {0, 3}},
      {"(13)", 7, {"a23"}, [=](const M& m, P& p) { p.a(1, 2) += sum(m); }, {3, 3}},
      {"(14)", 8, {"a12"}, [=](const M& m, P& p) { p.a(0, 1) -= sum(m); }, {10, 10}},
      {"(15)", 9, {"a13"}, [=](const M& m, P& p) { p.a(0, 2) -= sum(m); }, {3, 3}},
      {"(16) =", 10, {"n21"}, [=](const M& m, P& p) { p.n(1, 0) = sum(m); }, {0, 0}},
      {"(16) as +=", 10, {"n21"}, [=](const M& m, P& p) { p.n(1, 0) += sum(m); }, {0, 0}},
      {"(17) =", 10, {"n31"}, [=](const M& m, P& p) { p.n(2, 0) = sum(m); }, {0, 0}},
      {"(17) as -=", 10, {"n31"}, [=](const M& m, P& p) { p.n(2, 0) -= sum(m); }, {0, 0}},
      {"(18)", 11, {"n32"}, [=](const M& m, P& p) { p.n(2, 1) += sum(m); }, {0, 0}},
      {"(19)", 11, {"n12"}, [=](const M& m, P& p) { p.n(0, 1) += sum(m); }, {10, 10}},
      {"(20)", 12, {"n23"}, [=](const M& m, P& p) { p.n(1, 2) += sum(m); }, {10, 10}},
      {"(21)", 12, {"n13"}, [=](const M& m, P& p) { p.n(0, 2) += sum(m); }, {0, 0}},
      {"(22)", 13, {"N01"}, [=](const M& m, P& p) { p.N0_degph[0] += by_radius(V1(m)); }, {0, 0}},
      {"(23)", 13, {"N02"}, [=](const M& m, P& p) { p.N0_degph[1] -= drift(m); }, {3, 3}},
      {"(24)", 13, {"N03"}, [=](const M& m, P& p) { p.N0_degph[2] -= by_radius(m.leg1.velocity_mps.x()); }, {0, 3}},
      {"(25)", 14, {"N02"}, [=](const M& m, P& p) { p.N0_degph[1] -= drift(m); }, {3, 3}},
      {"(26)", 14, {"N03"}, [=](const M& m, P& p) { p.N0_degph[2] += by_radius(V1(m)); }, {0, 0}},
  };
  return list;
}

// `into` with the named parameters of `from`.
Parameters with_keys(const Parameters& into, const Parameters& from, const std::vector<std::string>& keys) {
  ParameterVector v = to_vector(into);
  const ParameterVector source = to_vector(from);
  for (const std::string& key : keys) {
    const auto k = std::ranges::find(parameter_keys, key) - parameter_keys.begin();
    v[k] = source[k];
  }
  return from_vector(v);
}

// The largest error after 3 and 10 passes, in units of what is demanded.
struct Outcome {
  double three = HUGE_VAL;
  double ten = HUGE_VAL;
  int passes() const { return three < 1.0 ? 3 : ten < 1.0 ? 10 : 0; }
};

double largest_error(const Parameters& found, const RigRecording& made) {
  if (!to_vector(found).allFinite()) return HUGE_VAL;
  const ParameterDistance d = distance(found, made.truth, made.recording.info);
  return std::max({d.gyro_bias_degph / demanded.gyro_bias_degph, d.accel_bias_g / demanded.accel_bias_g,
                   d.gyro_matrix / demanded.gyro_matrix, d.accel_matrix / demanded.accel_matrix});
}

// `pass` corrects the parameters once.
Outcome outcome(const RigRecording& made, Parameters parameters, const std::function<void(Parameters&)>& pass) {
  Outcome found;
  for (int count = 1; count <= 10; ++count) {
    pass(parameters);
    if (count == 3) found.three = largest_error(parameters, made);
  }
  found.ten = largest_error(parameters, made);
  return found;
}

TEST(PrintedFormulas, EachOneAgainstTheTruth) {
  const RigRecording level = record_on_rig(fourteen_steps(), unit_on_a_perfect_table());
  const RigRecording tilted = record_on_rig(fourteen_steps(), paper_unit());
  const Parameters start = start_parameters(level.recording.info);

  std::printf(
      "largest error in units of what is demanded (1.5e-7 of n and a, 1e-7 g, 0.0005 deg/h), after 3 and 10 passes\n"
      "%-17s | %-19s | %-19s | %-19s\n",
      "", "printed, alone", "derived, alone", "printed, in its place");
  ClosedFormLayout level_layout(level.recording), tilted_layout(tilted.recording);
  must(level_layout.find());
  must(tilted_layout.find());
  const auto measure = [](const ClosedFormLayout& layout, int step, const Parameters& p, const RigRecording& made) {
    return layout.measure(step, sensor_model(p, made.recording.info));
  };
  using Formula = std::function<void(const StepMeasurement&, Parameters&)>;
  for (const Printed& printed : printed_formulas()) {
    const auto only = [&](const Formula& formula) {
      return outcome(level, with_keys(level.truth, start, printed.keys), [&](Parameters& p) {
        Parameters after = p;
        formula(measure(level_layout, printed.step, p, level), after);
        p = with_keys(p, after, printed.keys);
      });
    };
    const auto in_place = [&](Parameters& p) {
      for (int step = 1; step <= closed_form_steps; ++step) {
        const StepMeasurement measured = measure(tilted_layout, step, p, tilted);
        Parameters after = p;
        correct_parameters(measured, p);
        if (step != printed.step) continue;
        printed.apply(measured, after);
        p = with_keys(p, after, printed.keys);
      }
    };
    const Outcome alone = only(printed.apply);
    const Outcome derived = only(correct_parameters);
    const Outcome whole = outcome(tilted, start, in_place);
    std::printf("%-11s %-5s | %9.2g %9.2g | %9.2g %9.2g | %9.2g %9.2g\n", printed.equation,
                printed.keys.front().c_str(), alone.three, alone.ten, derived.three, derived.ten, whole.three,
                whole.ten);
    EXPECT_EQ(alone.passes(), printed.verdict.alone) << printed.equation << " alone";
    EXPECT_EQ(whole.passes(), printed.verdict.whole) << printed.equation << " in its place";
    EXPECT_LT(derived.three, 0.1) << printed.equation << " derived, alone";
  }
  const ClosedFormResult all = calibrated(tilted.recording, passes(3));
  std::printf("all derived, in their places: %.2g\n", largest_error(all.parameters, tilted));
  EXPECT_LT(largest_error(all.parameters, tilted), 1.0);
}

}  // namespace
}  // namespace turncal
