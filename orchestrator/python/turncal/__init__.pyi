# The types of turncal; shapes and units are in the docstrings. tests/python compares the names.
from os import PathLike
from typing import Any, Iterator, NamedTuple, Sequence, Union

import numpy as np
from numpy.typing import NDArray

Path = Union[str, PathLike[str]]
Floats = NDArray[np.float64]
parameter_keys: tuple[str, ...]

class Error(Exception):
    exit_code: int
class InputError(Error): ...
class UnitFailedError(Error): ...
class DeviceError(Error): ...

class Report:
    text: str
    def json(self) -> str: ...
    def html(self) -> str: ...

class RecordingInfo(NamedTuple):
    sample_period_s: float
    latitude_deg: float; gravity_mps2: float
    unit_serial: str
    gyro_increment: str; accel_increment: str
    accel_pulse_mps: float
    has_temperature: bool
    started_utc_s: int | None
    simulated: bool

class Segment(NamedTuple):
    step: int
    kind: str
    start_sample: int; end_sample: int
    heading_deg: float; pitch_deg: float; roll_deg: float

class Recording:
    counter: NDArray[np.int64]
    gyro: Floats; accel: Floats
    temperature_c: NDArray[np.float32]
    flags: NDArray[np.uint32]
    info: RecordingInfo
    segments: tuple[Segment, ...]
    path: str; damage: str; hash: str
    notes: tuple[str, ...]
    time_s: Floats
    def with_rests(self, min_rest_s: float = ...) -> Recording: ...
    def __len__(self) -> int: ...

class Parameters:
    values: Floats; sigmas: Floats; N0: Floats; A0: Floats; n: Floats; a: Floats
    trusted: bool; text: str
    @staticmethod
    def parse(text: str, name: str = ...) -> Parameters: ...
    def write(self, path: Path) -> None: ...
    def as_dict(self) -> dict[str, float | str]: ...
    def __getitem__(self, key: str) -> Any: ...
    def __contains__(self, key: object) -> bool: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...

class Calibration:
    parameters: Parameters; report: Report
    notes: list[str]; distrust: str

class Diagnosis:
    verdict: str; text: str; effects: list[str]
    parameters: Parameters | None; items: dict[str, Any]; report: Report

class AllanAxis:
    tau_s: Floats; deviation: Floats; low: Floats; high: Floats; degrees: Floats; coefficients: Floats; sigmas: Floats; limits: Floats

class Allan:
    axes: list[AllanAxis]; rest_s: float
    csv: str; imu_yaml: str; report: Report

class SequencePrediction:
    name: str; station_s: float; static_s: float
    sigma: Floats; refused: str

class Prediction:
    sequences: list[SequencePrediction]; report: Report

def load(path: Path) -> Recording: ...
def import_table(path: Path, map: Path) -> Recording: ...
def read_parameters(path: Path) -> Parameters: ...
def calibrate(recordings: Recording | Sequence[Recording], *, method: str = ..., partial: bool = ..., time_utc: str = ...) -> Calibration: ...
def diagnose(recordings: Recording | Sequence[Recording], *, holdouts: Sequence[Recording] = ..., time_utc: str = ...) -> Diagnosis: ...
def apply(recording: Recording, parameters: Parameters) -> Recording: ...
def allan(recording: Recording) -> Allan: ...
def predict(sequences: Path | Sequence[Path], *, station: Path = ..., latitude_deg: float | None = ..., gravity_mps2: float | None = ...,
            arw_deg_per_rt_h: float = ..., vrw_ug_per_rt_hz: float = ..., gyro_bias_instability_degph: float = ...,
            accel_bias_instability_ug: float = ..., effects: bool = ...) -> Prediction: ...
