#include "orchestrator/service/station_view.h"

#include <crypt.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <system_error>
#include <utility>

#include "calib/statistics/numerics.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/line/shift_report.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/station_config.h"

// After Eigen: it has a macro with the name of one of its parameters.
#include <resolv.h>

namespace turncal {

namespace {

constexpr double looked_back_s = 86400.0;
constexpr SqlPatience patience{.wait_s = 2.0, .all_s = 5.0};

// Returns results by station, in the order of names.
std::vector<StationResults> results_by_station(const std::vector<AttemptRecord>& attempts) {
  std::map<std::pair<bool, std::string>, StationResults> found;
  for (const AttemptRecord& attempt : attempts) {
    if (attempt.outcome == outcome_running) continue;
    StationResults& station = found[{attempt.simulated, attempt.station}];
    station.station = attempt.station;
    station.simulated = attempt.simulated;
    ++station.attempts;
    const AttemptKind kind = kind_of(attempt);
    station.judged += kind != AttemptKind::says_nothing;
    station.passed += kind == AttemptKind::passed;
    if (attempt.time_utc < station.last_time_utc) continue;
    station.last_unit = attempt.unit;
    station.last_outcome = attempt.outcome;
    station.last_time_utc = attempt.time_utc;
  }
  std::vector<StationResults> stations;
  for (auto& [key, station] : found) stations.push_back(std::move(station));
  return stations;
}

Result<ResultsView> newest_results(const std::string& database, double now_utc_s) {
  const ResultsDatabase open = TRY(ResultsDatabase::open_to_read(database, patience));
  ResultsView view;
  const std::vector<AttemptRecord> last = TRY(open.attempts({.newest = 1}));
  const double end_s = last.empty() ? now_utc_s : parse_utc(last.front().time_utc).value_or(now_utc_s);
  const bool past = end_s < now_utc_s - looked_back_s;
  if (past) view.until_utc = last.front().time_utc;
  view.stations = results_by_station(
      TRY(open.attempts({.from = format_utc((past ? end_s : now_utc_s) - looked_back_s), .to = view.until_utc})));
  return view;
}

}  // namespace

ResultsView look_at_results(const std::string& database, double now_utc_s) {
  Result<ResultsView> view = newest_results(database, now_utc_s);
  return view ? std::move(*view) : ResultsView{.defect = view.error().message, .until_utc = {}, .stations = {}};
}

std::string json_of(const ResultsView& view) {
  std::vector<std::string> stations;
  for (StationResults s : view.stations) {
    const Fields fields = {{"station", &s.station},
                           {"simulated", &s.simulated},
                           {"attempts", &s.attempts},
                           {"judged", &s.judged},
                           {"passed", &s.passed},
                           {"last_unit", &s.last_unit},
                           {"last_outcome", &s.last_outcome},
                           {"last_time_utc", &s.last_time_utc}};
    stations.push_back(json_of(fields));
  }
  JsonObject o;
  o.text("defect", view.defect);
  o.text("until_utc", view.until_utc);
  o.list("stations", stations);
  return o.end();
}

namespace {

namespace fs = std::filesystem;

constexpr std::size_t shown = 12;        // outcomes, and waiting units
constexpr std::size_t looked_at = 20;    // intervals between runs
constexpr double longest_run_s = 86400;  // a longer interval is a weekend
constexpr double clock_off_s = 60.0;
constexpr double silent_after_s = 600.0;

// Sets the time for a unit, mounting included: the median interval between the last runs, shared by their units, which have one time.
void show_pace(const std::vector<UnitOutcome>& outcomes, StationView& view) {
  std::vector<std::pair<double, std::size_t>> runs;  // end, units
  for (const UnitOutcome& outcome : outcomes) {
    if (standing_of(&outcome) == Standing::waits) continue;
    const double end_s = parse_utc(outcome.time_utc).value_or(0.0);
    if (runs.empty() || runs.back().first != end_s) runs.emplace_back(end_s, 0);
    view.at_once = ++runs.back().second;
  }
  std::vector<double> each_s;
  for (std::size_t i = runs.size() > looked_at ? runs.size() - looked_at : 1; i < runs.size(); ++i)
    if (const double run_s = runs[i].first - runs[i - 1].first; run_s > 0.0 && run_s < longest_run_s)
      each_s.push_back(run_s / double(runs[i].second));
  if (each_s.size() >= 2) view.unit_s = median(each_s);
}

// Returns the unit that the batch wants mounted, and what it says of it; empty: it waits for none.
std::vector<std::string> unit_to_mount(const std::string& queue) {
  const Result<std::string> text = read_whole_file(mounting_file(queue), 1024);
  std::string_view remaining = text ? std::string_view(*text) : "";
  std::vector<std::string> lines;
  while (!remaining.empty()) lines.emplace_back(next_line(remaining));
  return lines;
}

// Returns whether proc(5) shows the process as stopped, by a debugger or SIGSTOP.
bool is_suspended(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string line;
  std::getline(file, line);
  const std::size_t name_end = line.rfind(") ");
  return name_end != std::string::npos && (line[name_end + 2] == 'T' || line[name_end + 2] == 't');
}

void show_queue(const std::vector<std::string>& queue, const std::vector<UnitOutcome>& outcomes, StationView& view) {
  std::size_t looks = 0;
  for (const std::string& unit : queue) {
    const UnitOutcome* outcome = find_outcome(outcomes, unit);
    const Standing standing = standing_of(outcome);
    if (standing == Standing::waits) continue;
    ++view.done;
    view.passed += standing == Standing::passed;
    if (standing == Standing::not_passed && ++looks <= shown)
      view.for_a_person.push_back("unit " + unit + ": " + outcome->outcome +
                                  (outcome->reason.empty() ? "" : ": " + outcome->reason));
  }
  if (looks > shown) view.for_a_person.push_back("and " + counted(looks - shown, "more unit"));
  view.outcomes.assign(outcomes.rbegin(), outcomes.rbegin() + std::ptrdiff_t(std::min(outcomes.size(), shown)));
  show_pace(outcomes, view);
}

// Returns the time since anything of the run was written: journal, log, samples.
double silence_of(const std::string& folder, double now_utc_s) {
  double newest_s = 0.0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code none;
    const fs::file_time_type time = fs::last_write_time(entry->path(), none);
    const std::chrono::duration<double> at = std::chrono::file_clock::to_sys(time).time_since_epoch();
    if (!none) newest_s = std::max(newest_s, at.count());
  }
  return now_utc_s - newest_s;
}

// Returns "dwelling" and its detail in words.
std::string words_of(const JournalContents& journal) {
  const JournalFields& transition = journal.transition;
  const std::string& state = value_of(transition, "to");
  const std::string& detail = value_of(transition, "detail");
  const std::string step = value_of(transition, "step");
  std::string words = step.empty() || step == "0" ? "" : "step " + step + ": ";
  if (journal.ended && !detail.empty()) return detail;  // as on the terminal, with the step
  if (state == "moving") return words + (detail.empty() ? "moving" : detail);
  if (state == "dwelling") return words + "at rest" + (detail.empty() ? "" : " (" + detail + ")");
  return words + state_words(state) + (detail.empty() ? "" : ": " + detail);
}

void show_run(const JournalContents& journal, double now_utc_s, StationView& view) {
  view.units = journal.units();
  view.began_utc = journal.begin_value("began_utc");
  view.phase = words_of(journal);
  const std::optional<double> planned_s = parse_number<double>(journal.begin_value("planned_s"));
  const std::optional<double> time_s = parse_number<double>(value_of(journal.transition, "time_s"));
  const std::optional<double> utc_s = parse_number<double>(value_of(journal.transition, "utc_s"));
  if (utc_s) view.last_word_utc = format_utc(*utc_s);
  const bool live = !view.simulated && utc_s;
  if (planned_s && time_s && *planned_s > 0.0 && view.state == StationState::running) {
    const double since_s = live ? std::max(0.0, now_utc_s - *utc_s) : 0.0;
    view.fraction = std::min(1.0, (*time_s + since_s) / *planned_s);
    if (live) view.run_end_utc_s = std::max(now_utc_s, *utc_s + *planned_s - *time_s);
  }
  const auto rounded = [&journal](const char* key) {
    return significant(parse_number<double>(value_of(journal.estimate, key)).value_or(0.0), 2);
  };
  if (!journal.estimate.empty() && !value_of(journal.estimate, "sigma").empty())
    view.known =
        quantity_name(value_of(journal.estimate, "worst")) + ": sigma " + rounded("sigma") + " of " + rounded("needed");
  view.pausing = view.state == StationState::running && journal.pause_asked;
  // Nothing is recorded while a chamber comes to its temperature.
  if (view.state == StationState::running && value_of(journal.transition, "to") != "resting")
    if (const double silence_s = silence_of(view.folder, now_utc_s); silence_s > silent_after_s) {
      view.silent_s = silence_s;
      view.urgent("the run has written nothing for " + clock_time(silence_s) + ": look at the station");
    }
  if (view.process && live && *utc_s > now_utc_s + clock_off_s)
    view.urgent("the clock of this machine is " + clock_time(*utc_s - now_utc_s) + " behind the run's");
  if (view.process && journal.begin_value("manual") == "true" && value_of(journal.transition, "to") == "moving")
    view.urgent("turn the table: " + value_of(journal.transition, "detail"));
}

StationView unreadable(const ServedStation& station, const Error& error) {
  StationView view;
  view.name = station.name;
  view.state = StationState::unreadable;
  view.tone = Tone::bad;
  view.headline = "the queue or the run cannot be read: " + error.message;
  return view;
}

}  // namespace

StationView look_at(const ServedStation& station, double now_utc_s) {
  const Result<std::vector<std::string>> queue = read_queue(station.queue);
  if (!queue) return unreadable(station, queue.error());
  const Result<std::vector<UnitOutcome>> outcomes = read_outcomes(station.queue);
  if (!outcomes) return unreadable(station, outcomes.error());

  StationView view;
  view.name = station.name;
  view.runs = station.runs;
  show_queue(*queue, *outcomes, view);
  view.waiting = next_units(*queue, *outcomes, queue->size());
  const std::optional<pid_t> batch = lock_holder(station.queue + ".batch.lock");
  const std::optional<RunFolder> run = newest_run(station.runs);
  std::optional<JournalContents> journal;
  if (run) {
    Result<JournalContents> read = read_journal(run->path + "/" + journal_name);
    if (!read && !run->process) return unreadable(station, read.error());  // one that is being made is read later
    if (read) journal = std::move(*read);
  }
  // A unit removed from the queue is not resumed.
  const auto waits = [&view](const std::string& unit) { return holds(view.waiting, unit); };
  const bool left = journal && !run->process && !is_over(*journal) && std::ranges::any_of(journal->units(), waits);
  if (journal && !run->process) view.table_warning = journal->table_warning();
  const bool stands = left || !view.table_warning.empty();
  const bool paused = left && journal->pause_asked && journal->ended == RunState::interrupted;
  view.process = run && run->process ? run->process : batch;
  view.simulated = journal && journal->begin_value("simulated") == "true";
  const std::vector<std::string> to_mount = unit_to_mount(station.queue);
  if (run && run->process) {
    view.state = journal && journal->seal_utc_s ? StationState::results : StationState::running;
    view.folder = run->path;
  } else if (batch) {
    view.state = to_mount.empty() ? StationState::results : StationState::mounting;
  } else {
    view.state = stands || !view.waiting.empty() ? StationState::stopped : StationState::idle;
  }
  if (journal && (view.folder == run->path || stands)) {
    view.folder = run->path;
    show_run(*journal, now_utc_s, view);
  }

  const std::string of_units =
      view.units.empty() ? "" : (view.units.size() > 1 ? "units " : "unit ") + join(view.units);
  switch (view.state) {
    case StationState::running:
      view.headline = of_units + ", " + (view.pausing ? "a pause was requested: " : "") + view.phase;
      break;
    case StationState::results:
      view.headline = run && run->process ? of_units + ": recorded, results are being computed" : "between two units";
      break;
    case StationState::mounting:
      view.units = {to_mount.front()};
      view.headline = "waiting for unit " + to_mount.front() + " to be mounted";
      view.urgent("mount unit " + join(to_mount, ": "));
      break;
    case StationState::stopped:
      view.headline = paused   ? of_units + " is paused: " + view.phase
                      : stands ? of_units + " was left unfinished" +
                                     (journal->ended ? ": " : " by a program that ended: ") + view.phase
                               : fmt::format("no batch is running; units in the queue: {}", view.waiting.size());
      if (left || !view.waiting.empty())
        view.urgent((left && journal->ended == RunState::failed ? view.phase + ": put it right, then " : "") +
                    (left ? "start the batch again: it continues with " + of_units : "start the batch"));
      if (!view.table_warning.empty()) view.urgent(view.table_warning);
      break;
    case StationState::idle:
      view.headline = "the queue is done";
      if (!view.for_a_person.empty()) view.headline += fmt::format(": {} of {} passed", view.passed, view.done);
      break;
    case StationState::unreadable: break;
  }
  // Leaves the units after those on the table.
  std::erase_if(view.waiting, [&view](const std::string& unit) { return holds(view.units, unit); });
  if (view.process && is_suspended(*view.process))
    view.urgent("process " + std::to_string(*view.process) +
                " is suspended (SIGSTOP): it neither runs nor receives a stop");
  view.tone = view.state == StationState::stopped && !paused ? Tone::bad
              : view.for_a_person.empty()                    ? Tone::good
                                                             : Tone::attention;
  if (view.process && view.unit_s && !view.simulated) {  // a dry run has its own clock
    const std::size_t to_come = view.waiting.size() + (view.state == StationState::mounting ? 1 : 0);
    const std::size_t at_once = std::max(view.at_once, view.units.size()), runs = (to_come + at_once - 1) / at_once;
    view.queue_end_utc_s = view.run_end_utc_s.value_or(now_utc_s) + *view.unit_s * double(runs * at_once);
  }
  return view;
}

std::string last_folder(const std::string& runs, const std::string& unit) {
  const std::string name = runs + "/" + name_of_unit(unit);
  std::string folder = path_exists(name) ? name : "";
  for (int i = 2; path_exists(name + "." + std::to_string(i)); ++i) folder = name + "." + std::to_string(i);
  return folder;
}

std::string json_of(const StationView& view) {
  const auto time = [](const std::optional<double>& utc_s) { return utc_s ? format_utc(*utc_s) : std::string(); };
  JsonObject o;
  o.text("name", view.name);
  o.text("state", to_string(view.state));
  o.text("tone", to_string(view.tone));
  o.text("headline", view.headline);
  o.texts("units", view.units);
  o.text("folder", view.folder);
  o.flag("simulated", view.simulated);
  o.flag("pausing", view.pausing);
  o.text("began_utc", view.began_utc);
  o.text("last_word_utc", view.last_word_utc);
  o.number("fraction", view.fraction);
  o.text("run_end_utc", time(view.run_end_utc_s));
  o.text("queue_end_utc", time(view.queue_end_utc_s));
  o.number("unit_s", view.unit_s);
  o.text("known", view.known);
  o.number("waiting_count", double(view.waiting.size()));
  o.texts("waiting",
          {view.waiting.begin(), view.waiting.begin() + std::ptrdiff_t(std::min(view.waiting.size(), shown))});
  o.texts("for_a_person", view.for_a_person);
  o.number("done", double(view.done));
  o.number("passed", double(view.passed));
  std::vector<std::string> outcomes;
  for (UnitOutcome outcome : view.outcomes) outcomes.push_back(json_of(fields_of(outcome)));
  o.list("outcomes", outcomes);
  return o.end();
}

std::string metrics_of(const std::vector<StationView>& stations, const ResultsView& results, double now_utc_s) {
  std::map<std::string, std::string> lines;  // by gauge
  const auto add = [&lines](const std::string& name, std::string station, const char* more,
                            std::optional<double> value) {
    for (std::size_t at = 0; (at = station.find_first_of("\\\"", at)) != std::string::npos; at += 2)
      station.insert(at, 1, '\\');
    if (value)
      lines[name] += fmt::format("turncal_{}{{station=\"{}\"{}}} {}\n", name, station, more, format_number(*value));
  };
  for (const StationView& v : stations)
    for (const auto& [name, value] : std::initializer_list<std::pair<const char*, std::optional<double>>>{
             {"station_readable", v.state != StationState::unreadable},
             {"station_running", v.state == StationState::running},
             {"station_tone", int(v.tone)},
             {"station_waits", v.for_a_person.size()},
             {"queue_waiting", v.waiting.size()},
             {"queue_done", v.done},
             {"queue_passed", v.passed},
             {"queue_end_timestamp_seconds", v.queue_end_utc_s},
             {"run_progress_ratio", v.fraction},
             {"run_end_timestamp_seconds", v.run_end_utc_s},
             {"unit_seconds", v.unit_s}})
      if (v.state != StationState::unreadable || holds({"station_readable", "station_tone"}, name))
        add(name, v.name, "", value);
  for (const StationResults& s : results.until_utc.empty() ? results.stations : std::vector<StationResults>())
    for (const auto& [name, count] :
         {std::pair{"day_attempts", s.attempts}, std::pair{"day_judged", s.judged}, std::pair{"day_passed", s.passed}})
      add(name, s.station, s.simulated ? ",simulated=\"true\"" : ",simulated=\"false\"", double(count));
  std::string text =
      fmt::format("# TYPE turncal_{0} gauge\nturncal_{0} {1}\n", "look_timestamp_seconds", format_number(now_utc_s));
  for (const auto& [name, of] : lines) text += "# TYPE turncal_" + name + " gauge\n" + of;
  return text;
}

namespace {

// Returns "/report/1/SN3.2/report.html" for a folder of one of the stations; empty: not a station's, or no report.
std::string link_to(const ServiceConfig& config, const std::string& folder, const std::string& file) {
  const fs::path at = fs::absolute(folder).lexically_normal();
  for (std::size_t k = 0; k < config.stations.size(); ++k) {
    if (at.parent_path() != fs::absolute(config.stations[k].runs).lexically_normal()) continue;
    const std::string link = "/report/" + std::to_string(k + 1) + "/" + at.filename().string() + "/" + file;
    if (report_file(config, link)) return link;
  }
  return "";
}

Result<UnitRecord> record_of(const ServiceConfig& config, const std::string& unit) {
  UnitRecord record{unit, {}, {}, [&config](const std::string& folder, const std::string& file) {
                      return link_to(config, folder, file);
                    }};
  if (!config.database.empty()) {
    const ResultsDatabase open = TRY(ResultsDatabase::open_to_read(config.database, patience));
    record.attempts = TRY(open.attempts({.unit = unit}));
    record.calibrations = TRY(open.list({.unit = unit}, ""));
  }
  for (const ServedStation& station : config.stations) {
    const Result<std::vector<UnitOutcome>> outcomes = read_outcomes(station.queue);
    const UnitOutcome* const outcome = outcomes ? find_outcome(*outcomes, unit) : nullptr;
    const std::string folder = last_folder(station.runs, unit);
    const Result<JournalContents> journal = read_journal(folder + "/" + journal_name);
    if ((!outcome && !journal) || !record.attempts.empty()) continue;
    AttemptRecord& attempt = record.attempts.emplace_back();
    attempt.unit = unit;
    attempt.time_utc = outcome ? outcome->time_utc : journal->begin_value("began_utc");
    attempt.outcome = outcome ? outcome->outcome : outcome_running;
    attempt.reason = outcome ? outcome->reason : "";
    attempt.station = station.name;
    attempt.folder = folder;
    if (!journal) continue;
    attempt.simulated = journal->begin_value("simulated") == "true";
    attempt.began_utc = journal->begin_value("began_utc");
    if (journal->seal_utc_s) attempt.time_utc = format_utc(*journal->seal_utc_s);  // a dry run has a clock of its own
  }
  for (AttemptRecord& attempt : record.attempts) {
    if (attempt.outcome != outcome_running || lock_holder(attempt.folder + "/.lock")) continue;
    const Result<JournalContents> journal = read_journal(attempt.folder + "/" + journal_name);
    if (!journal) continue;
    attempt.outcome = to_string(RunState::interrupted);  // whoever worked on it could not say so
    attempt.reason = words_of(*journal);
  }
  return record;
}

}  // namespace

std::optional<std::string> report_file(const ServiceConfig& config, std::string_view path) {
  const std::vector<std::string_view> parts = split(path, '/');
  const std::size_t station = parts.size() == 5 ? parse_integer<std::size_t>(parts[2]).value_or(0) : 0;
  const auto is_name = [](std::string_view name) { return !name.empty() && name[0] != '.'; };
  if (!is_plain_text(std::string(path)) || station < 1 || station > config.stations.size() || !is_name(parts[3]))
    return {};
  const bool certificate = parts[4].starts_with("certificate") && parts[4].ends_with(".html");
  if (parts[4] != "report.html" && !certificate) return {};
  const std::string file = config.stations[station - 1].runs + "/" + std::string(parts[3]) +
                           (certificate ? "/" : "/diagnosis/") + std::string(parts[4]);
  return path_exists(file) ? std::optional(file) : std::nullopt;
}

Document unit_document(const ServiceConfig& config, const std::string& unit) {
  Result<UnitRecord> record = record_of(config, unit);
  if (record && !(record->attempts.empty() && record->calibrations.empty())) return unit_document(*record);
  Document document{"turncal: unit " + unit, "Unit " + unit};
  document.add(Paragraph{record ? "No run of this unit is on record." : record.error().message, "verdict"});
  return document;
}

namespace {

Status write_down(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                  double now_utc_s) {
  return append_durably(station.queue + ".actions", format_utc(now_utc_s) + " " + operator_name + " " + wanted.action +
                                                        (wanted.unit.empty() ? "" : " " + wanted.unit) + "\n");
}

// A descriptor is opened before the lock is looked at again, so that the process number cannot be another's by then.
Status send_signal(const std::string& lock, pid_t process, int signal) {
  const Descriptor fd(int(::syscall(SYS_pidfd_open, process, 0)));
  if (fd < 0 || lock_holder(lock) != process) return device_error("the run has just ended");
  if (::syscall(SYS_pidfd_send_signal, int(fd), signal, nullptr, 0) == 0) return {};
  return device_error(fmt::format("process {} cannot be told: {}", process, std::generic_category().message(errno)));
}

bool running(const StationView& view) {
  return view.process && (view.state == StationState::running || view.state == StationState::results);
}

// Checks that an action is possible; changes nothing.
Status check(const ServedStation& station, const StationAction& wanted, const StationView& view) {
  const auto is = [&wanted](const char* word) { return wanted.action == word; };
  if (is("pause") && running(view) && view.pausing)  // a second SIGINT would stop it now
    return input_error("station '" + station.name + "': a pause was requested already");
  if (is("pause") || is("stop"))
    return running(view) ? Status() : Status(input_error("station '" + station.name + "': no run is in progress"));
  if (!is("add") && !is("remove") && !is("again") && !is("mounted"))
    return input_error("action " + turncal::quoted(wanted.action) + ": expected " +
                       one_of(wanted.action, {"add", "remove", "again", "mounted", "pause", "stop"}));
  TRY(check_serial(wanted.unit, "unit"));
  if (!is("mounted")) return {};
  if (station.mounted.empty())
    return input_error("station '" + station.name + "': the page has no station.N.mounted, and cannot tell the batch");
  if (view.state != StationState::mounting || !holds(view.units, wanted.unit))
    return input_error("station '" + station.name + "' does not wait for unit " + wanted.unit + " to be mounted");
  return {};
}

}  // namespace

Result<std::string> act(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                        double now_utc_s) {
  const StationView view = look_at(station, now_utc_s);
  TRY(check(station, wanted, view));
  TRY(write_down(station, wanted, operator_name, now_utc_s));
  Status done;
  std::string said;
  if (wanted.action == "pause" || wanted.action == "stop") {
    const bool pause = wanted.action == "pause";
    done = send_signal(view.folder + "/.lock", *view.process, pause ? SIGINT : SIGTERM);
    said = pause ? "the run is told to pause at the end of its move or dwell" : "the run is told to stop now";
  } else if (wanted.action == "mounted") {
    done = write_file_atomically(station.mounted, wanted.unit + "\n");
    said = "unit " + wanted.unit + " is mounted";
  } else {
    QueueChange change;
    (wanted.action == "add" ? change.add : wanted.action == "remove" ? change.remove : change.again) = {wanted.unit};
    done = change_queue(station.queue, change);
    said = "unit " + wanted.unit + ": " + wanted.action;
  }
  if (done) return said;
  // The recorded action was not done.
  StationAction failed = wanted;
  failed.action = "not done: " + wanted.action;
  TRY(write_down(station, failed, operator_name, now_utc_s));
  return done.error();
}

// ---- the configuration of serve, and who may act ----

namespace {

constexpr std::size_t most_bytes = 1 << 16, longest_name = 64;
// Hash for unknown names, which then take the same time as known ones.
constexpr const char* nobody = "$6$turncalturncal00$";

Result<std::map<std::string, std::string>> read_operators(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) == 0 && (facts.st_mode & (S_IROTH | S_IWOTH | S_IWGRP)) != 0)
    return input_error(path + ": others can read or change it: expected mode 0600 or 0640");
  const std::string text = TRY(read_whole_file(path, most_bytes));
  std::map<std::string, std::string> hashes;
  std::string_view remaining = text;
  for (int number = 1; !remaining.empty(); ++number) {
    const std::string_view line = trimmed(next_line(remaining));
    if (line.empty() || line.front() == '#') continue;
    const std::size_t colon = line.find(':');
    const std::string name(line.substr(0, colon));
    if (colon == std::string_view::npos || !is_plain_text(name) || name.size() > longest_name ||
        !line.substr(colon + 1).starts_with("$"))
      return input_error(path + ":" + std::to_string(number) +
                         ": expected NAME:HASH with a hash of crypt(5), as $6$...");
    if (!hashes.emplace(name, line.substr(colon + 1)).second)
      return input_error(path + ":" + std::to_string(number) + ": " + turncal::quoted(name) + " is listed twice");
  }
  if (hashes.empty()) return input_error(path + ": names nobody: expected a line NAME:HASH for each operator");
  return hashes;
}

std::optional<std::string> from_base64(const std::string& text) {
  std::string bytes(text.size(), '\0');
  const int size = ::b64_pton(text.c_str(), reinterpret_cast<unsigned char*>(bytes.data()), bytes.size());
  bytes.resize(std::size_t(std::max(size, 0)));
  return size < 0 ? std::nullopt : std::optional(bytes);
}

bool is_password(const std::string& password, const std::string& hash) {
  const auto space = std::make_unique<crypt_data>();
  const char* hashed = ::crypt_r(password.c_str(), hash.c_str(), space.get());
  if (hashed == nullptr || hashed[0] == '*') return false;
  const std::string_view found(hashed);
  unsigned difference = found.size() == hash.size() ? 0U : 1U;
  for (std::size_t i = 0; i < found.size() && i < hash.size(); ++i) difference |= unsigned(found[i] ^ hash[i]);
  return difference == 0;
}

}  // namespace

Status check_operators(const std::string& path) {
  const auto operators = read_operators(path);
  return operators ? Status() : Status(operators.error());
}

Result<std::string> authorised_operator(const std::string& path, std::string_view authorization) {
  const std::map<std::string, std::string> operators = TRY(read_operators(path));
  const std::string_view scheme = "Basic ";
  const std::optional<std::string> given =
      authorization.starts_with(scheme) ? from_base64(std::string(authorization.substr(scheme.size()))) : std::nullopt;
  const std::size_t colon = given ? given->find(':') : std::string::npos;
  if (colon == std::string::npos || given->find('\0') != std::string::npos)
    return input_error("name and password: expected");
  const std::string name = given->substr(0, colon);
  const auto known = operators.find(name);
  const bool right = is_password(given->substr(colon + 1), known == operators.end() ? nobody : known->second);
  if (!right || known == operators.end()) return input_error("name or password is wrong");
  return name;
}

Result<ServiceConfig> read_service_config(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  const auto beside = [&file](const std::string& name) { return name.empty() ? name : file.beside(name); };
  ServiceConfig config;
  for (int number = 1; number == 1 || file.has("station." + std::to_string(number)); ++number) {
    const std::string key = "station." + std::to_string(number);
    ServedStation station{.name = file.text(key),
                          .queue = beside(file.text(key + ".queue")),
                          .runs = beside(file.text(key + ".runs")),
                          .mounted = beside(file.text_or(key + ".mounted", ""))};
    const auto same = [&station](const ServedStation& other) { return other.name == station.name; };
    if (std::ranges::any_of(config.stations, same)) file.reject(key, "a name of its own");
    config.stations.push_back(std::move(station));
  }
  if (file.has("serve.password_file")) config.password_file = file.file_named("serve.password_file");
  config.database = file.text_or("serve.database", "");
  if (!names_a_server(config.database)) config.database = beside(config.database);
  config.alert.command = file.text_or("alert.command", "");
  if (!config.alert.command.empty()) {
    config.alert.record = beside(file.text("alert.record"));
    if (const Status s = check_folder_writable(folder_of(config.alert.record)); !s)
      file.reject("alert.record", "a file in a folder that can be written: " + s.error().message);
    config.alert.time_s = file.number_or("alert.time_s", config.alert.time_s, between(1.0, 3600.0));
    config.alert.least_yield = file.number_if("alert.least_yield", between(0.0, 1.0));
  }
  TRY(file.check_all_used());
  TRY(check_database_name(config.database));
  return config;
}

}  // namespace turncal
