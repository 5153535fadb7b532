#!/usr/bin/env python3
"""Judges calibrations of any program alike, for scripts/peers. Needs numpy.

A calibration is a file of 33 numbers, M_g (by rows), b_g, M_a, b_a, S of  w = M_g (raw - b_g) - S f,  f = M_a (raw - b_a), SI. Raw is a
recording's counts times their nominal weight (0.932920 arcsec, accel_pulse_mps; 1 for rad and m/s) over the sample period. A program's body
frame is its own: before anything is compared it is turned so that M_a is upper triangular (Wang 2020, and imu_tk; PSINS has a lower one).

  prepare TEXT HZ RATES REFERENCES  a text-form recording as rates (means over 1/HZ), and its commanded angles and forces
  fold TEXT RESTS K FOLD RATES      a hand-turned recording without every third rest, from K (RESTS: rows, listed by others)
  from PARAMETERS CALIBRATION       a parameter file (or truth.conf) of turncal as a calibration
  truth TRUTH CALIBRATION           rms errors: ug, ppm, arcsec; deg/h, ppm, arcsec
  hand TEXT RESTS K CALIBRATION     squares over the rests that were left out: count, gravity's norm; count, gravity's direction after a turn
"""
import json
import statistics
import sys
import numpy as np

DEGPH, G0, ARCSEC = np.pi / 180 / 3600, 9.80665, np.pi / 180 / 3600
GYRO_PULSE, FOLDS, EARTH = 0.932920, 3, 7.292115e-5

def conf(path):
    pairs = (line.split("#")[0].split("=", 1) for line in open(path))
    return {p[0].strip(): p[1].strip() for p in pairs if len(p) == 2}

def text(folder):
    """Counter, gyro (rad) and accelerometer (m/s) increments, configuration."""
    c = conf(folder + "/recording.conf")
    rows = np.loadtxt(folder + "/imu.csv", delimiter=",", skiprows=1, usecols=range(7))
    rows[:, 1:4] *= GYRO_PULSE * ARCSEC if c["gyro_increment"] == "pulses" else 1
    rows[:, 4:7] *= float(c["accel_pulse_mps"]) if c["accel_increment"] == "pulses" else 1
    return rows[:, 0].astype(int), rows[:, 1:4], rows[:, 4:7], c

def write_rates(path, dt, gyro, accel):
    t = np.arange(1, len(gyro) + 1) * dt
    np.savetxt(path, np.column_stack([t, gyro, accel]), delimiter=",", fmt="%.12g", header="t,wx,wy,wz,fx,fy,fz", comments="")

def attitude(heading, pitch, roll):
    """C_nb = Ry(-H) Rz(P) Rx(R); n north, up, east (docs/estimator.md). Degrees."""
    def turn(axis, deg):
        a, k, r = np.radians(deg), np.roll(np.arange(3), -axis), np.eye(3)
        r[np.ix_(k[1:], k[1:])] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        return r
    return turn(1, -heading) @ turn(2, pitch) @ turn(0, roll)

def rotation(v):
    a = np.linalg.norm(v)
    x = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + (np.sin(a) / a * x + (1 - np.cos(a)) / a**2 * x @ x if a > 0 else x)

def prepare(folder, hz, rates, references):
    counter, gyro, accel, c = text(folder)
    dt = float(c["sample_period_s"])
    many = round(1 / dt / float(hz))
    group, n = counter // many, np.bincount(counter // many)
    means = np.array([np.bincount(group, x) / np.maximum(n, 1) / dt for x in np.hstack([gyro, accel]).T])
    means = np.array([np.interp(np.arange(len(n)), np.flatnonzero(n), m[n > 0]) for m in means]).T  # a gap is bridged
    write_rates(rates, many * dt, means[:, :3], means[:, 3:])
    segments = np.genfromtxt(folder + "/segments.csv", delimiter=",", skip_header=1, dtype=None, encoding=None)
    latitude, g = np.radians(float(c["latitude_deg"])), float(c["gravity_mps2"])
    earth = EARTH * np.array([np.cos(latitude), np.sin(latitude), 0])
    out, before = [], np.zeros(3)
    for _, kind, start, end, *angles in segments:
        pick = slice(*np.searchsorted(counter, [start, end]))
        after, T = np.array(angles, float), (end - start) * dt
        if pick.stop - pick.start == end - start:  # not one with a gap
            path = [attitude(*(before + (after - before) * s)) for s in np.linspace(0, 1, 201)]
            steps = [p.T @ q for p, q in zip(path, path[1:])]
            angle = sum(np.arcsin(np.array([s[2, 1] - s[1, 2], s[0, 2] - s[2, 0], s[1, 0] - s[0, 1]]) / 2) for s in steps)
            angle += T * np.mean([p.T @ earth for p in path], axis=0)
            force = path[0].T @ [0, g, 0] if kind != "rotate" else np.zeros(3)
            out.append(np.r_[T, gyro[pick].sum(0), angle, accel[pick].sum(0) / T, force])
        before = after
    np.savetxt(references, out, delimiter=",", header="T" + 12 * ",x", comments="")

def fold(folder, rests, k, rates):
    """Without the rests k, k+3, ...: what stands still of them is cut out, and time closes up. The fit keeps the turns, as one."""
    _, gyro, accel, c = text(folder)
    dt, lists = float(c["sample_period_s"]), np.loadtxt(rests, delimiter=",", skiprows=1, usecols=(0, 1), dtype=int)
    keep, both = np.ones(len(gyro), bool), np.hstack([gyro, accel])
    for start, end in lists[int(k)::FOLDS]:
        middle, sigma = both[start:end].mean(0), both[start:end].std(0)
        still = (np.abs(both - middle) < 5 * sigma).all(1)
        while start > 0 and still[start - 1]: start -= 1
        while end < len(still) and still[end]: end += 1
        keep[start:end] = False
    keep[lists[-1, 1]:] = False
    write_rates(rates, dt, gyro[keep] / dt, accel[keep] / dt)

def turned(x):
    """M_g, b_g, M_a, b_a, S with the body frame turned by R = Q', M_a = Q U, U upper triangular with a positive diagonal."""
    Mg, bg, Ma, ba, S = x[:9].reshape(3, 3), x[9:12], x[12:21].reshape(3, 3), x[21:24], x[24:33].reshape(3, 3)
    Q, U = np.linalg.qr(Ma)
    R = (Q * np.sign(np.diag(U))).T
    return R @ Mg, bg, R @ Ma, ba, R @ S @ R.T

def calibration(p):
    """Of a parameter file's keys: w = n counts - N0 (deg/h), f = a counts - A0 (g of 9.80665 m/s^2); g-sensitivity in deg/h/g."""
    n, a = (np.array([[float(p[f"{k}{i}{j}"]) for j in "123"] for i in "123"]) for k in "na")
    N0, A0 = (np.array([float(p[f"{k}0{i}"]) for i in "123"]) for k in "NA")
    Mg = n / GYRO_PULSE if p.get("gyro_increment", "pulses") == "pulses" else n  # a truth.conf is of pulses, too
    S = [float(p.get(f"effect.gyro_g_sensitivity.{i}{j}", 0)) * DEGPH / G0 for i in "xyz" for j in "xyz"]
    return np.r_[Mg.ravel(), np.linalg.solve(Mg, N0 * DEGPH), a.ravel(), np.linalg.solve(a, A0 * G0), S]

def of_parameters(path):
    return calibration(conf(path))

def errors(true, found):
    """Rms: accelerometers ug, ppm, arcsec; gyros deg/h, ppm, arcsec. Both as 33 numbers."""
    Mg, bg, Ma, ba, _ = turned(true)
    Ng, cg, Na, ca, _ = turned(found)
    dA, dG = Na @ np.linalg.inv(Ma) - np.eye(3), Ng @ np.linalg.inv(Mg) - np.eye(3)
    off, rms = ~np.eye(3, dtype=bool), lambda x: float(np.sqrt(np.mean(np.square(x))))
    return (rms(Na @ (ca - ba)) / G0 * 1e6, rms(np.diag(dA)) * 1e6, rms(dA[np.triu_indices(3, 1)]) / ARCSEC,
            rms(Ng @ (cg - bg)) / DEGPH, rms(np.diag(dG)) * 1e6, rms(dG[off]) / ARCSEC)

def truth(true, found):
    print(*errors(of_parameters(true), np.loadtxt(found).ravel()))

def band(dof):
    """Central 99 % of chi-square over its degrees of freedom (Wilson and Hilferty 1931)."""
    z = statistics.NormalDist().inv_cdf(0.995)
    return [float(1 - 2 / (9 * dof) + s * z * np.sqrt(2 / (9 * dof))) ** 3 for s in (-1, 1)]

def hand(folder, rests, k, found):
    _, gyro, accel, c = text(folder)
    dt, g = float(c["sample_period_s"]), float(c["gravity_mps2"])
    Mg, bg, Ma, ba, S = turned(np.loadtxt(found).ravel())
    f = (accel / dt - ba) @ Ma.T
    w = (gyro / dt - bg) @ Mg.T - f @ S.T
    lists = np.loadtxt(rests, delimiter=",", skiprows=1, usecols=(0, 1), dtype=int)
    out, second = range(int(k), len(lists), FOLDS), round(1 / dt)
    norms = [np.linalg.norm(f[slice(*lists[i])].mean(0)) - g for i in out]
    angles = []
    for i in sorted({j for r in out for j in (r - 1, r) if j + 1 < len(lists)}):  # the turns to a rest that was left out, and from it
        end, start = lists[i, 1], lists[i + 1, 0]
        u, v = f[end - second:end].mean(0), f[start:start + second].mean(0)
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        for rate in w[end - second // 2:start + second // 2]:  # from the middle of the one mean to that of the other
            u = rotation(-rate * dt) @ u
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
    print(len(norms), float(np.sum(np.square(norms))), len(angles), float(np.sum(np.square(angles))))

NAMES = {"turncal": "turncal calibrate", "diagnose": "turncal diagnose", "lsclbt": "PSINS lsclbt", "sysclbt": "PSINS sysclbt", "mems": "PSINS sysclbtMEMS"}
COLUMNS = {"truth": "accel_ug accel_ppm accel_arcsec gyro_degph gyro_ppm gyro_arcsec user_s".split(),
           "hand": "rests norm_mmps2 turns direction_mrad user_s fits_failed".split()}

def table(form, *paths):
    out = {}
    for (kind, keys), path in zip(COLUMNS.items(), paths):
        rows = [line.rstrip("\n").split("\t") for line in open(path)]
        out[kind] = [{"recording": r[0], "program": NAMES.get(r[1], r[1]), **(dict(zip(keys, map(float, r[2:]))) if len(r) > 3 else {"skipped": r[2]})}
                     for r in rows]
        if form == "table" and rows:
            print(f"{'recording':<12}{'program':<19}" + "".join(f"{k:>15}" for k in keys))
            for r in out[kind]:
                print(f"{r['recording']:<12}{r['program']:<19}" + ("  " + r["skipped"] if "skipped" in r else "".join(f"{r[k]:>15.4g}" for k in keys)))
    if form == "json":
        print(json.dumps(out, indent=1))

COMMANDS = {"prepare": prepare, "fold": fold, "truth": truth, "hand": hand, "table": table, "from": lambda a, b: np.savetxt(b, of_parameters(a))}
if __name__ == "__main__":
    COMMANDS[sys.argv[1]](*sys.argv[2:])
