# The status page in Chromium, while a run goes on, when it is told to end, and when it is killed.
import importlib.machinery, importlib.util, pathlib, re, shutil, signal, subprocess, sys, tempfile, time

root = pathlib.Path(__file__).resolve().parents[2]
loader = importlib.machinery.SourceFileLoader("page_test", str(root / "scripts/page-test"))
page_test = importlib.util.module_from_spec(importlib.util.spec_from_loader("page_test", loader))
loader.exec_module(page_test)
program = shutil.which("chromium")
if program is None:
    print("skipped: no Chromium here (the package chromium)")
    sys.exit()
chromium = page_test.Chromium(program)


def evaluate(expression):
    return chromium.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"]["value"]


def wait_for(what, is_so, within_s):
    end = time.monotonic() + within_s
    while not is_so():
        if time.monotonic() > end:
            raise SystemExit(f"FAILED: not shown within {within_s} s: {what}: {evaluate('document.body.innerText')}")
        time.sleep(0.1)


def expect(words, within_s):
    wait_for(words, lambda: words in evaluate("document.body.innerText"), within_s)


def watched(pace, end_with):
    """A run whose page is open, and ended by this signal."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "said"
        run = subprocess.Popen([sys.argv[1], "run", "--dry-run", "--unit", "SN-7", "--out", "out", "--sequence", root / "sequences/short_demo.seq",
                                "--pace", pace, "--listen", "127.0.0.1:0"], cwd=folder, stdout=open(out, "w"), stderr=subprocess.STDOUT)
        while not (page := re.search(r"status page (\S+)\n", out.read_text())):
            time.sleep(0.05)
        chromium.open(page[1], 1280, False)
        expect("Running: step", 20)
        expect("turncal: unit SN-7 (simulated: no real unit)", 5)
        yield
        run.send_signal(end_with)
        yield
        run.wait()


run = watched("10", signal.SIGKILL)
next(run)
first = evaluate("document.body.innerText")
wait_for("the station time moves on", lambda: evaluate("document.body.innerText") != first, 5)
drawn = "[...document.querySelectorAll('#gyro polyline')].map(line => line.getAttribute('points')).join()"
wait_for("the dwell of this moment", lambda: evaluate(drawn).startswith("52.0,"), 10)
next(run)
expect("No answer from the program since", 15)
expect("how it ended is in out/run.log", 1)
next(run, None)

run = watched("40", signal.SIGTERM)
next(run), next(run)
expect("Paused: step", 15)
expect("told to end", 1)
next(run, None)
chromium.close()
