"""The cases: what is drawn for each from its seed, its answer as text, its seal, its recording (docs/files.md).

An answer is drawn with Python's random.random() alone, which gives the same numbers in every version, and rounded to ten digits before it is
hashed and before it is used: the seal holds on any machine. Noise is numpy's, and no two machines need have the same.
"""
import hashlib
import pathlib
import random
import statistics

import numpy as np

import unit_model as unit
from unit_model import G0, PULSE_ARCSEC, RADPS_PER_DEGPH

ROOT = pathlib.Path(__file__).resolve().parent.parent
SEALS = ROOT / "benchmarks" / "seals.txt"
SEED = 2026
DT = 0.005
KEYS = ["N01", "N02", "N03", "A01", "A02", "A03"] + [f"{m}{i}{j}" for m in "na" for i in "123" for j in "123"]
FREE = [k for k in KEYS if k not in ("a21", "a31", "a32")]

# Noise of a grade, and one sigma of what is drawn: biases (deg/h, g), scale factors and misalignments (of 1).
GRADES = {
    "navigation": dict(arw_degprh=0.002, vrw_ug=8, instability_degph=0.0005, instability_ug=0.2, accel_pulse_mps=0.0005,
                       N=0.05, A=5e-3, n=(2e-4, 1.5e-3), a=(0.02, 1e-3)),
    "tactical": dict(arw_degprh=0.05, vrw_ug=50, instability_degph=0.02, instability_ug=2, accel_pulse_mps=0.0005,
                     N=1, A=2e-3, n=(3e-4, 1.5e-3), a=(0.02, 1e-3)),
    "MEMS": dict(arw_degprh=0.3, vrw_ug=100, instability_degph=1, instability_ug=20, accel_pulse_mps=None,
                 N=60, A=5e-3, n=(3e-3, 3e-3), a=(5e-3, 3e-3)),
}


def on(axis, values):
    full = np.zeros((len(values), 3))
    full[:, "xyz".index(axis)] = values
    return full


# name of an effect: smallest and largest size, components, what a size adds to w (rad/s) or f (m/s^2) of a motion, in the units of
# docs/diagnosis.md. The component and the sign are drawn.
OFF = ["xy", "xz", "yx", "yz", "zx", "zy"]
PAIRS = [f"{i}_{p}" for i in "xyz" for p in ("xy", "xz", "yz")]
EFFECTS = {
    "gyro_g_sensitivity": (0.1, 0.2, OFF, lambda m, c, v: (on(c[0], v * RADPS_PER_DEGPH * m.f[:, "xyz".index(c[1])] / G0), 0)),
    "accel_second_order": (300, 800, "xyz", lambda m, c, v: (0, on(c, 1e-6 * v * m.f[:, "xyz".index(c)] ** 2 / G0))),
    "gyro_bias_temperature_rate": (0.004, 0.008, "xyz",
                                   lambda m, c, v: (on(c, v * RADPS_PER_DEGPH * 3600 * np.gradient(m.temperature, DT)), 0)),
    "accel_scale_drift": (6, 12, "xyz", lambda m, c, v: (0, on(c, 1e-6 * v * m.t / 3600 * m.f[:, "xyz".index(c)]))),
    "accel_cross_coupling": (60, 120, PAIRS,
                             lambda m, c, v: (0, on(c[0], 1e-6 * v * m.f[:, "xyz".index(c[2])] * m.f[:, "xyz".index(c[3])] / G0))),
    "gyro_scale_asymmetry": (5, 10, "xyz", lambda m, c, v: (on(c, 1e-6 * v * np.abs(m.w[:, "xyz".index(c)])), 0)),
    "gyro_wave_angle": (0.03, 0.06, [f"{i}_{p}" for i in "xyz" for p in ("cos", "sin")],
                        lambda m, c, v: (on(c[0], unit.standing_wave(m.w[:, "xyz".index(c[0])], DT, v * RADPS_PER_DEGPH,
                                                                     -np.pi / 8 if c[2:] == "cos" else np.pi / 4)), 0)),
    "accel_delay": (0.06, 0.2, ["tau"], lambda m, c, v: (0, 1e-3 * v * np.cross(m.w, m.f))),
}

# What it is, sequence, grade, effects, and what differs from the rest: the table's errors (arcmin), pulses, losses, temperature.
CASES = [
    ("navigation grade", "sequences/fourteen_step.seq", "navigation", [], {}),
    ("tactical grade", "sequences/fourteen_step.seq", "tactical", [], {}),
    ("MEMS, ten minutes, rad and m/s", "sequences/short_demo.seq", "MEMS", [], {}),
    ("coarse pulses, 0.01 m/s", "sequences/fourteen_step.seq", "navigation", [], dict(accel_pulse_mps=0.01, arw_degprh=0.001)),
    ("far south, table off by a degree", "sequences/fourteen_step.seq", "navigation", [], dict(south=True, table_arcmin=60)),
    ("gaps, a glitch, a knock", "sequences/fourteen_step.seq", "navigation", [], dict(faults=True)),
    ("g-sensitivity of a gyro", "sequences/fourteen_step.seq", "navigation", ["gyro_g_sensitivity"], {}),
    ("quadratic accelerometer, oblique rests", "tests/peers/oblique.seq", "tactical", ["accel_second_order"], {}),
    ("gyro bias with the temperature's rate", "sequences/fourteen_step.seq", "navigation", ["gyro_bias_temperature_rate"],
     dict(wave_c=3)),
    ("accelerometer scale factor drifts", "sequences/fourteen_step.seq", "navigation", ["accel_scale_drift"], {}),
    ("cross-coupling of an accelerometer", "sequences/fourteen_step.seq", "navigation", ["accel_cross_coupling"], {}),
    ("two: gyro asymmetry, accelerometer delay", "sequences/fourteen_step.seq", "navigation",
     ["gyro_scale_asymmetry", "accel_delay"], {}),
    ("hemispherical resonator, its wave", "sequences/extended.seq", "navigation", ["gyro_wave_angle"], {}),
]


def draw(number, seed=SEED):
    """Answer of a case (from 1) as text, and the site: latitude, gravity, table errors (rad, 4 x 3)."""
    _, _, grade, effects, more = CASES[number - 1]
    g, stream = GRADES[grade] | more, random.Random(1000 * seed + number)

    def normal(sigma):  # cut at 2.5 sigma
        return sigma * statistics.NormalDist().inv_cdf(0.0062 + 0.9876 * stream.random())

    real = g["accel_pulse_mps"] is None
    latitude = -45 - 20 * stream.random() if g.get("south") else 60 * stream.random()
    gravity = 9.780327 * (1 + 0.0053024 * np.sin(np.radians(latitude)) ** 2)
    errors = np.radians([[normal(g.get("table_arcmin", 3)) / 60 for _ in range(3)] for _ in range(4)])
    values = {f"{k}0{i}": normal(g[k]) for k in "NA" for i in "123"}
    for k, weight in (("n", 1 if real else PULSE_ARCSEC), ("a", 1)):
        for i in "123":
            for j in "123":
                drawn = normal(g[k][i != j])
                values[f"{k}{i}{j}"] = weight * ((i == j) + (0 if k == "a" and i > j else drawn))
    for name in effects:
        low, high, components, _ = EFFECTS[name]
        component = components[int(stream.random() * len(components))]
        values[f"effect.{name}.{component}"] = (low + (high - low) * stream.random()) * (1 if stream.random() < 0.5 else -1)
    salt = hashlib.sha256(f"turncal benchmark {seed} {number}".encode()).hexdigest()
    unit_of = ("rad", "mps") if real else ("pulses", "pulses")
    text = f"# {CASES[number - 1][0]}\ncase = {number:02}\nseed = {seed}\nsalt = {salt}\ngyro_increment = {unit_of[0]}\naccel_increment = {unit_of[1]}\n"
    text += "".join(f"{k} = {v:.9e}\n" for k, v in values.items())
    return text, round(float(latitude), 4), round(float(gravity), 6), errors


def seal(text):
    return hashlib.sha256(text.encode()).hexdigest()


def seals():
    lines = (line.split() for line in SEALS.read_text().splitlines() if line) if SEALS.exists() else []
    return {line[0]: line[1] for line in lines}


def record(number, folder, seed=SEED):
    """Writes the recording of a case in text form; returns its answer."""
    _, sequence, grade, _, more = CASES[number - 1]
    g, noise = GRADES[grade] | more, np.random.default_rng(1000 * seed + number)
    text, latitude, gravity, errors = draw(number, seed)
    p = {k: float(v) for k, v in (line.split(" = ") for line in text.splitlines()[6:])}
    motion = unit.Motion(ROOT / sequence, DT, latitude, gravity, errors)
    motion.temperature = 24 + 6 * (1 - np.exp(-motion.t / 2400)) + g.get("wave_c", 0) * np.sin(2 * np.pi * motion.t / 2400)
    gyro = accel = 0
    for key, size in p.items():
        if key.startswith("effect."):
            _, name, component = key.split(".")
            more_gyro, more_accel = EFFECTS[name][3](motion, component, size)
            gyro, accel = gyro + more_gyro, accel + more_accel
    gyro, accel = unit.read_out(motion, p, g, noise, gyro, accel)
    keep = np.ones(motion.n, bool)
    if g.get("faults"):
        rests = [s for s in motion.segments if s[1] == "static"]
        moves = [s for s in motion.segments if s[1] == "rotate"]
        some = noise.permutation(len(rests))
        gyro[rests[some[0]][2] + 4000, 1] += round(1e-3 / unit.RAD_PER_ARCSEC / PULSE_ARCSEC)  # 1 mrad
        accel[rests[some[1]][2] + 9000, 0] += round(0.05 / g["accel_pulse_mps"])               # 0.05 m/s
        for begin, count in ((moves[some[2]][2] + 500, 300), (rests[some[3]][2] + 7000, 40)):
            keep[begin:begin + count] = False
    real, cut = g["accel_pulse_mps"] is None, slice(text.index("gyro_increment"), text.index("N01"))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recording.conf").write_text(
        f"format = 1\nsample_period_s = {DT}\nlatitude_deg = {latitude}\ngravity_mps2 = {gravity}\nunit_serial = B{number:02}\n{text[cut]}"
        + ("" if real else f"accel_pulse_mps = {g['accel_pulse_mps']}\n"))
    with open(folder / "segments.csv", "w", encoding="utf-8") as file:
        file.write("step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n")
        file.writelines(",".join(f"{x:g}" if isinstance(x, float) else str(x) for x in s) + "\n" for s in motion.segments)
    columns = [np.flatnonzero(keep)] + list(gyro[keep].T) + list(accel[keep].T)
    with open(folder / "imu.csv", "w", encoding="utf-8") as file:
        file.write("sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,temperature_c\n")
        row = "%d" + (6 * ",%.12g" if real else 6 * ",%d") + ",%.2f\n"
        file.writelines(row % values for values in zip(*(c.tolist() for c in columns), motion.temperature[keep].tolist()))
    return text
