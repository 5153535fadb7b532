// turncal._turncal: libturncal in tuples and arrays. turncal/__init__.py gives them names and units for users.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstddef>
#include <tuple>

#include <turncal/allan.h>
#include <turncal/calibrate.h>
#include <turncal/diagnose.h>
#include <turncal/predict.h>

namespace {

namespace py = pybind11;
using namespace turncal;
using Unlocked = py::call_guard<py::gil_scoped_release>;

// Returns one field of every sample as a read-only view; the array keeps `self` alive.
template <class T>
auto field(std::size_t offset, py::ssize_t columns = 0) {
  return [=](const py::object& self) {
    const std::span<const Sample> samples = self.cast<const Recording&>().samples();
    std::vector<py::ssize_t> shape = {static_cast<py::ssize_t>(samples.size())}, strides = {sizeof(Sample)};
    if (columns > 0) shape.push_back(columns), strides.push_back(sizeof(T));
    py::array array(py::dtype::of<T>(), shape, strides, reinterpret_cast<const std::byte*>(samples.data()) + offset,
                    self);
    array.attr("flags").attr("writeable") = false;
    return array;
  };
}

// Numbers where they are numbers.
std::vector<std::pair<std::string, py::object>> typed(const std::vector<std::pair<std::string, std::string>>& items) {
  const py::gil_scoped_acquire locked;
  std::vector<std::pair<std::string, py::object>> all;
  for (const auto& item : items) {
    const std::optional<double> number = number_of(item);
    all.emplace_back(item.first, number ? py::object(py::float_(*number)) : py::object(py::str(item.second)));
  }
  return all;
}

auto calibrate_all(const std::vector<Recording>& recordings, const std::string& method, bool partial,
                   const std::string& time) {
  Calibration c = calibrate(recordings, {method, partial, time});
  return std::tuple(c.parameters, c.notes, c.distrust, c.report);
}

auto diagnose_all(const std::vector<Recording>& recordings, const std::vector<Recording>& holdouts,
                  const std::string& time) {
  Diagnosis d = diagnose(recordings, {holdouts, time});
  return std::tuple(d.verdict, d.effects, d.parameters, typed(d.items), d.text, d.report);
}

// Points: tau, deviation, low, high, degrees. Coefficients: value, sigma, limit.
auto allan_of(const Recording& recording) {
  Allan a = allan(recording);
  std::vector<std::pair<std::vector<std::array<double, 5>>, std::vector<std::array<double, 3>>>> axes(6);
  for (std::size_t k = 0; k < 6; ++k) {
    for (const AllanPoint& p : a.axes[k].points)
      axes[k].first.push_back({p.tau_s, p.deviation, p.low, p.high, p.degrees});
    for (const AllanCoefficient& c : a.axes[k].coefficients) axes[k].second.push_back({c.value, c.sigma, c.limit});
  }
  return std::tuple(axes, a.rest_s, a.csv, a.imu_yaml, a.report);
}

auto predict_all(const std::vector<std::string>& files, const std::string& station, std::optional<double> latitude_deg,
                 std::optional<double> gravity_mps2, double arw, double vrw, double gyro_bias, double accel_bias,
                 bool effects) {
  Prediction p = predict(files, {station, latitude_deg, gravity_mps2, arw, vrw, gyro_bias, accel_bias, effects});
  std::vector<std::tuple<std::string, double, double, std::array<double, 24>, std::string>> sequences;
  for (const SequencePrediction& s : p.sequences)
    sequences.emplace_back(s.name, s.station_s, s.static_s, s.sigma, s.refused);
  return std::tuple(sequences, p.report);
}

PyObject* error_of = nullptr;  // a Python function: (exit code, line) -> exception

}  // namespace

PYBIND11_MODULE(_turncal, m) {
  m.def("set_error", [](const py::function& make) { error_of = py::function(make).release().ptr(); });
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      const py::object made = py::handle(error_of)(error.exit_code(), error.what());
      PyErr_SetObject(py::type::handle_of(made).ptr(), made.ptr());
    }
  });
  py::class_<Report>(m, "Report")
      .def("text", &Report::text, Unlocked())
      .def("json", &Report::json, Unlocked())
      .def("html", &Report::html, Unlocked());
  // Each as one tuple, in the order of the names in turncal/__init__.py; kinds as numbers.
  py::class_<Recording>(m, "Recording")
      .def_static("load", &Recording::load, Unlocked())
      .def_static("import_table", &Recording::import_table, Unlocked())
      .def("with_rests", &Recording::with_rests, Unlocked())
      .def("hash", &Recording::hash, Unlocked())
      .def("path", &Recording::path)
      .def("damage", &Recording::damage)
      .def("notes", &Recording::notes)
      .def("info",
           [](const Recording& r) {
             const RecordingInfo i = r.info();
             return py::make_tuple(i.sample_period_s, i.latitude_deg, i.gravity_mps2, i.unit_serial,
                                   int(i.gyro_increment), int(i.accel_increment), i.accel_pulse_mps, i.has_temperature,
                                   i.started_utc_s, i.simulated);
           })
      .def("segments",
           [](const Recording& r) {
             py::list all;
             for (const Segment& s : r.segments())
               all.append(py::make_tuple(s.step, int(s.kind), s.start_sample, s.end_sample, s.heading_deg, s.pitch_deg,
                                         s.roll_deg));
             return all;
           })
      .def_property_readonly("counter", field<std::int64_t>(offsetof(Sample, counter)))
      .def_property_readonly("gyro", field<double>(offsetof(Sample, gyro), 3))
      .def_property_readonly("accel", field<double>(offsetof(Sample, accel), 3))
      .def_property_readonly("temperature_c", field<float>(offsetof(Sample, temperature_c)))
      .def_property_readonly("flags", field<std::uint32_t>(offsetof(Sample, flags)));
  py::class_<Parameters>(m, "Parameters")
      .def_static("read", &Parameters::read, Unlocked())
      .def_static("parse", &Parameters::parse)
      .def("write", &Parameters::write, Unlocked())
      .def("text", &Parameters::text)
      .def("items", [](const Parameters& p) { return typed(p.items()); })
      .def("values", &Parameters::values)
      .def("sigmas", &Parameters::sigmas)
      .def("trusted", &Parameters::trusted);
  const auto keys = parameter_keys();
  m.attr("parameter_keys") = std::vector<std::string>(keys.begin(), keys.end());
  m.def("apply", &apply, Unlocked());
  m.def("calibrate", &calibrate_all, Unlocked());
  m.def("diagnose", &diagnose_all, Unlocked());
  m.def("allan", &allan_of, Unlocked());
  m.def("predict", &predict_all, Unlocked());
}
