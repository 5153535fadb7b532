#include "orchestrator/watch/status_page.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "calib/statistics/data_screen.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/run/dwell_monitor.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

constexpr std::size_t transitions_kept = 12;
constexpr std::size_t seconds_shown = 600;  // the newest of a long dwell

std::string json_of(const AxisTriple& value) {
  return json_list(
      {json_number(value[Axis::heading]), json_number(value[Axis::pitch]), json_number(value[Axis::roll])});
}

}  // namespace

LiveStatus::LiveStatus(LiveRun run, std::function<double()> wall_s)
    : run_(std::move(run)), wall_s_(std::move(wall_s)), heartbeat_s_(wall_s_()) {}

void LiveStatus::on_transition(const TransitionRecord& record) {
  const std::lock_guard lock(mutex_);
  transitions_.push_back(format_transition(record));
  if (transitions_.size() > transitions_kept) transitions_.erase(transitions_.begin());
  if (record.event == RunEvent::pause_wanted) {
    pause_ = record.detail;
    return;
  }
  const bool bad = record.to == RunState::stopping || record.to == RunState::failed ||
                   record.event == RunEvent::dwell_bad || record.event == RunEvent::motion_data_lost;
  if (bad && !record.detail.empty()) last_error_ = record.detail;
}

void LiveStatus::on_dropout(const Dropout& dropout) {
  const std::lock_guard lock(mutex_);
  last_error_ = dropout_words(dropout.serial, dropout.why);
}

void LiveStatus::on_progress(const RunSnapshot& snapshot) {
  const std::lock_guard lock(mutex_);
  snapshot_ = snapshot;
  heartbeat_s_ = wall_s_();
}

Status LiveStatus::start(const RecordingInfo& info) {
  const std::lock_guard lock(mutex_);
  second_samples_ = std::size_t(std::max(1.0, std::round(1.0 / info.sample_period_s)));
  const double second_s = double(second_samples_) * info.sample_period_s;
  per_count_ = mean_per_count(info, std::int64_t(second_samples_));
  pulse_[0] = info.gyro_increment == IncrementKind::pulses ? per_count_[0] * second_s * 3600.0 : 0.0;
  pulse_[1] = info.accel_increment == IncrementKind::pulses ? per_count_[3] * second_s * 1000.0 : 0.0;
  return {};
}

Status LiveStatus::begin_segment(const Segment& segment) {
  const std::lock_guard lock(mutex_);
  dwelling_ = segment.kind != SegmentKind::rotate;
  if (dwelling_) {
    dwell_.clear();
    sum_ = {};
    in_sum_ = 0;
  }
  return {};
}

Status LiveStatus::add(std::span<const ImuSample> samples) {
  const std::lock_guard lock(mutex_);
  has_temperature_ = !std::isnan(samples.back().temperature_c);
  temperature_c_ = samples.back().temperature_c;
  if (!dwelling_) return {};
  for (const ImuSample& sample : samples) {
    for (std::size_t i = 0; i < 6; ++i) sum_[i] += channel_of(sample, i);
    if (++in_sum_ < second_samples_) continue;
    for (std::size_t i = 0; i < 6; ++i) sum_[i] *= per_count_[i];
    if (dwell_.size() == seconds_shown) dwell_.erase(dwell_.begin());
    dwell_.push_back(std::exchange(sum_, {}));
    in_sum_ = 0;
  }
  return {};
}

void LiveStatus::show_known(const std::string& text, std::vector<NeededSigma> known) {
  const std::lock_guard lock(mutex_);
  known_text_ = text;
  known_ = std::move(known);
}

void LiveStatus::show_operator(const OperatorScreen& screen) {
  const std::lock_guard lock(mutex_);
  operator_ = screen;
}

void LiveStatus::end(const std::string& how, Tone tone, const std::vector<std::string>& verification) {
  const std::lock_guard lock(mutex_);
  ended_ = how;
  operator_.reset();
  verification_ = verification;
  ended_as_ = tone;
  heartbeat_s_ = wall_s_();
}

LiveStatus::Headline LiveStatus::headline() const {
  const RunSnapshot& s = snapshot_;
  std::string gone;
  for (const UnitSnapshot& unit : s.units)
    if (!unit.dropped_out.empty()) gone += (gone.empty() ? "; dropped out: " : ", ") + unit.serial;
  if (!ended_.empty()) return {ended_ + gone, gone.empty() ? ended_as_ : std::max(ended_as_, Tone::attention)};
  const std::string step = "step " + std::to_string(s.step_place) + "/" + std::to_string(s.step_count) + ", ";
  Headline head{"Running: " + step + phase_words(s, run_.by_hand), gone.empty() ? Tone::good : Tone::attention};
  if (waits_for_operator(s, run_.by_hand)) {
    const bool paused = operator_ && operator_->task.kind == OperatorTask::Kind::paused;
    head = {(paused ? "Paused: " : "Waits for the operator: ") + step + phase_words(s, run_.by_hand), Tone::attention};
  } else if (s.state == RunState::stopping) {
    head = {"Stopping: " + (last_error_.empty() ? step + "the table" : last_error_), Tone::attention};
  }
  if (!pause_.empty()) {
    head.text += "; " + pause_;
    head.tone = Tone::attention;
  }
  head.text += gone;
  return head;
}

std::string LiveStatus::json() const {
  const std::lock_guard lock(mutex_);
  const RunSnapshot& s = snapshot_;
  const Headline head = headline();
  JsonObject o;
  o.text("headline", head.text);
  o.text("tone", to_string(head.tone));
  o.text("unit", run_.unit);
  o.text("station", run_.station);
  o.text("sequence", run_.sequence);
  o.text("folder", run_.folder);
  o.flag("simulated", run_.simulated);
  o.number("step", s.step);
  o.number("step_place", double(s.step_place));
  o.number("step_count", double(s.step_count));
  o.text("phase", phase_words(s, run_.by_hand));
  o.number("phase_fraction", s.phase_fraction);
  o.number("run_fraction", s.run_fraction);
  o.text("table", (waits_for_operator(s, run_.by_hand) ? "by hand" : std::string(to_string(s.table))) +
                      (s.chamber.empty() ? "" : "; " + s.chamber));
  o.raw("position_deg", json_of(s.position_deg));
  o.raw("rate_degps", json_of(s.rate_degps));
  o.number("eta_s", s.eta_s);
  // A plan does not contain the time that a person takes for a turn.
  o.text("eta_utc", s.end_utc_s > 0.0 && !run_.by_hand ? format_utc(s.end_utc_s) : "");
  o.number("moves_left", double(s.moves_left));
  o.text("time_utc", s.utc_s > 0.0 ? format_utc(s.utc_s) : "");
  o.number("lost_samples", double(s.lost_samples));
  std::vector<std::string> units, known;
  for (const UnitSnapshot& unit : s.units) {
    JsonObject one;
    one.text("serial", unit.serial);
    one.number("samples", double(unit.recorded_samples));
    one.number("lost_samples", double(unit.lost_samples));
    one.text("dropped_out", unit.dropped_out);
    units.push_back(one.end());
  }
  o.list("units", units);
  o.raw("temperature_c", has_temperature_ ? json_number(double(temperature_c_)) : "null");
  o.number("heartbeat_age_s", wall_s_() - heartbeat_s_);
  o.text("last_error", last_error_);
  o.text("pause", pause_);
  o.text("ended", ended_);
  o.raw("operator", operator_ ? json_of(*operator_) : "null");
  o.text("known_text", known_text_);
  for (const NeededSigma& one : known_) {
    JsonObject bar;
    const std::string key = parameter_key(one.parameter), unit = unit_text(quantity_unit(key));
    bar.text("key", key);
    bar.text("name", quantity_name(key) + (unit.empty() ? "" : ", " + unit));
    bar.number("sigma", one.sigma);
    bar.number("needed", one.needed);
    known.push_back(bar.end());
  }
  o.list("known", known);
  o.texts("verification", verification_);
  o.texts("transitions", transitions_);
  o.texts("results", run_.results);
  o.list("pulse", {json_number(pulse_[0]), json_number(pulse_[1])});
  // The dwell second by second, relative to the first, and the largest standard deviation of a triad, which measures stillness.
  std::array<double, 2> stillness{};
  std::vector<std::string> series;
  for (std::size_t i = 0; i < 6; ++i) {
    std::vector<std::string> points;
    Scatter scatter;
    for (const Channels& second : dwell_) {
      scatter.add(second[i]);
      points.push_back(json_number(second[i] - scatter.first));
    }
    series.push_back(json_list(points));
    if (dwell_.size() > 1) stillness[i / 3] = std::max(stillness[i / 3], std::sqrt(scatter.variance()));
  }
  o.number("still_gyro_degps", stillness[0]);
  o.number("still_accel_mps2", stillness[1]);
  o.list("dwell", series);
  return o.end();
}

extern const std::string_view status_page_html;  // status_page.html

void StatusPage::say_goodbye() {
  const double began_s = monotonic_s();
  if (began_s - polled_s_ > 5.0) return;
  fresh_s_ = began_s;
  const long polls = polls_;
  while (polls_ == polls && monotonic_s() - began_s < 3.0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // lets the answer get out
}

std::optional<PageText> StatusPage::page(std::string_view path) {
  constexpr double shown_for_s = 0.2;
  const bool is_status = path == "/status.json";
  if (!is_status && path != "/") return {};
  const double now_s = monotonic_s();
  if (now_s - rendered_s_ > shown_for_s || rendered_s_ < fresh_s_) {
    json_ = run_.json();
    rendered_s_ = now_s;
  }
  if (!is_status) return page_with(status_page_html, json_);
  polled_s_ = monotonic_s();
  ++polls_;
  return PageText{"application/json", json_};
}

Result<std::unique_ptr<StatusPage>> StatusPage::open(const std::string& address, const LiveStatus& run) {
  std::unique_ptr<StatusPage> page(new StatusPage(run));
  page->server_ = TRY(PageServer::open(address, [&one = *page](std::string_view path) { return one.page(path); }));
  return page;
}

}  // namespace turncal
