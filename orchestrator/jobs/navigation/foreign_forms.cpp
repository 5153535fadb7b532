#include "orchestrator/jobs/navigation/foreign_forms.h"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "calib/model/parameters.h"
#include "imu_io/base/text.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double milli_gal = 1e-5;  // m/s^2

Matrix3d axes(std::initializer_list<double> rows) { return Eigen::Map<const Matrix3d>(rows.begin()).transpose(); }
const Matrix3d right_front_up = axes({0, 0, 1, 1, 0, 0, 0, 1, 0});
const Matrix3d front_right_down = axes({1, 0, 0, 0, 0, 1, 0, -1, 0});

template <class Numbers>
std::string row_text(const Numbers& numbers, const char* between = ", ") {
  std::vector<std::string> words;
  for (Eigen::Index k = 0; k < numbers.size(); ++k) words.push_back(format_number(numbers[k]));
  return join(words, between);
}
std::string yaml_rows(const std::string& key, const Matrix3d& M, const std::string& indent) {
  std::string text = indent + key + ":\n";
  for (Eigen::Index k = 0; k < 3; ++k) text += indent + "  - [" + row_text(Vector3d(M.row(k))) + "]\n";
  return text;
}
std::string yaml_list(const std::string& key, const Vector3d& v, const char* unit) {
  return key + ": [" + row_text(v) + "]  # " + unit + "\n";
}

// Lists, as comments, what the form cannot hold: effects except those in `held`, and `more`.
std::string not_held(const ForeignCalibration& of, const char* mark, const std::string& more,
                     std::initializer_list<std::string_view> held = {}) {
  std::vector<std::string> missing;
  if (!more.empty()) missing.push_back(more);
  if (of.file.temperature && std::ranges::find(held, "temperature") == held.end())
    missing.push_back(fmt::format("temperature (all is at {} C)", format_number(of.file.temperature->reference_c)));
  for (const EffectValue& effect : of.file.effects)
    if (std::ranges::find(held, effect.name) == held.end() && (missing.empty() || missing.back() != effect.name))
      missing.push_back(effect.name);
  std::string text =
      fmt::format("{} turncal, unit {}{}{}\n", mark, of.file.unit_serial, of.file.simulated ? ", simulated" : "",
                  is_trusted(of.file) ? "" : ", not trusted: " + why_not_trusted(of.file));
  return text + mark + " not held: " + (missing.empty() ? "nothing" : join(missing)) + "\n";
}

// Factors X = M C, with M lower triangular with a positive diagonal and C orthogonal.
std::pair<Matrix3d, Matrix3d> lower_times_rotation(const Matrix3d& X) {
  const Eigen::HouseholderQR<Matrix3d> qr(X.transpose());
  const Matrix3d R = qr.matrixQR().triangularView<Eigen::Upper>();
  const Vector3d sign = R.diagonal().cwiseSign();
  return {R.transpose() * sign.asDiagonal(), sign.asDiagonal() * Matrix3d(qr.householderQ()).transpose()};
}

double effect_of(const ForeignCalibration& of, const std::string& name, const std::string& component) {
  for (const EffectValue& effect : of.file.effects)
    if (effect.name == name && effect.component == component) return effect.value;
  return 0.0;
}

Matrix3d nine_of(const ForeignCalibration& of, const std::string& name, const std::string& between) {
  Matrix3d M;
  for (Eigen::Index i = 0; i < 3; ++i)
    for (Eigen::Index j = 0; j < 3; ++j) M(i, j) = effect_of(of, name, "xyz"[i] + between + "xyz"[j]);
  return M;
}

// Kalibr's model: raw = M C v + bias, M lower triangular, and C = 1 for the accelerometers: its axes i are b turned by C_i_b. gyro_of_f f_i is the
// part of raw_w due to specific force: S_g raw_w = w_b + N0 + G f_b.
struct LowerTriangular {
  Matrix3d accel_M, C_i_b, gyro_M, C_gyro_i, gyro_of_f;
  explicit LowerTriangular(const ForeignCalibration& of) {
    std::tie(accel_M, C_i_b) = lower_times_rotation(of.accel.inverse());
    std::tie(gyro_M, C_gyro_i) = lower_times_rotation(of.gyro.inverse() * C_i_b.transpose());
    const Matrix3d G = nine_of(of, "gyro_g_sensitivity", "") * radps_per_degph / standard_gravity_mps2;
    gyro_of_f = of.gyro.inverse() * G * C_i_b.transpose();
  }
};

std::string not_seen(const std::string& key) {
  return "# " + key + ": not seen in the calibration; `turncal allan` of a long rest has it or its limit\n";
}

// Returns continuous noise densities, and the random walk that drives the Gauss-Markov process of the file's bias instability.
std::string densities(const ForeignCalibration& of, const std::string& indent) {
  std::string text;
  const double drive = std::sqrt(2.0 / of.noise.bias_correlation_s);
  for (const auto& [triad, walk, bias] :
       {std::tuple{"accelerometer", &of.noise.velocity_random_walk, of.noise.accel_bias_instability_mps2},
        std::tuple{"gyroscope", &of.noise.angle_random_walk, of.noise.gyro_bias_instability_radps}}) {
    text += fmt::format("{}{}_noise_density: {}\n", indent, triad, format_number(walk->norm() / std::sqrt(3.0)));
    text += bias > 0.0 ? fmt::format("{}{}_random_walk: {}\n", indent, triad, format_number(bias * drive))
                       : indent + not_seen(fmt::format("{}_random_walk", triad));
  }
  return text + fmt::format("{}rostopic: /imu0\n{}update_rate: {}\n", indent, indent,
                            format_number(std::round(1e3 / of.file.sample_period_s) / 1e3));
}

std::string biases(const ForeignCalibration& of, const Matrix3d& accel_turn, const Matrix3d& gyro_turn,
                   const std::string& indent) {
  return indent + yaml_list("# bias of the raw gyros", gyro_turn * of.gyro_bias_radps, "rad/s") + indent +
         yaml_list("# bias of the raw accelerometers", accel_turn * of.accel_bias_mps2, "m/s^2");
}

std::string kalibr(const ForeignCalibration& of) {
  const LowerTriangular model(of);
  return not_held(of, "#", "biases (estimated by Kalibr; here as comments)", {"gyro_g_sensitivity"}) +
         "# raw_f = M f_i + bias, raw_w = M C_gyro_i w_i + A C_gyro_i f_i + bias; f_i = C_i_b f_b, b: x front, y up, z "
         "right\n"
         "imu0:\n  model: scale-misalignment\n" +
         densities(of, "  ") + "  accelerometers:\n" + yaml_rows("M", model.accel_M, "    ") + "  gyroscopes:\n" +
         yaml_rows("M", model.gyro_M, "    ") + yaml_rows("A", model.gyro_of_f * model.C_gyro_i.transpose(), "    ") +
         yaml_rows("C_gyro_i", model.C_gyro_i, "    ") + "  # of turncal, for whoever goes back to b\n" +
         yaml_rows("C_i_b", model.C_i_b, "  ") + biases(of, of.accel.inverse(), of.gyro.inverse(), "  ");
}

std::string open_vins(const ForeignCalibration& of) {
  const LowerTriangular model(of);
  return "%YAML:1.0\n" + not_held(of, "#", "biases (estimated by OpenVINS; here as comments)", {"gyro_g_sensitivity"}) +
         "# raw_w = Tw R_IMUtoGYRO w_i + Tg f_i + bias, raw_f = Ta f_i + bias; f_i = C_i_b f_b, b: x front, y up, z "
         "right\n"
         "imu0:\n" +
         densities(of, "  ") + "  model: \"kalibr\"\n" + yaml_rows("Tw", model.gyro_M, "  ") +
         yaml_rows("R_IMUtoGYRO", model.C_gyro_i, "  ") + yaml_rows("Ta", model.accel_M, "  ") +
         yaml_rows("R_IMUtoACC", Matrix3d::Identity(), "  ") + yaml_rows("Tg", model.gyro_of_f, "  ") +
         "  # of turncal, for whoever goes back to b\n" + yaml_rows("C_i_b", model.C_i_b, "  ") +
         biases(of, of.accel.inverse(), of.gyro.inverse(), "  ");
}

std::string psins(const ForeignCalibration& of) {
  const Matrix3d& P = right_front_up;
  const auto of_axes = [&](const std::string& name) {
    return Vector3d(P * Vector3d(effect_of(of, name, "x"), effect_of(of, name, "y"), effect_of(of, name, "z")));
  };
  const auto nine = [&](const std::string& name, const std::string& between) {
    return Matrix3d(P * nine_of(of, name, between) * P.transpose());
  };
  const auto matrix = [](const char* name, const Matrix3d& M, const char* unit) {
    std::string text = fmt::format("{} = [\n", name);
    for (Eigen::Index k = 0; k < 3; ++k) text += "\t" + row_text(Vector3d(M.row(k)), " \t") + "\n";
    return text + "\t];" + unit + "\n";
  };
  const auto vector = [](const char* name, const Vector3d& v, const char* unit) {
    return fmt::format("{} = [\n\t{}\n\t]; \t% {}\n", name, row_text(v, " \t"), unit);
  };
  const Matrix3d arms = 0.1 * nine("accel_size_effect", "_r");
  return not_held(of, "%", "noise",
                  {"accel_second_order", "accel_scale_asymmetry", "accel_size_effect", "accel_delay",
                   "gyro_g_sensitivity"}) +
         "% axes right, front, up; w = Kg raw - eb, f = Ka raw - db, further terms taken off\n" +
         matrix("Kg", P * of.gyro * P.transpose(), "") +
         vector("eb", P * of.gyro_bias_radps / radps_per_degph, "deg/h") +
         matrix("Ka", P * of.accel * P.transpose(), "") +
         vector("db", P * of.accel_bias_mps2 / mpsprs_per_ugprHz, "ug") +
         vector("Ka2", of_axes("accel_second_order"), "ug/g^2") +
         vector("Kap", of_axes("accel_scale_asymmetry"), "ppm") + vector("rx", arms.row(0), "cm") +
         vector("ry", arms.row(1), "cm") + vector("rz", arms.row(2), "cm") +
         fmt::format("tGA = [\n\t{}\n\t]; \t% ms\n", format_number(effect_of(of, "accel_delay", "tau"))) +
         matrix("gSens", nine("gyro_g_sensitivity", ""), " \t% deg/h/g");
}

// Returns s of raw = (1 + s) v + bias, axis by axis.
Vector3d scale_errors(const Matrix3d& S) { return (1.0 / S.diagonal().array() - 1.0).matrix(); }

std::string kf_gins(const ForeignCalibration& of) {
  const Matrix3d& P = front_right_down;
  const auto turned = [&](const Vector3d& v) { return Vector3d((P * v).cwiseAbs()); };
  const auto sigma = [&](std::size_t first, std::size_t step, double unit) {
    Vector3d of_axis;
    for (Eigen::Index k = 0; k < 3; ++k) of_axis[k] = of.file.sigma[first + step * std::size_t(k)].value_or(0.0) * unit;
    return turned(of_axis);
  };
  const auto instability = [](const std::string& key, double value, const char* unit) {
    return "  " + (value > 0.0 ? yaml_list(key, Vector3d::Constant(value), unit) : not_seen(key));
  };
  const Vector3d scale_g = scale_errors(of.gyro), scale_a = scale_errors(of.accel);
  return not_held(of, "#", "misalignment (n_ij, a_ij)") +
         "# axes front, right, down; v = (raw - bias) / (1 + scale)\n" +
         yaml_list("initgyrbias",
                   P * of.gyro.diagonal().cwiseInverse().cwiseProduct(of.gyro_bias_radps) / radps_per_degph, "deg/h") +
         yaml_list("initaccbias", P * of.accel.diagonal().cwiseInverse().cwiseProduct(of.accel_bias_mps2) / milli_gal,
                   "mGal") +
         yaml_list("initgyrscale", P.cwiseAbs() * scale_g * 1e6, "ppm") +
         yaml_list("initaccscale", P.cwiseAbs() * scale_a * 1e6, "ppm") +
         yaml_list("initbgstd", sigma(0, 1, 1.0), "deg/h, sigma of the calibration") +
         yaml_list("initbastd", sigma(3, 1, standard_gravity_mps2 / milli_gal), "mGal") + "imunoise:\n" +
         yaml_list("  arw", turned(of.noise.angle_random_walk / radprs_per_degprh), "deg/sqrt(hr)") +
         yaml_list("  vrw", turned(of.noise.velocity_random_walk * 60.0), "m/s/sqrt(hr)") +
         instability("gbstd", of.noise.gyro_bias_instability_radps / radps_per_degph, "deg/hr") +
         instability("abstd", of.noise.accel_bias_instability_mps2 / milli_gal, "mGal") +
         yaml_list("  gsstd", sigma(6, 4, 1e6 / of.file.parameters[6]), "ppm") +
         yaml_list("  asstd", sigma(15, 4, 1e6), "ppm") +
         fmt::format("  corrtime: {}  # hr\n", format_number(of.noise.bias_correlation_s / 3600.0));
}

std::string ros(const ForeignCalibration& of) {
  const auto diagonal = [&](const char* key, const Vector3d& density, double pulse) {
    const double dt = of.file.sample_period_s;
    const Vector3d v = (density.cwiseAbs2() / dt).array() + pulse * pulse / (6.0 * dt * dt);
    return fmt::format("{}: [{}, 0, 0, 0, {}, 0, 0, 0, {}]\n", key, format_number(v[0]), format_number(v[1]),
                       format_number(v[2]));
  };
  return not_held(of, "#", "all but the noise of a sample; turncal apply --as rates calibrates the samples") +
         "# sensor_msgs/Imu, by rows; axes b: x front, y up, z right; N^2 / dt + (pulse / dt)^2 / 6, SI\n"
         "orientation_covariance: [-1, 0, 0, 0, 0, 0, 0, 0, 0]\n" +
         diagonal("angular_velocity_covariance", of.noise.angle_random_walk, of.noise.gyro_pulse_rad) +
         diagonal("linear_acceleration_covariance", of.noise.velocity_random_walk, of.noise.accel_pulse_mps);
}

// Offsets subtracted from the raw readings of gyros and accelerometers, front, right, down: (rad/s, m/s^2).
using Offsets = Eigen::Matrix<double, 6, 1>;
Offsets offsets(const ForeignCalibration& of) {
  Offsets o;
  o << front_right_down * of.gyro.diagonal().cwiseInverse().cwiseProduct(of.gyro_bias_radps),
      front_right_down * of.accel.diagonal().cwiseInverse().cwiseProduct(of.accel_bias_mps2);
  return o;
}

// Returns the change of the offsets at T from those at the file's reference: c_1 x + c_2 x^2 + c_3 x^3, x = T - about_c, a row an offset. When
// scale factors vary, too, the offsets are not cubic, and this is the least-squares fit in the range.
Eigen::Matrix<double, 6, 3> offset_cubics(const ForeignCalibration& of, double about_c) {
  const TemperaturePolynomials& t = *of.file.temperature;
  constexpr Eigen::Index points = 21;
  Eigen::MatrixXd powers(points, 4), values(points, 6);
  for (Eigen::Index k = 0; k < points; ++k) {
    const double at = t.low_c + (t.high_c - t.low_c) * double(k) / (points - 1), x = at - about_c;
    ParameterFile there = of.file;
    there.parameters = t.at(of.file.parameters, at);
    powers.row(k) << 1.0, x, x * x, x * x * x;
    const Result<ForeignCalibration> hot = foreign_calibration(there, of.path);
    values.row(k) = hot ? offsets(*hot).transpose() : offsets(of).transpose();
  }
  const Eigen::MatrixXd c = Eigen::HouseholderQR<Eigen::MatrixXd>(powers).solve(values);
  return c.bottomRows<3>().transpose();
}

std::string not_in_autopilot(const ForeignCalibration& of) {
  return std::string(of.file.temperature ? "accelerometer scale factors at other temperatures, " : "") +
         "gyro scale factors, misalignment (n_ij, a_ij), noise";
}

// Thermal offsets are subtracted in addition to the others, which hold the values at the reference temperature.
std::string px4_temperature(const ForeignCalibration& of) {
  const TemperaturePolynomials& t = *of.file.temperature;
  const Eigen::Matrix<double, 6, 3> c = offset_cubics(of, t.reference_c);
  std::string text = "# TC_G0_ID and TC_A0_ID: the ids of the sensors, CAL_GYRO0_ID and CAL_ACC0_ID\n";
  const auto line = [&text](const std::string& name, const std::string& value, int type) {
    text += fmt::format("1\t1\tTC_{}\t{}\t{}\n", name, value, type);
  };
  for (Eigen::Index s = 0; s < 2; ++s) {
    const std::string sensor = s == 0 ? "G" : "A";
    line(sensor + "_ENABLE", "1", 6);
    for (Eigen::Index k = 0; k < 3; ++k)
      for (Eigen::Index order = 0; order <= 3; ++order)
        line(fmt::format("{}0_X{}_{}", sensor, order, k), format_number(order == 0 ? 0.0 : c(3 * s + k, order - 1)), 9);
    for (const auto& [name, value] :
         {std::pair{"TREF", t.reference_c}, std::pair{"TMIN", t.low_c}, std::pair{"TMAX", t.high_c}})
      line(sensor + "0_" + name, format_number(value), 9);
  }
  return text;
}

// ArduPilot's cubics are about 35 C and scaled by 10^6; its offsets are those at CALTEMP.
std::string ardupilot(const ForeignCalibration& of) {
  constexpr double about_c = 35.0;
  const Offsets o = offsets(of);
  const Vector3d scale = front_right_down.cwiseAbs() * of.accel.diagonal();
  std::string text = not_held(of, "#", not_in_autopilot(of), {"temperature"}) +
                     "# axes front, right, down; w = raw - GYROFFS, f = (raw - ACCOFFS) ACCSCAL\n";
  const auto line = [&text](const std::string& name, double value) {
    text += fmt::format("INS_{},{}\n", name, format_number(value));
  };
  if (const auto& t = of.file.temperature) {
    const Eigen::Matrix<double, 6, 3> c = 1e6 * offset_cubics(of, about_c);
    line("TCAL1_ENABLE", 1.0), line("TCAL1_TMIN", t->low_c), line("TCAL1_TMAX", t->high_c);
    line("ACC1_CALTEMP", t->reference_c), line("GYR1_CALTEMP", t->reference_c);
    for (Eigen::Index k = 0; k < 6; ++k)
      for (Eigen::Index order = 0; order < 3; ++order)
        line(fmt::format("TCAL1_{}{}_{}", k < 3 ? "GYR" : "ACC", order + 1, "XYZ"[k % 3]), c(k, order));
  }
  for (Eigen::Index k = 0; k < 3; ++k) {
    line(fmt::format("GYROFFS_{}", "XYZ"[k]), o[k]);
    line(fmt::format("ACCOFFS_{}", "XYZ"[k]), o[3 + k]);
    line(fmt::format("ACCSCAL_{}", "XYZ"[k]), scale[k]);
  }
  return text;
}

std::string px4(const ForeignCalibration& of) {
  const Matrix3d& P = front_right_down;
  const Offsets o = offsets(of);
  const Vector3d gyro = o.head<3>(), accel = o.tail<3>(), scale = P.cwiseAbs() * of.accel.diagonal();
  std::string text =
      not_held(of, "#", not_in_autopilot(of), {"temperature"}) +
      "# axes front, right, down; w = raw - OFF, f = (raw - OFF) SCALE; lines: system, component, name, value, type\n";
  for (Eigen::Index k = 0; k < 3; ++k)
    for (const auto& [name, value] :
         {std::pair{"GYRO0_{}OFF", gyro[k]}, std::pair{"ACC0_{}OFF", accel[k]}, std::pair{"ACC0_{}SCALE", scale[k]}})
      text += fmt::format("1\t1\tCAL_{}\t{}\t9\n", fmt::format(fmt::runtime(name), "XYZ"[k]), format_number(value));
  return text + (of.file.temperature ? px4_temperature(of) : "");
}

}  // namespace

const std::array<ForeignForm, 7> foreign_forms = {{{"kalibr", kalibr, true},
                                                   {"open_vins", open_vins, true},
                                                   {"psins", psins, false},
                                                   {"kf_gins", kf_gins, true},
                                                   {"ros", ros, true},
                                                   {"px4", px4, false},
                                                   {"ardupilot", ardupilot, false}}};

Result<ForeignCalibration> foreign_calibration(const ParameterFile& file, const std::string& path) {
  RecordingInfo info;
  info.sample_period_s = file.sample_period_s;
  info.gyro_increment = file.gyro_increment;
  info.accel_increment = file.accel_increment;
  info.accel_pulse_mps = file.accel_pulse_mps;
  const SensorModel model = sensor_model(from_vector(file.parameters), info);
  const double pulse = file.accel_increment == IncrementKind::pulses ? file.accel_pulse_mps : 1.0;
  return ForeignCalibration{file,
                            path,
                            model.gyro_scale / nominal_gyro_rad(info),
                            model.accel_scale / pulse,
                            model.gyro_bias_radps,
                            model.accel_bias_mps2,
                            TRY(stored_noise(file, path))};
}

Result<std::string> write_foreign_form(const ParameterFile& file, const std::string& path, const std::string& form) {
  const auto found = std::ranges::find_if(foreign_forms, [&](const ForeignForm& f) { return f.name == form; });
  if (found == foreign_forms.end()) return input_error("'" + form + "' is no form of docs/files.md");
  if (found->needs_noise && !has_noise(file))
    return input_error(path + ": has no noise. keys: expected a calibration that measured the noise, for " + form);
  return found->write(TRY(foreign_calibration(file, path)));
}

}  // namespace turncal
