#include "orchestrator/watch/status_page.h"

#include <atomic>
#include <chrono>
#include <thread>

#include "orchestrator/watch/page_server.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

constexpr double shown_for_s = 0.2;

// INITIAL is replaced by the first status, so that the page shows something at once and without a second request.
constexpr const char* page_html = R"html(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1"><title>turncal</title><style>
body{font:15px/1.5 system-ui,sans-serif;margin:1.5em auto;max-width:60em;padding:0 1em;color:#222;background:#fff;overflow-wrap:anywhere}
h1{font-size:1.4em;margin:0 0 .3em}table{border-collapse:collapse}td,th{padding:.15em 1em .15em 0;text-align:left;vertical-align:top}
th{font-weight:600;color:#555;overflow-wrap:normal}tr{break-inside:avoid}
#state{padding:.5em .8em;border-radius:4px;background:#e5f3e8;margin:.6em 0}
#state.bad{background:#fbe3e0}#state.attention{background:#fdf3d0}progress{width:100%;height:1em}
svg{width:100%;height:11em;border:1px solid #ccc;background:#fafafa}pre{overflow:auto;font-size:12px;background:#f6f6f6;padding:.6em}
.axis{display:flex;justify-content:space-between;color:#555;font-size:13px}
@media(max-width:34em){body{margin:.8em auto}th,td{display:block;padding-right:0}td{padding-bottom:.5em}}
</style></head><body>
<h1 id="title">turncal</h1><div id="state"></div><progress id="run" max="1"></progress>
<table id="facts"></table>
<h2>Running dwell</h2><p>Angle turned and velocity gained, less the straight line through both ends, one point a second: level while unit and table rest; a bend is a drift.
A corner of one pulse or two is the unit's resolution, a much larger one a knock.
<span style="color:#c33">x</span> <span style="color:#283">y</span> <span style="color:#26c">z</span></p>
<div>angle, <span id="g"></span></div><svg id="gyro" viewBox="0 0 600 120" preserveAspectRatio="none"></svg>
<div class="axis"><span>0 s</span><span class="end"></span></div>
<div>velocity, <span id="a"></span></div><svg id="accel" viewBox="0 0 600 120" preserveAspectRatio="none"></svg>
<div class="axis"><span>0 s</span><span class="end"></span></div>
<h2>Last transitions</h2><pre id="log"></pre><h2>Last results</h2><pre id="results"></pre>
<script>
let status = INITIAL, heard = new Date(), silent = false, timer = 0;
const byId = id => document.getElementById(id), fix = (x, n) => x === null ? "-" : x.toFixed(n);
// From means over a second to what they add up to, less the chord.
function gained(series, unit) {
  return series.map(s => {
    const total = s.reduce((sum, y) => sum + y, 0);
    let sum = 0;
    return s.map((y, k) => unit * ((sum += y) - total * (k + 1) / s.length));
  });
}
function plot(svg, label, series, unit, pulse) {
  const all = series.flat(), low = Math.min(0, ...all), high = Math.max(0, ...all);
  // Never less than some pulses: what the unit cannot resolve must not fill the picture.
  const span = Math.max(high - low, 6 * pulse) || 1, middle = (low + high) / 2;
  byId(label).textContent = span.toPrecision(2) + " " + unit + " from bottom to top" + (pulse ? ", one pulse is " + pulse.toPrecision(2) + " " + unit : "");
  byId(svg).innerHTML = series.map((s, i) => '<polyline fill="none" stroke="' + ["#c33", "#283", "#26c"][i] +
    '" vector-effect="non-scaling-stroke" points="' + s.map((y, k) => (s.length > 1 ? 600 * k / (s.length - 1) : 0).toFixed(1) + "," +
    (60 - 110 * (y - middle) / span).toFixed(1)).join(" ") + '"/>').join("");
}
function show() {
  const s = status, axes = ["heading", "pitch", "roll"], state = byId("state");
  byId("title").textContent = "turncal: unit " + s.unit + (s.simulated ? " (simulated: no real unit)" : "");
  state.className = s.tone;
  state.textContent = s.headline + (s.ended || s.pause || !s.eta_utc ? "" : "; ends at " + s.eta_utc);
  if (silent && !s.ended) {
    state.className = "attention";
    state.textContent = "The program has not answered since " + heard.toLocaleTimeString() +
      ": it has ended, or cannot be reached. What it said last is below; how it ended is in " + s.folder + "/run.log.";
  } else if (s.heartbeat_age_s > 10 && !s.ended) {
    state.className = "attention";
    state.textContent = "The run's loop has not reported for " + fix(s.heartbeat_age_s, 0) + " s.";
  }
  byId("run").value = s.run_fraction;
  const units = s.units.map(u => [u.serial, u.dropped_out ? "dropped out: " + u.dropped_out : u.samples + " samples, " + u.lost_samples + " lost"]);
  const rows = [["unit", s.unit], ...(units.length > 1 ? units : []), ["station, sequence", s.station + ", " + s.sequence], ["step", s.step_place + "/" + s.step_count + " (number " + s.step + ")"],
    ["phase", s.phase + " " + fix(100 * s.phase_fraction, 0) + " %"],
    ["table", s.table],
    ["angles", axes.map((a, i) => a + " " + fix(s.position_deg[i], 4)).join(", ") + " deg"],
    ["rates", axes.map((a, i) => a + " " + fix(s.rate_degps[i], 4)).join(", ") + " deg/s"],
    ["stillness (standard deviation)", s.still_gyro_degps.toPrecision(2) + " deg/s, " + s.still_accel_mps2.toPrecision(2) + " m/s²"],
    ["temperature", s.temperature_c === null ? "not told" : fix(s.temperature_c, 2) + " C"], ["samples lost", s.lost_samples], ["last error", s.last_error || "none"],
    ["heartbeat", silent ? "not heard" : fix(s.heartbeat_age_s, 1) + " s ago"], ["station time", s.time_utc], ["ends at", s.eta_utc || s.moves_left + " turns are left"]];
  byId("facts").replaceChildren(...rows.map(([key, value]) => {
    const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
    head.textContent = key; cell.textContent = value; row.append(head, cell); return row;
  }));
  plot("gyro", "g", gained(s.dwell.slice(0, 3), 3600), "arcsec", s.pulse[0]); plot("accel", "a", gained(s.dwell.slice(3), 1000), "mm/s", s.pulse[1]);
  for (const end of document.querySelectorAll(".end")) end.textContent = s.dwell[0].length + " s";
  byId("log").textContent = s.transitions.join("\n"); byId("results").textContent = s.results.join("\n") || "none on record";
}
async function poll() {
  clearTimeout(timer);
  const limit = new AbortController(), late = setTimeout(() => limit.abort(), 3000);
  try {
    const answer = await fetch("status.json", {cache: "no-store", signal: limit.signal});
    status = await answer.json(); heard = new Date(); silent = false;
  } catch (error) { silent = true; }
  clearTimeout(late); show(); clearTimeout(timer); timer = setTimeout(poll, 1000);
}
// A browser asks less often for a page that is hidden.
document.addEventListener("visibilitychange", () => { if (!document.hidden) poll(); });
show(); poll();
</script></body></html>
)html";

}  // namespace

struct StatusPage::State {
  std::unique_ptr<PageServer> server;
  std::atomic<long> polls{0};  // answered with what is newer than `fresh_s`
  std::atomic<double> polled_s{-1e9};
  std::atomic<double> fresh_s{-1e9};
};

StatusPage::StatusPage() : state_(std::make_unique<State>()) {}
StatusPage::~StatusPage() = default;

void StatusPage::say_goodbye() {
  const double began_s = steady_wall_s();
  if (began_s - state_->polled_s > 5.0) return;
  state_->fresh_s = began_s;
  const long polls = state_->polls;
  while (state_->polls == polls && steady_wall_s() - began_s < 3.0)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the answer is on its way
}

std::string StatusPage::url() const { return state_->server->url(); }

std::string StatusPage::warning() const {
  if (state_->server->loopback()) return "";
  return "warning: whoever reaches " + url() +
         " can read the status page: it has no access control and is not encrypted";
}

Result<std::unique_ptr<StatusPage>> StatusPage::open(const std::string& address, const LiveView& view) {
  std::unique_ptr<StatusPage> page(new StatusPage);
  State& state = *page->state_;
  // However often it is asked for, the view is locked and written out a few times a second. Only the server's thread comes here.
  struct Newest {
    std::string json;
    double made_s = -1e9;
  };
  const auto newest = std::make_shared<Newest>();
  const auto status = [&view, &state, newest]() -> const std::string& {
    const double now_s = steady_wall_s();
    if (now_s - newest->made_s > shown_for_s || newest->made_s < state.fresh_s) *newest = {view.json(), now_s};
    return newest->json;
  };
  const auto pages = [&state, status](std::string_view path) -> std::optional<PageText> {
    if (path == "/") {
      std::string html = page_html;
      return PageText{"text/html; charset=utf-8", html.replace(html.find("INITIAL"), 7, status())};
    }
    if (path != "/status.json") return {};
    PageText text{"application/json", status()};
    state.polled_s = steady_wall_s();
    ++state.polls;
    return text;
  };
  Result<std::unique_ptr<PageServer>> server = PageServer::open(address, pages);
  if (!server) return server.error();
  state.server = std::move(*server);
  return page;
}

}  // namespace turncal
