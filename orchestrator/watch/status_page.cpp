#include "orchestrator/watch/status_page.h"

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "imu_io/base/format_number.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

// INITIAL is replaced by the first status, so that the page shows something at once and without a second request.
constexpr const char* page_html = R"html(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>turncal</title><style>
body{font:15px/1.5 system-ui,sans-serif;margin:1.5em auto;max-width:60em;padding:0 1em;color:#222;background:#fff}
h1{font-size:1.4em;margin:0 0 .3em}table{border-collapse:collapse}td,th{padding:.15em 1em .15em 0;text-align:left;vertical-align:top}
th{font-weight:600;color:#555}#state{padding:.5em .8em;border-radius:4px;background:#e5f3e8;margin:.6em 0}
#state.bad{background:#fbe3e0}#state.old{background:#fdf3d0}progress{width:100%;height:1em}
svg{width:100%;height:11em;border:1px solid #ccc;background:#fafafa}pre{overflow:auto;font-size:12px;background:#f6f6f6;padding:.6em}
.legend span{margin-right:1em}</style></head><body>
<h1 id="title">turncal</h1><div id="state"></div><progress id="run" max="1"></progress>
<table id="facts"></table>
<h2>Running dwell</h2><p class="legend">angle turned and velocity gained, less the straight line through both ends, one point a second: level while unit and table rest; a bend is a drift, a corner a knock.
<span style="color:#c33">x</span><span style="color:#283">y</span><span style="color:#26c">z</span></p>
<div>angle, <span id="g"></span> arcsec from bottom to top</div><svg id="gyro" viewBox="0 0 600 120" preserveAspectRatio="none"></svg>
<div>velocity, <span id="a"></span> mm/s from bottom to top</div><svg id="accel" viewBox="0 0 600 120" preserveAspectRatio="none"></svg>
<h2>Last transitions</h2><pre id="log"></pre><h2>Last results</h2><pre id="results"></pre>
<script>
let status = INITIAL, heard = new Date(), silent = false;
const byId = id => document.getElementById(id), fix = (x, n) => x === null ? "-" : x.toFixed(n);
// From means over a second to what they add up to, less the chord.
function gained(series, unit) {
  return series.map(s => {
    const total = s.reduce((sum, y) => sum + y, 0);
    let sum = 0;
    return s.map((y, k) => unit * ((sum += y) - total * (k + 1) / s.length));
  });
}
function plot(svg, label, series) {
  const all = series.flat(), low = Math.min(0, ...all), high = Math.max(0, ...all), span = (high - low) || 1;
  byId(label).textContent = span.toPrecision(2);
  byId(svg).innerHTML = series.map((s, i) => '<polyline fill="none" stroke="' + ["#c33", "#283", "#26c"][i] +
    '" vector-effect="non-scaling-stroke" points="' + s.map((y, k) => (s.length > 1 ? 600 * k / (s.length - 1) : 0).toFixed(1) + "," +
    (115 - 110 * (y - low) / span).toFixed(1)).join(" ") + '"/>').join("");
}
function show() {
  const s = status, axes = ["heading", "pitch", "roll"], state = byId("state");
  byId("title").textContent = "turncal: unit " + s.unit + (s.simulated ? " (dry run: simulated, no real unit)" : "");
  if (silent && !s.ended) {
    state.className = "bad";
    state.textContent = "The program has not answered since " + heard.toLocaleTimeString() + ": the run has died.";
  } else if (s.ended) {
    state.className = s.ended.startsWith("done") ? "" : "bad";
    state.textContent = "The run is over: " + s.ended;
  } else if (s.heartbeat_age_s > 10) {
    state.className = "old";
    state.textContent = "The run's loop has not reported for " + fix(s.heartbeat_age_s, 0) + " s.";
  } else {
    state.className = "";
    state.textContent = "Running: step " + s.step_place + "/" + s.step_count + ", " + s.phase + ", " + (s.pause || "ends at " + (s.eta_utc || "-"));
  }
  byId("run").value = s.run_fraction;
  const units = s.units.map(u => [u.serial, u.dropped_out ? "dropped out: " + u.dropped_out : u.samples + " samples, " + u.lost_samples + " lost"]);
  const rows = [["unit", s.unit], ...(units.length > 1 ? units : []), ["station, sequence", s.station + ", " + s.sequence], ["step", s.step_place + "/" + s.step_count + " (number " + s.step + ")"],
    ["phase", s.phase + " " + fix(100 * s.phase_fraction, 0) + " %" + (s.repeats ? ", repeat " + s.repeats : "")],
    ["table", s.table],
    ["angles", axes.map((a, i) => a + " " + fix(s.position_deg[i], 4)).join(", ") + " deg"],
    ["rates", axes.map((a, i) => a + " " + fix(s.rate_degps[i], 4)).join(", ") + " deg/s"],
    ["stillness (standard deviation)", s.still_gyro_degps.toPrecision(2) + " deg/s, " + s.still_accel_mps2.toPrecision(2) + " m/s²"],
    ["temperature", fix(s.temperature_c, 2) + " C"], ["samples lost", s.lost_samples], ["last error", s.last_error || "none"],
    ["heartbeat", fix(s.heartbeat_age_s, 1) + " s ago"], ["station time", s.time_utc], ["ends at", s.eta_utc]];
  const table = byId("facts");
  table.replaceChildren(...rows.map(([key, value]) => {
    const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
    head.textContent = key; cell.textContent = value; row.append(head, cell); return row;
  }));
  plot("gyro", "g", gained(s.dwell.slice(0, 3), 3600)); plot("accel", "a", gained(s.dwell.slice(3), 1000));
  byId("log").textContent = s.transitions.join("\n"); byId("results").textContent = s.results.join("\n") || "none on record";
}
async function poll() {
  const limit = new AbortController(), timer = setTimeout(() => limit.abort(), 3000);
  try {
    const answer = await fetch("status.json", {cache: "no-store", signal: limit.signal});
    status = await answer.json(); heard = new Date(); silent = false;
  } catch (error) { silent = true; }
  clearTimeout(timer); show(); setTimeout(poll, 1000);
}
show(); poll();
</script></body></html>
)html";

}  // namespace

struct StatusPage::State {
  httplib::Server server;
  std::thread thread;
  std::string url;
  std::atomic<long> polls{0};
  std::atomic<double> polled_s{-1e9};
};

StatusPage::StatusPage() : state_(std::make_unique<State>()) {}

StatusPage::~StatusPage() {
  state_->server.stop();
  if (state_->thread.joinable()) state_->thread.join();
}

void StatusPage::say_goodbye() {
  const double began_s = steady_wall_s();
  if (began_s - state_->polled_s > 5.0) return;
  const long polls = state_->polls;
  while (state_->polls == polls && steady_wall_s() - began_s < 3.0)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the answer is on its way
}

std::string StatusPage::url() const { return state_->url; }

Result<std::unique_ptr<StatusPage>> StatusPage::open(const std::string& address, const LiveView& view) {
  const std::size_t colon = address.rfind(':');
  const auto port = colon == std::string::npos ? std::nullopt : parse_integer<int>(address.substr(colon + 1));
  if (!port || *port < 0 || *port > 65535 || colon == 0) {
    return input_error("--listen '" + address + "': expected ADDRESS:PORT, as 127.0.0.1:8080");
  }
  const std::string host = address.substr(0, colon);
  std::unique_ptr<StatusPage> page(new StatusPage);
  httplib::Server& server = page->state_->server;
  server.new_task_queue = [] { return new httplib::ThreadPool(2); };
  server.set_keep_alive_max_count(1);
  server.Get("/", [&view](const httplib::Request&, httplib::Response& response) {
    std::string html = page_html;
    html.replace(html.find("INITIAL"), 7, view.json());
    response.set_content(html, "text/html; charset=utf-8");
  });
  State& state = *page->state_;
  server.Get("/status.json", [&view, &state](const httplib::Request&, httplib::Response& response) {
    response.set_header("Cache-Control", "no-store");
    response.set_content(view.json(), "application/json");
    state.polled_s = steady_wall_s();
    ++state.polls;
  });
  // Not the library's SO_REUSEPORT: a port that another program serves is refused.
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  const int bound = *port == 0 ? server.bind_to_any_port(host) : (server.bind_to_port(host, *port) ? *port : -1);
  if (bound < 0)
    return input_error("--listen '" + address + "': cannot listen there (in use, or not an address of this machine)");
  page->state_->url = "http://" + host + ":" + std::to_string(bound) + "/";
  page->state_->thread = std::thread([&server] { server.listen_after_bind(); });
  const double began_s = steady_wall_s();
  while (!server.is_running() && steady_wall_s() - began_s < 2.0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return page;
}

}  // namespace turncal
