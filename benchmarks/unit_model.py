"""A unit on a table, for the benchmark. It shares no code with turncal: neither with its simulator nor with its estimator.

Frames and signs: body x front, y up, z right; n is north, up, east; C_nb = Ry(-H) Rz(P) Rx(R); w = n counts - N0, f = a counts - A0.
A sample is the exact turn of the body against inertial space between two instants, as a rotation vector, and Simpson's rule over the
specific force. Bias instability is three first-order Gauss-Markov processes. Not modelled: coning within a sample (1e-10 of the rate), the
unit's arm from the table's centre, what the table does while it settles.
Run as a program it compares itself with closed forms and prints the largest differences.
"""
import numpy as np

RAD_PER_ARCSEC = np.pi / 648000
RADPS_PER_DEGPH = RAD_PER_ARCSEC
EARTH_RADPS = 7.292115e-5
G0 = 9.80665
PULSE_ARCSEC = 0.932920


def turns(axis, angle):
    """Rotation matrices about a body axis, one for each angle in rad."""
    c, s = np.cos(angle), np.sin(angle)
    m = np.zeros(np.shape(angle) + (3, 3))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    m[..., axis, axis] = 1
    m[..., i, i] = m[..., j, j] = c
    m[..., i, j], m[..., j, i] = -s, s
    return m


def small(v):
    return turns(0, v[0]) @ turns(1, v[1]) @ turns(2, v[2])


def rotation_vectors(m):
    """Of rotations by less than a right angle."""
    v = 0.5 * np.stack([m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], -1)
    s = np.linalg.norm(v, axis=-1, keepdims=True)
    return v * np.where(s > 1e-9, np.arcsin(np.minimum(s, 1)) / np.maximum(s, 1e-300), 1 + s * s / 6)


def rotations(v):
    """Of rotation vectors (n x 3): Rodrigues' formula."""
    a = np.maximum(np.linalg.norm(v, axis=1)[:, None, None], 1e-9)
    k = np.zeros((len(v), 3, 3))
    k[:, 2, 1], k[:, 0, 2], k[:, 1, 0] = v.T
    k -= k.swapaxes(1, 2)
    return np.eye(3) + np.sin(a) / a * k + 2 * (np.sin(a / 2) / a) ** 2 * (k @ k)


def read_sequence(path):
    """The rates of a sequence file, and its steps: [number, (kind, ...), ...]."""
    rate, acceleration, steps = 10.0, 20.0, []
    for line in open(path, encoding="utf-8"):
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "rate_degps":
            rate = float(words[2])
        elif words[0] == "acceleration_degps2":
            acceleration = float(words[2])
        elif words[0] == "step":
            steps.append([int(words[1])])
        elif words[0] == "initial":
            steps[-1].append(("initial", dict(zip(words[1::2], map(float, words[2::2])))))
        elif words[0] in ("align", "dwell"):
            steps[-1].append((words[0], int(words[1])))
        elif words[0] == "rotate":
            steps[-1].append(("rotate", words[1], float(words[2])))
    return rate, acceleration, steps


def ramp(distance, rate, acceleration, dt):
    """Fractions of a turn at each instant: trapezoid of rate, then 0.5 s of rest, in whole samples."""
    top = min(rate, np.sqrt(abs(distance) * acceleration))
    t_up, total = top / acceleration, abs(distance) / top + top / acceleration
    t = np.minimum(np.arange(1, int(np.ceil((total + 0.5) / dt)) + 1) * dt, total)
    way = np.where(t < t_up, 0.5 * acceleration * t**2, np.where(t < total - t_up, top * (t - 0.5 * t_up),
                   abs(distance) - 0.5 * acceleration * (total - t) ** 2))
    return way / abs(distance)


def drive(path, dt):
    """Table angles (rad) at the instants k dt, and the segments of the recording."""
    rate, acceleration, steps = read_sequence(path)
    at = dict(H=0.0, P=0.0, R=0.0)
    angles, segments, count = [np.zeros((1, 3))], [], 0

    def add(step, kind, block):
        nonlocal count
        angles.append(np.radians(block))
        segments.append((step, kind, count, count + len(block), at["H"], at["P"], at["R"]))
        count += len(block)

    def turn(step, axis, distance):
        way = ramp(distance, rate, acceleration, dt)
        block = np.tile([at["H"], at["P"], at["R"]], (len(way), 1))
        block[:, "HPR".index(axis)] += way * distance
        at[axis] += distance
        add(step, "rotate", block)

    for number, *parts in steps:
        for part in parts:
            if part[0] == "initial":
                for axis in "RPH":
                    if part[1].get(axis, at[axis]) != at[axis]:
                        turn(number, axis, part[1][axis] - at[axis])
            elif part[0] == "rotate":
                turn(number, part[1], part[2])
            else:
                add(number, "align" if part[0] == "align" else "static", np.tile([at["H"], at["P"], at["R"]], (part[1], 1)))
    return np.concatenate(angles), segments


class Motion:
    """What a unit feels: w and f (n x 3, means over each sample, rad/s and m/s^2), t (s) at its middle.

    errors: four rows of three angles (rad): of the base, between heading and pitch, between pitch and roll, of the unit on the table."""

    def __init__(self, path, dt, latitude_deg, gravity, errors=np.zeros((4, 3))):
        angles, self.segments = drive(path, dt)
        base, across_1, across_2, mount = (small(v) for v in errors)
        C = base @ turns(1, -angles[:, 0]) @ across_1 @ turns(2, angles[:, 1]) @ across_2 @ turns(0, angles[:, 2]) @ mount
        turned = rotation_vectors(C[:-1].swapaxes(1, 2) @ C[1:])
        middle = C[:-1] @ rotations(turned / 2)
        earth = EARTH_RADPS * np.array([np.cos(np.radians(latitude_deg)), np.sin(np.radians(latitude_deg)), 0.0])
        self.dt, self.n, self.C = dt, len(turned), C
        self.w = turned / dt + middle.swapaxes(1, 2) @ earth
        self.f = gravity * (C[:-1, 1] + 4 * middle[:, 1] + C[1:, 1]) / 6
        self.t = (np.arange(self.n) + 0.5) * dt


def precession():
    """How far the standing wave of a hemispherical resonator stays behind the case, of what that turns: two waves around the rim of a thin shell
    that bends and does not stretch (Rayleigh), Coriolis' force on them over their inertia. 0.277."""
    polar = (np.arange(20000) + 0.5) / 20000 * np.pi / 2
    along = np.sin(polar) * np.tan(polar / 2) ** 2  # and as much across
    outward = -(2 + np.cos(polar)) * np.tan(polar / 2) ** 2
    coupling = -along * (outward * np.sin(polar) + along * np.cos(polar)) * np.sin(polar)
    return coupling.sum() / ((2 * along**2 + outward**2) * np.sin(polar)).sum()


def standing_wave(w, dt, drift, drift_at):
    """What a whole-angle resonator reads too much (rad/s) where the case turns at w. Its wave is carried back by the turn, and by damping that
    differs around the rim: drift (rad/s of the case) times sin 4 (angle - drift_at), Lynch 1995. One equation, one angle, a step a sample."""
    k, angle, out = precession(), 0.0, np.empty(len(w))
    for i, turn in enumerate(w * dt):
        out[i] = drift * np.sin(4 * (angle - drift_at))
        angle -= k * (turn + out[i] * dt)
    return out


def wander(sigma, t, random):
    """Three Gauss-Markov processes of 10, 100 and 1000 s, each of standard deviation sigma; on three axes, once a second."""
    seconds = int(t[-1]) + 2
    noise, x = random.normal(0, sigma, (seconds, 3, 3)), np.zeros((seconds, 3, 3))
    keep = np.exp(-1 / np.array([10.0, 100.0, 1000.0]))[:, None]
    x[0] = noise[0]
    for k in range(1, seconds):
        x[k] = keep * x[k - 1] + np.sqrt(1 - keep**2) * noise[k]
    return np.stack([np.interp(t, np.arange(seconds), x.sum(1)[:, axis]) for axis in range(3)], 1)


def read_out(motion, p, grade, random, gyro=0.0, accel=0.0):
    """What a sample gives. p: the 24 parameters (Table 1); gyro, accel: what effects add to the true w (rad/s) and f (m/s^2);
    grade: arw_degprh, vrw_ug, instability_degph, instability_ug, accel_pulse_mps (None: real numbers, rad and m/s)."""
    dt, n, pulse = motion.dt, motion.n, grade["accel_pulse_mps"]

    def matrix(name):
        return np.array([[p[f"{name}{i}{j}"] for j in "123"] for i in "123"])

    def sums(true, bias, unit, walk, instability):
        true = true + np.array([p[f"{bias}0{i}"] for i in "123"]) * unit
        if instability:
            true = true + wander(instability * unit, motion.t, random)
        return true * dt + random.normal(0, walk * np.sqrt(dt), (n, 3))

    turn = sums(motion.w + gyro, "N", RADPS_PER_DEGPH, np.radians(grade["arw_degprh"]) / 60, grade["instability_degph"])
    velocity = sums(motion.f + accel, "A", G0, grade["vrw_ug"] * 1e-6 * G0, grade["instability_ug"] * 1e-6)
    turn, velocity = turn @ np.linalg.inv(matrix("n")).T, velocity @ np.linalg.inv(matrix("a")).T
    if pulse is None:
        return turn, velocity
    whole = [turn / RAD_PER_ARCSEC, velocity / pulse]
    return [np.diff(np.floor(np.cumsum(x, axis=0) + random.random(3)), axis=0, prepend=0).astype(np.int64) for x in whole]


def check(path):
    """Largest differences from closed forms, each over what it may be: rest, turns, the whole way, read-out."""
    latitude, g, dt = 40.0, 9.8, 0.005
    m = Motion(path, dt, latitude, g)
    north, up = EARTH_RADPS * np.cos(np.radians(latitude)), EARTH_RADPS * np.sin(np.radians(latitude))
    # Table angles by hand: (H, P, R): earth's rate and specific force along x (front), y (up), z (right).
    by_hand = {(0, 0, 0): ([north, up, 0], [0, g, 0]), (0, 90, 0): ([up, -north, 0], [g, 0, 0]), (0, 0, 90): ([north, 0, -up], [0, 0, -g]),
               (0, 0, -90): ([north, 0, up], [0, 0, g]), (-90, 0, 0): ([0, up, north], [0, g, 0]), (0, -90, 0): ([-up, north, 0], [-g, 0, 0])}
    seen, rest, turn, before = set(), 0.0, 0.0, (0, 0, 0)
    for _, kind, start, end, *pose in m.segments:
        pose = tuple(round(x) for x in pose)
        if kind != "rotate" and pose in by_hand:
            seen.add(pose)
            w, f = by_hand[pose]
            rest = max(rest, np.abs(m.w[start:end] - w).max() / 1e-12, np.abs(m.f[start:end] - f).max() / 1e-9)
        if kind == "rotate" and before[:2] == pose[:2]:  # about x: the earth turns it on by its part along x
            along = m.C[start, :, 0] @ [north, up, 0]
            turn = max(turn, abs(m.w[start:end, 0].sum() * dt - np.radians(pose[2] - before[2]) - along * (end - start) * dt) / 1e-9)
        before = pose
    assert len(seen) >= 3, seen
    # All samples one after the other, against the table's way and the earth's turn.
    C = m.C[0]
    for step in rotations(m.w * dt):
        C = C @ step
    a = EARTH_RADPS * m.n * dt
    axis = np.array([[np.cos(np.radians(latitude)), np.sin(np.radians(latitude)), 0.0]])
    way = np.abs(rotations(axis * a)[0] @ m.C[-1] - C).max() / 1e-7
    # The parameters give back w and f but for a pulse.
    p = {f"{k}{i}{j}": (i == j) * (PULSE_ARCSEC if k == "n" else 1) + 0.01 * int(i) for k in "na" for i in "123" for j in "123"}
    p |= {f"N0{i}": float(i) for i in "123"} | {f"A0{i}": 1e-3 * float(i) for i in "123"}
    quiet = dict(arw_degprh=0, vrw_ug=0, instability_degph=0, instability_ug=0, accel_pulse_mps=0.0005)
    gyro, accel = read_out(m, p, quiet, np.random.default_rng(1))
    n, a = (np.array([[p[f"{k}{i}{j}"] for j in "123"] for i in "123"]) for k in "na")
    T = m.n * dt
    w = n @ gyro.sum(0) * RAD_PER_ARCSEC - np.array([1, 2, 3]) * RADPS_PER_DEGPH * T
    f = a @ accel.sum(0) * 0.0005 - np.array([1e-3, 2e-3, 3e-3]) * G0 * T
    out = max(np.abs(w - m.w.sum(0) * dt).max() / (1.2 * RAD_PER_ARCSEC), np.abs(f - m.f.sum(0) * dt).max() / 0.0006)
    # A wave that nothing turns goes to where it is damped least: tan 2 x = exp(-4 k drift t) tan 2 x0. 0.277: Zhuravlev and Klimov, 1985.
    x = np.arctan(np.exp(-4 * precession() * 0.02 * 0.01 * 4999) * np.tan(2 * 0.3)) / 2
    shell = max(abs(precession() - 0.277) / 5e-4, abs(standing_wave(np.zeros(5000), 0.01, 0.02, -0.3)[-1] - 0.02 * np.sin(4 * x)) / 1e-5)
    return {"rest": rest, "turn": turn, "way": way, "read-out": out, "wave": shell}


if __name__ == "__main__":
    import pathlib
    import sys
    found = check(pathlib.Path(__file__).resolve().parent.parent / "sequences" / "short_demo.seq")
    print("unit_model, differences over what they may be: " + ", ".join(f"{k} {v:.2g}" for k, v in found.items()))
    sys.exit(any(not v < 1 for v in found.values()))
