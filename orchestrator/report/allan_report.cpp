#include "orchestrator/report/allan_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/statistics/data_screen.h"
#include "imu_io/base/text.h"
#include "orchestrator/figures/diagnosis_figures.h"

namespace turncal {

namespace {

using namespace cell;

constexpr double ug_mps2 = 1e-6 * standard_gravity_mps2;
constexpr AllanUnit units[2][allan_terms] = {
    {{"quantisation", "arcsec", "″", rad_per_arcsec},
     {"angle_random_walk", "deg_per_rt_h", "°/√h", radprs_per_degprh},
     {"gyro_bias_instability", "degph", "°/h", radps_per_degph},
     {"gyro_rate_random_walk", "degph_per_rt_h", "°/h/√h", radps_per_degph / 60.0},
     {"gyro_rate_ramp", "degph_per_h", "°/h/h", radps_per_degph / 3600.0}},
    {{"quantisation", "mmps", "mm/s", 1e-3},
     {"velocity_random_walk", "ug_per_rt_hz", "µg/√Hz", ug_mps2},
     {"accel_bias_instability", "ug", "µg", ug_mps2},
     {"accel_random_walk", "ug_per_rt_h", "µg/√h", ug_mps2 / 60.0},
     {"accel_ramp", "ug_per_h", "µg/h", ug_mps2 / 3600.0}}};

// Returns what a datasheet calls bias instability.
double floor_of(const AllanAxis& axis) {
  const AllanPoint* const lowest = axis.lowest();
  return lowest == nullptr ? 0.0 : lowest->deviation / std::sqrt(2.0 * std::log(2.0) / pi);
}

// One number for a triad; a coefficient that is not seen counts with its limit.
struct OfTriad {
  double value = 0.0;
  bool limit = false;
};
OfTriad root_mean_square(const AllanResult& result, bool gyro, std::size_t term) {
  OfTriad of;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const AllanCoefficient& c = result.axes[axis + (gyro ? 0 : 3)].fit.terms[term];
    of.limit = of.limit || c.value == 0.0;
    const double value = c.value != 0.0 ? c.value : c.limit;
    of.value += value * value / 3.0;
  }
  of.value = std::sqrt(of.value);
  return of;
}

std::string letters_of(unsigned terms) {
  std::vector<std::string> all;
  for (std::size_t k = 0; k < allan_terms; ++k)
    if ((terms >> k & 1U) != 0) all.emplace_back(allan_letters[k]);
  return join(all, " + ");
}

void add_notes(const AllanReport& report, Document& document) {
  constexpr double sure = 4.6;  // difference of -2 ln L: ten to one
  for (std::size_t k = 0; k < 6; ++k) {
    const AllanFit& fit = report.result.axes[k].fit;
    const auto say = [&](const std::string& what) { document.text(std::string(channel_names[k]) + ": " + what); };
    if (!fit.made) {
      say("no fit: the record is too short, or the channel never changes");
      continue;
    }
    if (fit.cut)
      say(
          fmt::format("above {} Hz the noise is not of this model (a filter, vibration, counting in pulses) and is "
                      "left out of the fit",
                      significant(fit.highest_hz, 2)));
    if (!fit.fits)
      say(fmt::format("the model does not fit: the residual is {} times that of chance; the sigmas are widened by it",
                      significant(fit.misfit, 2)));
    for (std::size_t term = 0; term < allan_terms; ++term) {
      const AllanCoefficient& c = fit.terms[term];
      if (c.value != 0.0 && c.gain < sure && c.instead != 0)
        say(fmt::format("{} or {}: only a longer record can tell (-2 ln L differs by {})", allan_letters[term],
                        letters_of(c.instead), significant(c.gain, 2)));
    }
    // Jitter s of the time stamps changes the sum of increments by s times the reading: white noise of the velocity.
    const AllanCoefficient& q = fit.quantisation();
    if (k < 3 || !(q.value > 0.0)) continue;
    const double force = std::abs(report.mean_force_mps2[k - 3]);
    double others = 0.0;
    for (std::size_t j = 3; j < 6; ++j)
      if (j != k)
        others = std::max(
            {others, report.result.axes[j].fit.quantisation().value, report.result.axes[j].fit.quantisation().limit});
    if (force > 0.5 * standard_gravity_mps2 && q.value > 3.0 * others)
      say(
          fmt::format("Q comes from time stamps that jitter by {} ms: use the mean period for increments "
                      "(time.increments = period)",
                      significant(1e3 * q.value / force, 2)));
  }
}

void add_coefficients(const AllanReport& report, bool gyro, Document& document) {
  const char* const triad = gyro ? "gyros" : "accelerometers";
  document.section(triad, gyro ? "Gyros" : "Accelerometers");
  Table table{{wide("coefficient"), text("unit")}};
  std::vector<const AllanResult*> results = {&report.result};
  if (report.other) results.push_back(&*report.other);
  for (const AllanResult* result : results)
    for (const char* axis : body_names)
      table.head.push_back(number(std::string(axis) + (result == &report.result ? "" : ", against")));
  if (report.file)
    for (const char* axis : body_names) table.head.push_back(number(std::string(axis) + ", file"));
  for (std::size_t term = 0; term < allan_terms; ++term) {
    const AllanUnit& unit = allan_unit(gyro, term);
    std::vector<Cell> row = {wide(std::string(allan_letters[term]) + " " + allan_names[term]), text(unit.shown)};
    for (const AllanResult* result : results)
      for (std::size_t k = 0; k < 3; ++k) row.push_back(allan_cell(result->axes[k + (gyro ? 0 : 3)].fit, gyro, term));
    if (report.file)
      for (Eigen::Index k = 0; k < 3; ++k) {
        const double bias = gyro ? report.file->gyro_bias_instability_radps : report.file->accel_bias_instability_mps2;
        const double walk = (gyro ? report.file->angle_random_walk : report.file->velocity_random_walk)[k];
        row.push_back(term == 1                 ? number(walk / unit.si)
                      : term == 2 && bias > 0.0 ? number(bias / unit.si)
                                                : number("-"));
      }
    table.row(std::move(row));
  }
  const auto of_lowest = [&](const char* name, const char* unit, const auto& cell_of) {
    std::vector<Cell> row = {wide(name), text(unit)};
    for (const AllanResult* result : results)
      for (std::size_t k = 0; k < 3; ++k) {
        const AllanAxis& axis = result->axes[k + (gyro ? 0 : 3)];
        row.push_back(axis.points.empty() ? number("-") : cell_of(axis));
      }
    row.resize(table.head.size(), number("-"));
    table.row(std::move(row));
  };
  of_lowest("lowest dev. / 0.664", allan_unit(gyro, 2).shown,
            [&](const AllanAxis& axis) { return number(floor_of(axis) / allan_unit(gyro, 2).si); });
  of_lowest("at τ", "s", [](const AllanAxis& axis) { return number(axis.lowest()->tau_s); });
  document.add(std::move(table));
}

// Adds discrete and continuous forms; formulas: docs/allan.md.
void add_ros_forms(const AllanReport& report, Document& document) {
  document.section("ros", "As ROS users write it");
  Table table{{name("name"), number("value"), text("unit"), wide("formula")}};
  const double dt = report.sample_s;
  bool limits = false;
  for (const bool gyro : {true, false}) {
    const OfTriad white = root_mean_square(report.result, gyro, 1), walk = root_mean_square(report.result, gyro, 3),
                  flicker = root_mean_square(report.result, gyro, 2);
    const std::string kalibr = gyro ? "gyroscope_" : "accelerometer_", utils = gyro ? "gyr_" : "acc_",
                      unit = gyro ? "rad/s" : "m/s²";
    const auto row = [&](const std::string& key, const OfTriad& of, double factor, const std::string& in,
                         const char* formula) {
      limits = limits || of.limit;
      const double value = of.value * factor;
      table.row(
          {name(key), of.limit ? below(value, 4) : number(significant(value, 4), value), text(in), wide(formula)});
    };
    row(kalibr + "noise_density", white, 1.0, unit + "/√Hz", "N");
    row(kalibr + "random_walk", walk, 1.0, (gyro ? "rad/s²/√Hz" : "m/s³/√Hz"), "K");
    row(utils + "n", white, 1.0 / std::sqrt(dt), unit, "N / sqrt(dt), per sample");
    row(utils + "w", walk, std::sqrt(dt), unit, "K sqrt(dt), per step");
    row(utils + "w of imu_utils", flicker, 0.664, unit, "0.664 B, a floor and not a walk");
  }
  document.add(std::move(table));
  document.text(fmt::format("dt = {:.9g} s; root mean square of three axes{}", dt,
                            limits ? "; <: not seen on every axis, 95 % limit there" : ""));
}

void add_points(const AllanReport& report, Document& document) {
  document.add(Heading{2, "points", "Points and evidence"}, Scope::page);
  Table terms{{text("channel"), text("coefficient"), text("unit"), number("value"), number("sigma"),
               number("limit 95 %"), number("gain"), text("instead")}};
  Table points{{text("channel"), number("tau_s"), number("deviation"), number("low"), number("high"),
                number("degrees of freedom")}};
  for (std::size_t k = 0; k < 6; ++k) {
    const AllanAxis& axis = report.result.axes[k];
    for (std::size_t term = 0; term < allan_terms; ++term) {
      const AllanCoefficient& c = axis.fit.terms[term];
      const AllanUnit& unit = allan_unit(k < 3, term);
      const bool seen = c.value != 0.0;
      const auto only = [](bool there, double value) { return there ? number(value, 4) : number("-"); };
      terms.row({text(channel_names[k]), text(allan_letters[term]), text(unit.shown), only(seen, c.value / unit.si),
                 only(seen, c.sigma / unit.si), only(!seen && axis.fit.made, c.limit / unit.si), only(seen, c.gain),
                 text(letters_of(c.instead))});
    }
    for (const AllanPoint& p : axis.points)
      points.row({text(channel_names[k]), number(p.tau_s, 6), number(p.deviation, 4), number(p.low, 4),
                  number(p.high, 4), number(p.degrees, 4)});
  }
  document.add(std::move(terms), Scope::page);
  document.soft("Deviations in rad/s and m/s²; low to high contains the true one with a probability of 68 %.");
  document.add(std::move(points), Scope::page);
}

}  // namespace

const AllanUnit& allan_unit(bool gyro, std::size_t term) { return units[gyro ? 0 : 1][term]; }

Cell allan_cell(const AllanFit& fit, bool gyro, std::size_t term) {
  const AllanCoefficient& c = fit.terms[term];
  const double si = allan_unit(gyro, term).si;
  if (!fit.made) return number("-");
  if (c.value == 0.0) return below(c.limit / si, 2);
  return number(plus_minus(c.value / si, c.sigma / si, Alphabet::typographic), c.value / si);
}

Document allan_document(const AllanReport& report) {
  Document document{"Allan deviation of " + report.source, "Allan deviation of " + report.source};
  Facts facts;
  facts.add("at rest",
            fmt::format("{:.6g} s in {}, the longest {:.6g} s; a sample every {:.9g} s", report.result.total_s,
                        counted(report.rests, "rest"), report.result.longest_s, report.sample_s));
  if (!report.against.empty()) facts.add("against", report.against);
  facts.add("<", "not seen in this record: 95 % upper limit");
  document.add(std::move(facts));
  for (const std::string& note : report.notes) document.text(note);
  add_coefficients(report, true, document);
  add_coefficients(report, false, document);
  add_notes(report, document);
  add_ros_forms(report, document);
  document.figure(allan_figure(report.result, report.other ? &*report.other : nullptr));
  add_points(report, document);
  return document;
}

std::string format_allan_points(const AllanResult& result) {
  std::string csv = "channel,tau_s,deviation,low,high,degrees,model\n";
  for (std::size_t k = 0; k < 6; ++k)
    for (const AllanPoint& p : result.axes[k].points) {
      csv += std::string(k < 3 ? "gyro_" : "accel_") + body_names[k % 3];
      for (const double value :
           {p.tau_s, p.deviation, p.low, p.high, p.degrees, std::sqrt(allan_variance(result.axes[k].fit, p.tau_s))})
        csv += ',' + format_number(value);
      csv += '\n';
    }
  return csv;
}

std::string format_imu_yaml(const AllanResult& result, double sample_s) {
  std::string yaml = "# For Kalibr: continuous-time densities, root mean square of three axes.\n";
  for (const bool gyro : {false, true}) {
    const std::string triad = gyro ? "gyroscope" : "accelerometer";
    const OfTriad white = root_mean_square(result, gyro, 1), walk = root_mean_square(result, gyro, 3);
    const char* const limit = "  # not seen on every axis: 95 % limit there";
    yaml += fmt::format("{}_noise_density: {}{}\n", triad, significant(white.value, 6), white.limit ? limit : "");
    yaml += fmt::format("{}_random_walk: {}{}\n", triad, significant(walk.value, 6), walk.limit ? limit : "");
  }
  return yaml + "rostopic: /imu0\nupdate_rate: " + format_number(std::round(1e3 / sample_s) / 1e3) + "\n";
}

}  // namespace turncal
