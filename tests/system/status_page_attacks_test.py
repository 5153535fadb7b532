# What clients can do to a run through its status page: nothing. Loopback only, bounded in number and time.
import gzip, json, os, re, signal, socket, subprocess, sys, time

binary, work, sequence = sys.argv[1:4]
out = os.path.join(work, "page.out")


def begin(name, address, pace="20"):
    """A dry run that serves its page; returns the process and (host, port)."""
    arguments = [binary, "run", "--dry-run", "--unit", name, "--out", os.path.join(work, name), "--sequence", sequence,
                 "--no-diagnosis", "--listen", address, "--pace", pace]
    process = subprocess.Popen(arguments, stdout=open(out, "w"), stderr=open(out + ".err", "w"))
    for _ in range(600):
        found = re.search(r"status page http://(\[?[^\s\]]+\]?):(\d+)/", open(out).read())
        if found:
            return process, (found.group(1).strip("[]"), int(found.group(2)))
        time.sleep(0.02)
    raise SystemExit("no page: " + open(out + ".err").read())


def ask(at, request, wait_s=8.0):
    """The answer to raw bytes, until the server closes."""
    with socket.create_connection(at, timeout=wait_s) as s:
        s.settimeout(wait_s)
        answer = b""
        try:
            s.sendall(request)
            while len(answer) < 1 << 22:
                more = s.recv(65536)
                if not more:
                    break
                answer += more
        except (ConnectionError, socket.timeout):
            pass
        return answer


def get(at, path="/status.json", host=None):
    return ask(at, ("GET %s HTTP/1.1\r\nHost: %s\r\n\r\n" % (path, host or "%s:%d" % at)).encode())


def expect(good, what):
    if not good:
        raise SystemExit("FAILED: " + what)


def memory_mib(process):
    return int(re.search(r"VmHWM:\s+(\d+)", open("/proc/%d/status" % process.pid).read()).group(1)) / 1024.0


def descriptors(process):
    return len(os.listdir("/proc/%d/fd" % process.pid))


def end(process, within_s):
    """Asked to end (SIGTERM: stop now) it does, with the stop verified."""
    asked = time.monotonic()
    process.send_signal(signal.SIGTERM)
    code = process.wait(30)
    took = time.monotonic() - asked
    said = open(out + ".err").read()
    expect(code == 75 and "told to end" in said, "code %d: %s" % (code, said))
    expect(took < within_s, "the end took %.2f s" % took)
    return took


process, at = begin("A", "127.0.0.1:0")
calm_mib = memory_mib(process)
took = []

# One connection that sends a byte now and then, many that send nothing, headers without an end, a small body that becomes a large one.
slow = [socket.create_connection(at) for _ in range(3)]
for s in slow:
    s.send(b"G")
idle = []
for i in range(1000):
    s = socket.socket()
    s.settimeout(0.5)
    try:
        s.connect(at)
        idle.append(s)
    except OSError:
        s.close()
    if i % 250 == 249:
        expect(json.loads(get(at).split(b"\r\n\r\n", 1)[1])["unit"] == "A", "not served while %d are idle" % len(idle))
expect(len(idle) > 900, "only %d idle connections were made" % len(idle))
expect(descriptors(process) < 80, "%d descriptors are open" % descriptors(process))

with socket.create_connection(at, timeout=8) as s:  # headers, as fast as they are taken
    sent, line = 0, b"X-Header: " + b"x" * 1000 + b"\r\n"
    try:
        s.sendall(b"GET / HTTP/1.1\r\n")
        while sent < 64 << 20:
            s.sendall(line)
            sent += len(line)
    except OSError:
        pass
expect(sent < 32 << 20, "%d bytes of headers were taken" % sent)
expect(b" 431 " in ask(at, b"GET / HTTP/1.1\r\n" + 20 * line)[:64], "too many headers are not refused")
whole = b"GET / HTTP/1.1\r\nHost: %s:%d\r\nX-Header: " % (at[0].encode(), at[1])  # in one piece, with its end
for size, code in ((8192, 200), (8193, 431), (9000, 431)):
    text = whole + b"x" * (size - len(whole) - 4) + b"\r\n\r\n"
    expect(b" %d " % code in ask(at, text)[:64], "a request of %d bytes is not answered with %d" % (size, code))

bomb = gzip.compress(bytes(1 << 27))  # 128 KiB, unpacked 128 MiB
request = b"Host: %s:%d\r\nContent-Encoding: gzip\r\nContent-Length: %d\r\n\r\n" % (at[0].encode(), at[1], len(bomb))
expect(b" 413 " in ask(at, b"GET /status.json HTTP/1.1\r\n" + request + bomb)[:64], "a body is not refused")
expect(b" 404 " in ask(at, b"POST /status.json HTTP/1.1\r\n" + request + bomb)[:64], "a POST is not refused")
chunked = b"GET / HTTP/1.1\r\nHost: %s:%d\r\nTransfer-Encoding: chunked\r\n\r\n" % (at[0].encode(), at[1])
expect(b" 413 " in ask(at, chunked + b"10\r\n")[:64], "a chunked body is not refused")

twice = b"GET / HTTP/1.1\r\nHost: localhost\r\n%s\r\n\r\n"
for request, code in ((b"GET / HTTP/1.1\r\n\r\n", 400), (b"\r\n\r\n", 400), (b"GET /\r\n\r\n", 400), (b"\0\xff\r\n\r\n", 400),
                      (twice % b"Host: localhost", 400), (twice % b"Host: evil.example", 400), (twice % b"Host : evil.example", 400),
                      (twice % b" folded: line", 400), (twice % b"Content-Length: 0\r\nContent-Length: 5", 400),
                      (twice % b"Content-Length: 0\r\nTransfer-Encoding: chunked", 400)):
    expect(b" %d " % code in ask(at, request)[:16], "%r is not answered with %d" % (request, code))
for host, code in (("evil.example", 403), ("evil.example:%d" % at[1], 403), ("10.1.2.3", 403), ("localhost:%d" % at[1], 200),
                   ("127.0.0.1", 200), ("[::1]:1", 200)):
    expect(b" %d " % code in get(at, "/", host)[:16], "Host: %s is not answered with %d" % (host, code))
expect(b"name=\"viewport\"" in get(at, "/"), "no viewport")

for s in slow:
    try:
        s.send(b"E")
    except OSError:
        pass
peak_mib = memory_mib(process)
expect(peak_mib < calm_mib + 32, "%.0f MiB, %.0f before" % (peak_mib, calm_mib))
# A reader that takes nothing of its answer, and the slow ones again: nobody waits for them.
lazy = socket.socket()
lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
lazy.connect(at)
lazy.send(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
slow = [socket.create_connection(at) for _ in range(3)]
for s in slow:
    s.send(b"GET /status.json HTTP/1.1\r\nHost: localh")
time.sleep(5.2)  # whoever looked at the page is gone: nobody to say goodbye to
took.append(end(process, 2.0))
for s in slow + idle + [lazy]:
    s.close()

# One that has a byte every three seconds is cut off: 10 s a connection.
process, at = begin("B", "127.0.0.1:0")
with socket.create_connection(at, timeout=3) as s:
    began, byte = time.monotonic(), 0
    try:
        while time.monotonic() - began < 16:
            s.send(b"GET / HTTP/1.1\r\n"[byte:byte + 1])
            byte += 1
            try:
                if s.recv(1) == b"":
                    break
            except socket.timeout:
                pass
    except ConnectionError:
        pass
    expect(8 < time.monotonic() - began < 16, "cut off after %.1f s" % (time.monotonic() - began))
took.append(end(process, 2.0))

# A flood of good requests costs the run nothing: it keeps its pace, and ends at once.
process, at = begin("C", "[::1]:0")
expect(at[0] == "::1", "not at ::1")
count, until = 0, time.monotonic() + 3
while time.monotonic() < until:
    count += get(at, "/status.json", "[::1]:%d" % at[1]).startswith(b"HTTP/1.1 200")
expect(count > 20, "only %d answers in 3 s" % count)
end(process, 5.0)  # a page that asked just now is waited for, 3 s at most

# Anybody reaches this one, and that is said.
process, at = begin("D", "0.0.0.0:0")
said = open(out + ".err").read()
expect("warning: everybody who reaches" in said, "no warning: " + said)
at = ("127.0.0.1", at[1])
expect(b" 200 " in get(at, "/", "10.1.2.3")[:16] and b" 403 " in get(at, "/", "evil.example")[:16], "Host at 0.0.0.0")
end(process, 5.0)
print("the end came after %s s; %d answers in 3 s; %.0f MiB at most, %.0f before" % (", ".join("%.2f" % t for t in took), count, peak_mib, calm_mib))
