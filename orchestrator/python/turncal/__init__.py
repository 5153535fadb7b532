"""turncal: calibration of strapdown inertial units. See docs/library.md.

Arrays have the axes x, y, z of the body frame (front, up, right); units are SI, and where a name ends in one (_deg, _degph) that one.
Functions may be called from several threads at once; long ones leave the interpreter free. Nothing is printed.
"""
import collections as _collections
import dataclasses as _dataclasses
import html as _html
import os as _os

import numpy as _np

from . import _turncal

__all__ = ["load", "import_table", "calibrate", "diagnose", "apply", "allan", "predict", "read_parameters", "Recording",
           "RecordingInfo", "Segment", "Parameters", "Report", "Calibration", "Diagnosis", "AllanAxis", "Allan", "SequencePrediction",
           "Prediction", "Error", "InputError", "UnitFailedError", "DeviceError", "parameter_keys"]

parameter_keys = tuple(_turncal.parameter_keys)


class Error(Exception):
    """What went wrong, in the line that the program prints; exit_code is the program's."""
    exit_code = 70


InputError = type("InputError", (Error,), {"exit_code": 1, "__doc__": "A file, a value or data that cannot be used."})
UnitFailedError = type("UnitFailedError", (Error,), {"exit_code": 20, "__doc__": "Data that cannot be believed, or leave parameters open."})
DeviceError = type("DeviceError", (Error,), {"exit_code": 50, "__doc__": "A disk, for one."})
_turncal.set_error(lambda code, line: {1: InputError, 20: UnitFailedError, 50: DeviceError}.get(code, Error)(line))


class Report:
    """A result as people read it: the program's words (text), its page (html()), and json()."""

    def __init__(self, inner):
        self._inner, self.text, self.json = inner, inner.text(), inner.json

    def html(self):
        """A page with style and plots inline; gnuplot draws them."""
        return self._inner.html()

    def _repr_html_(self):
        return f'<iframe srcdoc="{_html.escape(self.html())}" style="width: 100%; height: 40em; border: 0"></iframe>'

    def __repr__(self):
        return self.text


class _Reported:
    _repr_html_ = lambda self: self.report._repr_html_()  # noqa: E731
    __repr__ = lambda self: self.report.text  # noqa: E731


_result = _dataclasses.dataclass(frozen=True, repr=False, eq=False)
# gyro_increment, accel_increment: "pulses" or "physical" (rad, m/s); started_utc_s: since 1970, or None.
RecordingInfo = _collections.namedtuple("RecordingInfo", "sample_period_s latitude_deg gravity_mps2 unit_serial gyro_increment "
                                        "accel_increment accel_pulse_mps has_temperature started_utc_s simulated")
# kind: "align", "static" (both at rest) or "rotate"; counters, the end exclusive; angles of the table at its end.
Segment = _collections.namedtuple("Segment", "step kind start_sample end_sample heading_deg pitch_deg roll_deg")


class _Fixed:
    """Attributes say what is held, and are not assigned."""

    def __setattr__(self, name, value):
        if hasattr(self, name):
            raise AttributeError(f"{type(self).__name__}.{name} cannot be assigned")
        super().__setattr__(name, value)


class Recording(_Fixed):
    """Samples of a unit. The arrays are read-only views of what it holds, and keep that alive:

    counter (n,) int64: the unit's own, a step of more than 1 is a gap
    gyro, accel (n, 3) float64: increments since the sample before, pulses or rad and m/s (info)
    temperature_c (n,) float32, nan: not measured; flags (n,) uint32, 0: good
    damage: what a file has lost, one line; empty: nothing
    notes: what `turncal import` says of a table, and `turncal apply` of the parameters, a line each
    """

    def __init__(self, inner):
        self._inner, self.path, self.damage, self.notes = inner, inner.path(), inner.damage(), tuple(inner.notes())
        self.counter, self.gyro, self.accel = inner.counter, inner.gyro, inner.accel
        self.temperature_c, self.flags = inner.temperature_c, inner.flags
        info, kinds = RecordingInfo(*inner.info()), ("pulses", "physical")
        self.info = info._replace(gyro_increment=kinds[info.gyro_increment], accel_increment=kinds[info.accel_increment])
        self.segments = tuple(Segment(step, ("align", "static", "rotate")[kind], *more) for step, kind, *more in inner.segments())

    @property
    def hash(self):
        """The same for every form of a recording."""
        return self._inner.hash()

    @property
    def time_s(self):
        """(n,) s from the first sample, by the counter."""
        return (self.counter - self.counter[0]) * self.info.sample_period_s

    def with_rests(self, min_rest_s=1.5):
        """The same samples with the rests that `turncal segment` finds: of a unit turned by hand."""
        return Recording(self._inner.with_rests(min_rest_s))

    def __len__(self):
        return len(self.counter)

    def __repr__(self):
        return (f"<turncal.Recording {self.path}: unit {self.info.unit_serial}, {len(self)} samples of {self.info.sample_period_s:g} s, "
                f"{len(self.segments)} segments>")


class Parameters(_Fixed):
    """A parameter file: parameters["N01"] by every key of it; numbers where they are numbers.

    values, sigmas (24,) in the order of parameter_keys, sigma nan: not estimated; N0 (3,) deg/h; A0 (3,) units of 9.80665 m/s^2;
    n (3, 3) arcsec a pulse, or 1 of increments in rad; a (3, 3) of the nominal pulse weight, or 1 of m/s:
    rate = n @ gyro / period - N0, force = a @ accel / period - A0. trusted: its sigmas can be believed; text: of the file.
    """

    def __init__(self, inner):
        self._inner, self.text, self.trusted = inner, inner.text(), inner.trusted()
        self.values, self.sigmas = _np.array(inner.values()), _np.array(inner.sigmas())
        self.N0, self.A0 = self.values[:3], self.values[3:6]
        self.n, self.a = self.values[6:15].reshape(3, 3), self.values[15:].reshape(3, 3)
        for array in (self.values, self.sigmas, self.N0, self.A0, self.n, self.a):
            array.flags.writeable = False
        self._items = dict(inner.items())

    @staticmethod
    def parse(text, name="parameters"):
        """Of the text of a parameter file, whatever it holds."""
        return Parameters(_turncal.Parameters.parse(text, name))

    def write(self, path):
        self._inner.write(_path(path))

    def __reduce__(self):
        return Parameters.parse, (self.text,)

    def __iter__(self):
        return iter(self._items)

    def __len__(self):
        return len(self._items)

    def __contains__(self, key):
        return key in self._items

    def as_dict(self):
        return dict(self._items)

    def __getitem__(self, key):
        return self._items[key]

    def __repr__(self):
        return f"<turncal.Parameters of {self['unit_serial']}, {self['method']}{'' if self.trusted else ', not trusted'}>"


@_result
class Calibration(_Reported):
    """distrust: what speaks against the sigmas (the program then ends with 20); empty: nothing does."""
    parameters: Parameters
    notes: "list[str]"
    distrust: str
    report: Report


@_result
class Diagnosis(_Reported):
    """verdict: clean, extended, unexplained, noise_model or not_tested; effects: added, strongest first; parameters: with them, or None;
    items: of diagnosis.conf, numbers where they are numbers; text: that file."""
    verdict: str
    effects: "list[str]"
    parameters: "Parameters | None"
    items: dict
    text: str
    report: Report


@_dataclasses.dataclass(frozen=True, eq=False)
class AllanAxis:
    """tau_s, deviation, low, high (68.3 %), degrees (of freedom): (points,), rad/s or m/s^2. coefficients, sigmas, limits (95 %): (5,), of
    quantisation, random walk, bias instability, rate random walk, rate ramp: rad or m/s, then per sqrt(s), s, s^1.5, s^2; 0: not seen."""
    tau_s: _np.ndarray
    deviation: _np.ndarray
    low: _np.ndarray
    high: _np.ndarray
    degrees: _np.ndarray
    coefficients: _np.ndarray
    sigmas: _np.ndarray
    limits: _np.ndarray


@_result
class Allan(_Reported):
    """axes: gyro x, y, z, accelerometer x, y, z; rest_s: time at rest; csv and imu_yaml: the program's files."""
    axes: "list[AllanAxis]"
    rest_s: float
    csv: str
    imu_yaml: str
    report: Report


@_dataclasses.dataclass(frozen=True, eq=False)
class SequencePrediction:
    """sigma (24,) in the order and units of Parameters.values, nan: not determined; refused: why the station cannot run it, or empty."""
    name: str
    station_s: float
    static_s: float
    sigma: _np.ndarray
    refused: str


@_result
class Prediction(_Reported):
    """sequences: in the order given."""
    sequences: "list[SequencePrediction]"
    report: Report


def _path(path):
    text = _os.fsdecode(path)
    if "\0" in text:
        raise ValueError(f"{text!r}: expected a path without a NUL")
    return text


def _inner(given, kind=Recording):
    if not isinstance(given, kind):
        raise TypeError(f"expected a turncal.{kind.__name__}, found {type(given).__name__}")
    return given._inner


def _inners(recordings):
    return [_inner(r) for r in ([recordings] if isinstance(recordings, Recording) else recordings)]


def load(path):
    """A recording: a folder or a .tcr file, as the program takes them."""
    return Recording(_turncal.Recording.load(_path(path)))


def import_table(path, map):
    """A table of numbers (CSV, .npy, .mat, HDF5) or a ROS bag, by a map of its columns (docs/import.md); without segments."""
    return Recording(_turncal.Recording.import_table(_path(path), _path(map)))


def read_parameters(path):
    """A parameter file to be used: an error where parameters are not determined."""
    return Parameters(_turncal.Parameters.read(_path(path)))


def calibrate(recordings, *, method="joint", partial=False, time_utc=""):
    """The 24 parameters with standard deviations, of one recording or several of one unit, as `turncal calibrate` gives them.

    method: joint, or closed-form (the fourteen steps of Wang, 2020); partial: what is not determined is no error.
    """
    parameters, *more, report = _turncal.calibrate(_inners(recordings), method, partial, time_utc)
    return Calibration(Parameters(parameters), *more, Report(report))


def diagnose(recordings, *, holdouts=(), time_utc=""):
    """Do the data hold an effect beyond the 24 parameters, and which: as `turncal diagnose`. holdouts: of the unit, not fitted."""
    verdict, effects, parameters, items, text, report = _turncal.diagnose(_inners(recordings), _inners(holdouts), time_utc)
    return Diagnosis(verdict, effects, parameters and Parameters(parameters), dict(items), text, Report(report))


def apply(recording, parameters):
    """The recording with calibrated increments, rad and m/s; over info.sample_period_s they are rates and specific forces."""
    return Recording(_turncal.apply(_inner(recording), _inner(parameters, Parameters)))


def allan(recording):
    """The noise of a unit at rest, as `turncal allan`: of a recording without segments, or of the rests of one with them."""
    axes, *more, report = _turncal.allan(_inner(recording))
    return Allan([AllanAxis(*_np.array(points).T, *_np.array(terms).T) for points, terms in axes], *more, Report(report))


def predict(sequences, *, station="", latitude_deg=None, gravity_mps2=None, arw_deg_per_rt_h=0.002, vrw_ug_per_rt_hz=8.0,
            gyro_bias_instability_degph=0.0, accel_bias_instability_ug=0.0, effects=False):
    """What sequences (paths) would determine, as `turncal predict`, for a station (path, or the built-in one) and the noise of a unit."""
    paths = [_path(s) for s in ([sequences] if isinstance(sequences, (str, bytes, _os.PathLike)) else sequences)]
    found, report = _turncal.predict(paths, _path(station), latitude_deg, gravity_mps2, arw_deg_per_rt_h, vrw_ug_per_rt_hz,
                                     gyro_bias_instability_degph, accel_bias_instability_ug, effects)
    return Prediction([SequencePrediction(name, total, static, _np.array(sigma), refused)
                       for name, total, static, sigma, refused in found], Report(report))
