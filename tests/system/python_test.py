"""turncal for Python: the results are the program's, arrays are views, errors are its lines, the notebooks run."""
import ast
import dataclasses
import gc
import json
import os
import pathlib
import pickle
import subprocess
import tempfile
import threading
import unittest

import numpy as np
import turncal

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = pathlib.Path(tempfile.mkdtemp())


def program(*arguments):
    return subprocess.run(["turncal", *map(str, arguments)], cwd=FOLDER, capture_output=True, text=True)


def setUpModule():
    os.chdir(FOLDER)
    ran = program("run", "--dry-run", "--quiet", "--capture-only", "--unit", "PY", "--sequence", ROOT / "sequences/short_demo.seq", "--out", "run")
    assert ran.returncode == 0, ran.stderr


def sealed(text):
    body, crc = text[:text.rindex("checksum")], 0xFFFFFFFF
    for byte in body.encode():
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return f"{body}checksum = {crc ^ 0xFFFFFFFF:08x}\n"


def but_time(parameters):
    return {key: value for key, value in parameters.as_dict().items() if key != "time_utc"}


class Module(unittest.TestCase):
    def test_arrays_are_views_that_keep_the_recording(self):
        recording = turncal.load("run")
        self.assertEqual(recording.gyro.shape, (len(recording), 3))
        self.assertTrue(np.shares_memory(recording.gyro, recording._inner.gyro))
        self.assertLess(abs(recording.gyro.ctypes.data - recording.counter.ctypes.data), 64)  # fields of one sample
        self.assertFalse(recording.accel.flags.writeable)
        program("export", "run", "--out", "text")
        table = np.loadtxt("text/imu.csv", delimiter=",", skiprows=1)
        columns = np.column_stack([recording.counter, recording.gyro, recording.accel])
        np.testing.assert_array_equal(table[:, :7], columns)
        if recording.info.has_temperature:
            np.testing.assert_array_equal(table[:, 7].astype(np.float32), recording.temperature_c)
        self.assertEqual((recording.info.unit_serial, recording.info.gyro_increment), ("PY", "pulses"))
        self.assertEqual([s.kind for s in recording.segments], [line.split(",")[1] for line in pathlib.Path("text/segments.csv").read_text().split()[1:]])
        self.assertEqual(turncal.load("text").hash, recording.hash)
        gyro, total = recording.gyro, recording.gyro.sum()
        del recording, columns
        gc.collect()
        blocks = [np.ones(1 << 22) for _ in range(8)]  # where it was, if it were gone
        self.assertEqual(gyro.sum(), total)
        del blocks

    def test_calibration_is_that_of_the_command(self):
        program("calibrate", "run", "--out", "calibrated")
        result = turncal.calibrate(turncal.load("run"))
        file = turncal.read_parameters("calibrated/parameters.conf")
        self.assertEqual(but_time(result.parameters), but_time(file))
        self.assertEqual(file.text, pathlib.Path("calibrated/parameters.conf").read_text())
        p = result.parameters
        self.assertEqual([p["N02"], p["A03"], p["n12"], p["a31"]], [p.N0[1], p.A0[2], p.n[0, 1], p.a[2, 0]])
        self.assertEqual(p.sigmas[turncal.parameter_keys.index("n33")], p["sigma.n33"])
        self.assertEqual(turncal.Parameters.parse(p.text).text, p.text)
        p.write("written.conf")
        self.assertEqual(pathlib.Path("written.conf").read_text(), p.text)
        with self.assertRaisesRegex(turncal.InputError, "is a file of another kind, and is not replaced"):
            p.write("run/recording.tcr")
        self.assertTrue(dataclasses.is_dataclass(result))

    def test_apply_is_that_of_the_command(self):
        program("calibrate", "run", "--out", "to_apply")
        program("apply", "run", "--parameters", "to_apply/parameters.conf", "--as", "rates", "--out", "rates.npy")
        rates = np.load("rates.npy")
        applied = turncal.apply(turncal.load("run"), turncal.read_parameters("to_apply/parameters.conf"))
        period = applied.info.sample_period_s
        np.testing.assert_array_equal(np.column_stack([applied.time_s, applied.gyro / period, applied.accel / period]), rates[:, :7])

    def test_what_the_commands_say_is_said(self):
        text = turncal.calibrate(turncal.load("run")).parameters.text
        for serial in ("0042", "42", "1e5"):  # a text, whatever its digits
            changed = turncal.Parameters.parse(sealed(text.replace("unit_serial = PY", f"unit_serial = {serial}")))
            self.assertEqual((changed["unit_serial"], changed["N01"]), (serial, float(changed.values[0])))
        pathlib.Path("table.csv").write_text("gx,gy,gz,ax,ay,az\n" + "".join(f"0,{k % 7}e-4,{k % 5}e-4,0.1,0,9.8\n" for k in range(1000)))
        pathlib.Path("table.map").write_text("unit_serial = T\ngravity_mps2 = 9.8\nrate_hz = 100\ngyro.columns = gx, gy, gz\ngyro.unit = rad/s\n"
                                             "accel.columns = ax, ay, az\naccel.unit = m/s^2\n")
        said = program("import", "table.csv", "--map", "table.map", "--out", "table").stdout.splitlines()
        self.assertEqual(turncal.import_table("table.csv", "table.map").notes, (said[0].split(": ", 1)[1], *said[1:]))
        self.assertIn("gyro x gave the same value", said[1])

    def test_allan_and_prediction_are_those_of_the_commands(self):
        program("allan", "run", "--out", "allan")
        noise = turncal.allan(turncal.load("run"))
        self.assertEqual(noise.csv, pathlib.Path("allan/allan.csv").read_text())
        tau, deviation = np.loadtxt("allan/allan.csv", delimiter=",", skiprows=1, usecols=(1, 2)).T
        np.testing.assert_array_equal(np.concatenate([axis.tau_s for axis in noise.axes]), tau)
        np.testing.assert_array_equal(np.concatenate([axis.deviation for axis in noise.axes]), deviation)
        self.assertEqual(noise.axes[0].coefficients.shape, (5,))
        sequence = ROOT / "sequences/two_axes.seq"
        prediction = turncal.predict(sequence, vrw_ug_per_rt_hz=16)
        self.assertEqual(prediction.report.text, program("predict", "--vrw", "16", "--sequence", sequence).stdout)
        self.assertEqual(prediction.sequences[0].sigma.shape, (24,))

    def test_diagnosis_is_that_of_the_command(self):
        program("diagnose", "run", "--out", "diagnosed")
        result = turncal.diagnose(turncal.load("run"))
        self.assertEqual((result.verdict, result.effects), ("clean", []))
        self.assertEqual(result.text, pathlib.Path("diagnosed/diagnosis.conf").read_text())
        self.assertEqual(but_time(result.parameters), but_time(turncal.read_parameters("diagnosed/parameters.conf")))
        self.assertEqual(result.items["verdict"], "clean")
        self.assertIn("<iframe srcdoc=\"&lt;!DOCTYPE html&gt;", result._repr_html_())
        self.assertIn("Clean", result._repr_html_())
        self.assertIn("Clean", repr(result))

    def test_errors_are_the_lines_of_the_program(self):
        pathlib.Path("level.seq").write_text("format = 1\nname = level\nrate_degps = 10\nacceleration_degps2 = 20\n"
                                             "step 1\n  initial H 0 P 0 R 0\n  align 6000\n  rotate H +90\n  dwell 6000\n")
        program("run", "--dry-run", "--quiet", "--capture-only", "--unit", "SHORT", "--sequence", "level.seq", "--out", "short")
        short = turncal.load("short")
        for kind, arguments, call in [
                (turncal.InputError, ("calibrate", "none", "--out", "x"), lambda: turncal.load("none")),
                (turncal.InputError, ("allan", "level.seq", "--map", "none.map"), lambda: turncal.import_table("level.seq", "none.map")),
                (turncal.UnitFailedError, ("calibrate", "short", "--out", "x"), lambda: turncal.calibrate(short)),
                (turncal.InputError, ("diagnose", "short", "--holdout", "run", "--out", "x"),
                 lambda: turncal.diagnose(short, holdouts=[turncal.load("run")]))]:
            with self.subTest(arguments):
                said = program(*arguments)
                with self.assertRaises(kind) as raised:
                    call()
                self.assertEqual(f"turncal: {raised.exception}\n", said.stderr)
                self.assertEqual(raised.exception.exit_code, said.returncode)
                self.assertIsInstance(raised.exception, turncal.Error)

    def test_what_is_not_taken_is_said(self):
        recording = turncal.load("run")
        parameters = turncal.calibrate(recording).parameters
        for kind, words, call in [
                (TypeError, "expected a turncal.Recording, found ndarray", lambda: turncal.allan(recording.gyro)),
                (TypeError, "expected a turncal.Recording, found ndarray", lambda: turncal.calibrate(recording.gyro)),
                (TypeError, "expected a turncal.Parameters, found Recording", lambda: turncal.apply(recording, recording)),
                (TypeError, "int", lambda: turncal.load(3)),
                (ValueError, "without a NUL", lambda: turncal.load("a\0b")),
                (AttributeError, "Recording.gyro cannot be assigned", lambda: setattr(recording, "gyro", 2 * recording.gyro)),
                (turncal.InputError, "min_rest_s = -1", lambda: recording.with_rests(-1)),
                (turncal.InputError, "min_rest_s = nan", lambda: recording.with_rests(float("nan"))),
                (turncal.InputError, "time_utc = 'now'", lambda: turncal.calibrate(recording, time_utc="now"))]:
            with self.assertRaisesRegex(kind, words):
                call()
        self.assertEqual(len(turncal.load(b"run")), len(recording))
        self.assertTrue("N01" in parameters and "N04" not in parameters)
        self.assertEqual(list(parameters), list(parameters.as_dict()))
        self.assertEqual(pickle.loads(pickle.dumps(parameters)).text, parameters.text)

    def test_threads_get_what_one_gets_and_leave_the_interpreter_free(self):
        recording = turncal.load("run")
        results, turns, done = [None, None], 0, threading.Event()

        def work(k):
            at = "2026-01-31T12:00:00Z"
            results[k] = turncal.calibrate(recording, time_utc=at).parameters.text + turncal.diagnose(recording, time_utc=at).text
        threads = [threading.Thread(target=work, args=(k,)) for k in (0, 1)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            done.wait(0.001)
            turns += 1
        self.assertEqual(results[0], results[1])
        self.assertGreater(turns, 20)

    def test_a_table_is_imported_by_its_map(self):
        program("export", "run", "--out", "for_map")
        pathlib.Path("my.map").write_text("unit_serial = PY\ngravity_mps2 = 9.79\nrate_hz = 200\ngyro.columns = gyro_x, gyro_y, gyro_z\ngyro.unit = arcsec\n"
                                          "accel.columns = accel_x, accel_y, accel_z\naccel.unit = m/s\naccel.scale = 4.9e-4\n")
        table = turncal.import_table("for_map/imu.csv", "my.map")
        self.assertEqual((len(table), table.segments), (len(turncal.load("run")), ()))
        self.assertGreater(len(table.with_rests().segments), 10)

    def test_a_glitch_is_no_noise(self):
        pathlib.Path("rest.map").write_text("unit_serial = PY\ngravity_mps2 = 9.8\nrate_hz = 100\ngyro.columns = 1, 2, 3\ngyro.unit = rad/s\n"
                                            "accel.columns = 4, 5, 6\naccel.unit = m/s^2\n")
        rows, walks = np.random.default_rng(1).normal(0, 1e-3, (5000, 6)) + [0, 0, 0, 0, 0, 9.8], []
        for glitch in (0.0, 1.0):
            rows[2000, 0] += glitch
            np.save("rest.npy", rows)
            found = turncal.allan(turncal.import_table("rest.npy", "rest.map"))
            walks.append(found.axes[0].coefficients[1])
        self.assertAlmostEqual(walks[1] / walks[0], 1.0, delta=0.001)
        self.assertIn("1 sample left out", found.report.text)


class Stubs(unittest.TestCase):
    """The names of the .pyi are those of the module, and every public one of the module is in it."""

    def test_names(self):
        tree = ast.parse(pathlib.Path(turncal.__file__).with_suffix(".pyi").read_text())
        stubs = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
        self.assertEqual(set(turncal.__all__) - {"parameter_keys"}, set(stubs))
        recording = turncal.load("run")
        calibration = turncal.calibrate(recording)
        have = {"Recording": recording, "RecordingInfo": recording.info, "Segment": recording.segments[0], "Parameters": calibration.parameters,
                "Calibration": calibration, "Report": calibration.report}
        for name, stub in stubs.items():
            real = getattr(turncal, name)
            self.assertTrue(real.__doc__, name)
            if isinstance(stub, ast.FunctionDef):
                code = real.__code__
                self.assertEqual([a.arg for a in stub.args.args + stub.args.kwonlyargs], list(code.co_varnames[:code.co_argcount + code.co_kwonlyargcount]), name)
                continue
            fields = {f.target.id for f in stub.body if isinstance(f, ast.AnnAssign)} | {f.name for f in stub.body if isinstance(f, ast.FunctionDef)}
            if name in have:
                shown = {n for n in dir(have[name]) if not n.startswith("_")} - set(dir(tuple)) - {n for n in dir(have[name]) if n.startswith("_")}
                shown |= fields & {"__len__", "__getitem__", "__contains__", "__iter__"}
                self.assertEqual(fields, shown, name)
            elif dataclasses.is_dataclass(real):
                self.assertEqual(fields, {f.name for f in dataclasses.fields(real)}, name)


class Notebooks(unittest.TestCase):
    def test_every_cell_runs(self):
        notebooks = sorted((ROOT / "docs/examples").glob("*.ipynb"))
        self.assertEqual(len(notebooks), 2)
        for path in notebooks:
            with self.subTest(path.name), tempfile.TemporaryDirectory() as folder:
                os.chdir(folder)
                names = {}
                try:
                    for cell in json.loads(path.read_text())["cells"]:
                        self.assertFalse(cell.get("outputs"), "a notebook is kept without outputs")
                        if cell["cell_type"] == "code":
                            exec(compile("".join(cell["source"]), path.name, "exec"), names)
                finally:
                    os.chdir(FOLDER)
                self.assertIn("_repr_html_", dir(names["result"]))


unittest.main(verbosity=2)
