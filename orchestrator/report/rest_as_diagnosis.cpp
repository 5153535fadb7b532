#include "orchestrator/report/diagnosis_file.h"

#include <fmt/format.h>

#include <cmath>

#include "imu_io/base/text.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

extern const std::string_view how_to_read_rests;  // how_to_read_rests.txt

namespace {

using Eigen::Vector3d;
constexpr double loaded_share = 0.5;  // of gravity that an axis must carry to be charged with an error of the norm
constexpr double level_share = 0.5;   // horizontal share that an axis must have to show a tilt about it

std::string change_text(const RestDiagnosis& r) {
  const RestErrors &was = r.held_out_before, &is = r.held_out_after;
  const auto part = [](const char* what, double a, double b, const char* unit) {
    return fmt::format("{} from {} to {} {} rms ({})", what, significant(a, 3), significant(b, 3), unit,
                       percent_change(a, b));
  };
  return part("gravity's direction after a rotation", 1e3 * was.direction_rms_rad, 1e3 * is.direction_rms_rad, "mrad") +
         ", " + part("gyros at rest", was.gyro_rms_radps / rad_per_deg, is.gyro_rms_radps / rad_per_deg, "°/s") + ", " +
         part("gravity's norm", 1e3 * was.norm_rms_mps2, 1e3 * is.norm_rms_mps2, "mm/s²");
}

std::string remainder_text(const RestDiagnosis& r) {
  std::vector<std::string> parts;
  for (const RestKind kind : {RestKind::direction, RestKind::gyro, RestKind::norm}) {
    const double ratio = r.final.white_ratio[std::size_t(kind)];
    if (ratio > 2.0) parts.push_back(std::string(to_string(kind)) + " (" + significant(ratio, 2) + " times)");
  }
  return parts.empty() ? "nothing exceeds twice the white noise" : "above the white noise: " + join(parts);
}

std::string sentence_of(const RestDiagnosis& r, const RestData& data) {
  const Diagnosis& d = r.diagnosis;
  const std::string title = verdict_title(to_string(d.verdict)) + ": ";
  const std::string where =
      r.second_recording ? "on the second recording" : "in cross-validation over rests and rotations";
  if (d.verdict == Verdict::extended)
    return title + effects_clause(d) + "; " + where + ": " + change_text(r) + alias_clause(d) + "; " +
           remainder_text(r) + (r.accel_not_tested.empty() ? "" : "; " + d.reason) + ".";
  if (d.verdict == Verdict::not_tested) {
    if (r.not_tested.empty()) return title + "the gyros show no effect; " + d.reason + ".";
    return fmt::format("{}the data determine nothing to be judged: {}{}.", title, r.not_tested,
                       r.base.converged ? "; " + error_text(r.final.errors) : "");
  }
  return title + (d.verdict == Verdict::clean ? "the 21 parameters explain the data: " : "") +
         error_text(r.final.errors) + "; " + remainder_text(r) + "; " + d.reason + " (" +
         counted(std::ssize(data.rests), "rest") + ").";
}

struct Rows {  // residuals of one system, by rest
  std::vector<double> norm;
  std::vector<Vector3d> gyro;
  std::vector<Eigen::Vector2d> direction;  // from the leg before the rest; NaN: none
};
Rows rows_of(const RestSystem& system, std::size_t rests) {
  Rows rows;
  rows.norm.assign(rests, no_point);
  rows.gyro.assign(rests, Vector3d::Constant(no_point));
  rows.direction.assign(rests, Eigen::Vector2d::Constant(no_point));
  std::vector<int> gyros(rests, 0), directions(rests, 0);
  for (Eigen::Index k = 0; k < system.residual.size(); ++k) {
    const auto at = std::size_t(k);
    const auto owner = std::size_t(system.owner[at]);
    switch (system.kind[at]) {
      case RestKind::norm: rows.norm[owner] = system.residual[k]; break;
      case RestKind::gyro: rows.gyro[owner][gyros[owner]++] = system.residual[k]; break;
      case RestKind::direction: rows.direction[owner + 1][directions[owner + 1]++] = system.residual[k]; break;
    }
  }
  return rows;
}

struct BothRows {
  Rows before, after;
};
BothRows both_rows(const RestDiagnosis& r, const RestData& data) {
  return {rows_of(rest_system_at(data, r.diagnosis.base), data.rests.size()),
          rows_of(rest_system_at(data, r.diagnosis.extended), data.rests.size())};
}

double middle_s(const Rest& rest) { return rest.start_s + 0.5 * rest.whole.duration_s; }

// Returns the error rows; the left-out errors are those of the second recording if there is one.
std::vector<ErrorRow> error_rows(const RestDiagnosis& r) {
  const Diagnosis& d = r.diagnosis;
  std::vector<ErrorRow> rows;
  const auto add = [&](const std::string& where, const RestErrors& was, const RestErrors& is, double before,
                       double after) {
    rows.push_back({where + "gravity direction after a rotation rms", 1e3 * was.direction_rms_rad,
                    1e3 * is.direction_rms_rad, "mrad", false});
    rows.push_back({where + "gyros at rest rms", was.gyro_rms_radps / rad_per_deg, is.gyro_rms_radps / rad_per_deg,
                    "deg/s", false});
    rows.push_back(
        {where + "gravity norm at rest rms", 1e3 * was.norm_rms_mps2, 1e3 * is.norm_rms_mps2, "mm/s^2", false});
    rows.push_back({where + "normalised residual rms", before, after, "model expects 1", true});
  };
  add("fitted: ", r.base.errors, r.final.errors, d.error_before, d.error_after);
  add(r.second_recording ? "second recording: " : "cross-validation: ", r.held_out_before, r.held_out_after,
      d.holdout_before.normalised_rms, d.holdout_after.normalised_rms);
  return rows;
}

std::string noise_line(const RestDiagnosis& r) {
  const NoiseModel& n = r.diagnosis.extended.noise;
  const auto times = [&](RestKind kind) { return significant(r.final.white_ratio[std::size_t(kind)], 2); };
  return fmt::format(
      "white, measured in the rests: gyros {} °/√h, accelerometers {} µg/√Hz; residual over it: direction {}, gyros "
      "{}, norm {}",
      significant(n.angle_random_walk.mean() / radprs_per_degprh, 3),
      significant(n.velocity_random_walk.mean() / mpsprs_per_ugprHz, 3), times(RestKind::direction),
      times(RestKind::gyro), times(RestKind::norm));
}

// Returns for each rest its residuals before and after, as errors of the sensors, and their possible causes. accel: the error of the
// norm, assigned to each axis that carries more than half of gravity; tilt: of the direction after the last rotation; NaN: none.
std::vector<DwellResidual> rest_residuals(const RestDiagnosis& r, const RestData& data) {
  const CompressedRecording& recording = *data.recording;
  const SensorModel model = sensor_model(r.diagnosis.extended.parameters, recording.info);
  const BothRows rows = both_rows(r, data);
  std::vector<DwellResidual> result;
  for (std::size_t k = 0; k < data.rests.size(); ++k) {
    const Rest& rest = data.rests[k];
    DwellResidual d;
    d.segment = recording.blocks[rest.whole.first_block].segment;
    d.time_s = middle_s(rest);
    d.table_deg.setConstant(no_point);
    const Vector3d f = model.accel_scale * rest.whole.accel - model.accel_bias_mps2;
    d.f_b_g = f / standard_gravity_mps2;
    d.level_share.setOnes();
    double temperature = 0.0;
    for (std::size_t b = rest.whole.first_block; b < rest.whole.end_block; ++b)
      temperature += recording.blocks[b].temperature_c;
    d.temperature_c =
        recording.info.has_temperature ? temperature / double(rest.whole.end_block - rest.whole.first_block) : no_point;
    if (k > 0)
      for (std::size_t b = data.legs[k - 1].first_block; b < data.legs[k - 1].end_block; ++b)
        d.add_turn(recording.blocks[b], model);
    const Vector3d u = f.normalized();
    const Vector3d v = (model.accel_scale * rest.first_edge.accel - model.accel_bias_mps2).normalized();
    const auto fill = [&](const Rows& from, DwellResidual::Side& side) {
      side.velocity_mps.setConstant(no_point);
      side.gyro_radps = from.gyro[k];
      side.tilt_rad = v.cross(axes_across(v).transpose() * from.direction[k]);
      for (int axis = 0; axis < 3; ++axis) {
        side.accel_mps2[axis] = std::abs(u[axis]) > loaded_share ? from.norm[k] / u[axis] : no_point;
        if (1.0 - v[axis] * v[axis] < level_share) side.tilt_rad[axis] = no_point;
      }
    };
    fill(rows.before, d.before);
    fill(rows.after, d.after);
    result.push_back(d);
  }
  return result;
}

Figure rest_time_figure(const RestDiagnosis& r, const RestData& data) {
  const BothRows rows = both_rows(r, data);
  Figure figure{.id = "time", .label = "Errors of gravity's direction and norm and of the gyros at rest, against time"};
  figure.caption =
      "One point a rest. Direction: the angle between gravity as the rotation before the rest predicts it and as the "
      "accelerometers see it. Gyros: length of the rate vector that is left at rest.";
  figure.panel_height = 170;
  figure.stacked = true;
  struct Shown {
    const char* label;
    double (*of)(const Rows&, std::size_t);
  };
  static constexpr Shown quantities[] = {
      {"direction, mrad", [](const Rows& x, std::size_t k) { return 1e3 * x.direction[k].norm(); }},
      {"gyros, °/s", [](const Rows& x, std::size_t k) { return x.gyro[k].norm() / rad_per_deg; }},
      {"norm, mm/s²", [](const Rows& x, std::size_t k) { return 1e3 * x.norm[k]; }}};
  const bool both = !r.diagnosis.extended.effects.empty();
  for (const Shown& quantity : quantities) {
    Panel panel;
    if (figure.panels.size() + 1 == std::size(quantities)) panel.x_label = "time, s";
    panel.y_label = quantity.label;
    panel.series = before_after_series(both);
    for (std::size_t s = 0; s < panel.series.size(); ++s) {
      panel.series[s].style = both && s == 0 ? Series::Style::open_circle : Series::Style::dot;
      for (std::size_t k = 0; k < data.rests.size(); ++k) {
        const double y = quantity.of(s == 0 ? rows.before : rows.after, k);
        panel.series[s].points.emplace_back(middle_s(data.rests[k]), y);  // NaN before the first rotation
      }
    }
    figure.panels.push_back(std::move(panel));
  }
  return figure;
}

Document document_of(const RestDiagnosis& r, const RestData& data, const DiagnosisContext& context,
                     const std::vector<ErrorRow>& errors) {
  const Diagnosis& d = r.diagnosis;
  DiagnosisParts parts;
  parts.sentence = sentence_of(r, data);
  parts.errors = errors;
  parts.time_title = "Residuals against time";
  parts.time = rest_time_figure(r, data);
  parts.residuals = rest_residuals(r, data);
  parts.one_point = "One point a rest: the excess reading of the gyro, or the tilt that the rotation before it left.";
  parts.one_point_accel =
      "One point a rest in which the axis carries more than half of gravity: the error of the norm, ascribed to that "
      "axis.";
  parts.nothing_shown = "No single rest shows the residual.";
  parts.residual_intro = "The residual of each rest against what it may depend on:";
  if (!r.not_tested.empty()) parts.not_scored = "No effect was looked for: " + r.not_tested + ".";
  parts.score_caption = "Scores with only the 21 parameters in the model.";
  parts.noise_line = noise_line(r);
  parts.noise.add(Paragraph{parts.noise_line + "."}, Scope::page);
  parts.reading = how_to_read_rests;
  return diagnosis_document(d, context, std::move(parts));
}

}  // namespace

std::string error_text(const RestErrors& e) {
  return fmt::format("gravity norm at rest {} mm/s² rms, direction after a rotation {} mrad, gyros at rest {} °/s",
                     significant(1e3 * e.norm_rms_mps2, 3), significant(1e3 * e.direction_rms_rad, 3),
                     significant(e.gyro_rms_radps / rad_per_deg, 3));
}

void describe_rest_fit(const RestFit& fit, const JointResult& joint, const RestData& data, ParameterFile& file) {
  describe_model(joint, *data.recording, file);
  describe_random_walk(joint.noise, file);
  const auto errors = [&](const std::string& key, const RestErrors& e) {
    file.add_further("quality." + key + ".norm_rms_mps2", e.norm_rms_mps2);
    file.add_further("quality." + key + ".direction_rms_rad", e.direction_rms_rad);
    file.add_further("quality." + key + ".gyro_rms_degps", e.gyro_rms_radps / rad_per_deg);
  };
  errors("fitted", fit.errors);
  errors("left_out", fit.left_out);
  file.add_further("quality.rests", double(data.rests.size()));
}

DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& r, const RestData& data, const DiagnosisContext& context) {
  const Diagnosis& d = r.diagnosis;
  DiagnosisFiles files{begin_document(d, context, verdict_sentence(d)), format_diagnosis(d), std::nullopt};
  if (!r.base.converged) return files;  // no fit: only the reason is reported
  const std::vector<ErrorRow> errors = error_rows(r);
  for (const ErrorRow& row : errors)
    if (!row.normalised)
      files.conf += fmt::format("# {}: {} before, {} after, {}\n", row.what, format_number(row.before),
                                format_number(row.after), row.unit);
  files.report = document_of(r, data, context, errors);
  if (d.verdict == Verdict::not_tested) return files;
  files.parameters.emplace();
  describe_recording(context.recording.info, *files.parameters);
  describe_rest_fit(r.final, d.extended, data, *files.parameters);
  complete_parameters(d, context, *files.parameters);
  return files;
}

}  // namespace turncal
