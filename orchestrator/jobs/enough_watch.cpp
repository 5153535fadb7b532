#include "orchestrator/jobs/enough_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <tuple>

#include "calib/evidence/evidence.h"
#include "calib/prediction/predict.h"
#include "imu_io/base/text.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

const NeededSigma* worst_of(const std::vector<NeededSigma>& sigmas) {
  const auto found = std::ranges::max_element(sigmas, {}, &NeededSigma::ratio);
  return found == sigmas.end() ? nullptr : &*found;
}

// Returns the first item of the north seeking or, of_legs, of the added legs before it.
std::size_t first_item_of(const Run& run, bool of_legs) {
  const auto found = std::ranges::find_if(run.plan.items, [&](const PlannedItem& item) {
    return (run.verify_from > 0 && item.step >= run.verify_from) ||
           (of_legs && run.sequence.steps[item.step_index].file == settling_name);
  });
  return std::size_t(found - run.plan.items.begin());
}

// Returns the unit of which least is known. REQUIRES that there is one.
const KnownSoFar& least_known(const std::vector<KnownSoFar>& units) {
  return *std::ranges::max_element(units, {}, [](const KnownSoFar& unit) {
    const NeededSigma* const worst = unit.worst();
    return std::tuple(unit.again, !unit.why_not.empty(),
                      worst ? worst->ratio() : std::numeric_limits<double>::infinity());
  });
}

}  // namespace

const NeededSigma* KnownSoFar::worst() const { return worst_of(sigmas); }

std::string not_reached(const Run& run, const RunUnit& unit) {
  if (!run.request.until_sigma || !unit.output) return "";
  const std::vector<NeededSigma> sigmas = needed_sigmas(unit.output->file, run.station.stop_sigma, run.station.limits);
  const NeededSigma* const worst = worst_of(sigmas);
  if (worst == nullptr || worst->needed == 0.0 || worst->ratio() <= 1.0) return "";
  return "unit " + unit.serial + ": not enough at the planned end: " + words_of(*worst);
}

Segments takes_of_last(const Segments& segments, std::size_t dwells) {
  const auto same_pose = [&](const Segment& segment) {
    const Segment& last = segments.back();
    return segment.heading_deg == last.heading_deg && segment.pitch_deg == last.pitch_deg &&
           segment.roll_deg == last.roll_deg;
  };
  Segments takes;  // in the last pose; a resumed run settles again between them
  for (auto at = segments.rbegin(); at != segments.rend() && same_pose(*at); ++at)
    if (at->kind != SegmentKind::rotate) takes.insert(takes.begin(), *at);
  takes.erase(takes.begin(), takes.begin() + std::ptrdiff_t(std::min(takes.size(), dwells - 1)));
  return takes;
}

EnoughWatch::EnoughWatch(Run& run, std::deque<RecordingSink>& recordings, BackgroundQueue& storage, Tell tell)
    : run_(run),
      recordings_(recordings),
      storage_(storage),
      tell_(std::move(tell)),
      end_item_(first_item_of(run, true)),
      last_item_(first_item_of(run, false)) {}

Result<std::optional<std::size_t>> EnoughWatch::go_on_with(std::size_t next_item) {
  // Items may be skipped before the end, and added at the end.
  const bool ending = next_item == last_item_ && settling_left_s() > 0.0;
  if (!ending && !(run_.request.until_sigma && next_item < end_item_)) return std::optional(next_item);
  if (decided_) {
    if (!decided_->written.done()) return std::optional<std::size_t>();
    const Decided decided = *std::exchange(decided_, std::nullopt);
    if (!decided.written.status()) return decided.written.status().error();
    for (const Settling& settling : decided.settled) TRY(lengthen(run_, settling));
    last_item_ = first_item_of(run_, false);
    return std::optional(decided.next_item);
  }
  if (!running_.valid()) running_ = std::async(std::launch::async, [this, next_item] { return estimate(next_item); });
  if (running_.wait_for(std::chrono::milliseconds(2)) != std::future_status::ready) return std::optional<std::size_t>();
  const std::vector<KnownSoFar> units = running_.get();
  if (ending) {
    std::vector<Settling> settled;
    for (const KnownSoFar& known : units)
      if (known.settling) tell(settled.emplace_back(*known.settling), known);
    const auto write = [&journal = *run_.journal, settled]() -> Status {
      for (Settling one : settled) TRY(journal.append(JournalType::settle, texts_of(fields_of(one))));
      return {};
    };
    decided_ = Decided{next_item, settled, PendingWrite(storage_, write)};
    return std::optional<std::size_t>();
  }
  const bool enough =
      !units.empty() && std::ranges::all_of(units, [](const KnownSoFar& unit) { return unit.why_not.empty(); });
  const bool again = std::ranges::any_of(units, [](const KnownSoFar& unit) { return unit.again; });
  std::vector<std::pair<RecordingSink*, Segment>> aside;
  for (const KnownSoFar& known : units)
    for (std::size_t i = 0; i < run_.units.size(); ++i)
      for (const Segment& take : known.set_aside)
        if (run_.units[i].serial == known.unit) aside.emplace_back(&recordings_[i], take);
  const auto write = [&journal = *run_.journal, aside, fields = note(units, next_item, enough, again)]() -> Status {
    for (const auto& [recording, take] : aside) TRY(recording->set_aside(take));
    return fields.empty() ? Status{} : journal.append(JournalType::estimate, fields);
  };
  decided_ = Decided{enough ? end_item_ : again ? next_item - 1 : next_item, {}, PendingWrite(storage_, write)};
  return std::optional<std::size_t>();
}

std::vector<KnownSoFar> EnoughWatch::estimate(std::size_t done_items) {
  std::vector<KnownSoFar> known;
  for (const RunUnit& unit : run_.units) {
    if (unit.dropped) continue;
    known.push_back(done_items == last_item_ ? settle(unit) : estimate(unit, done_items));
    if (known.back().settling && known.back().settling->added_s > 0.0) break;  // one at a time
  }
  return known;
}

double EnoughWatch::settling_left_s() const {
  double left_s = settling_allowed_s(run_);
  for (const Settling& one : run_.request.settled) left_s -= one.added_s;
  // A doubt that no legs can settle is not judged again from the same samples.
  const bool found = run_.request.settled.empty() || !run_.request.settled.back().sequence.empty();
  return found && left_s >= least_settling_s ? left_s : 0.0;
}

KnownSoFar EnoughWatch::settle(const RunUnit& unit) {
  KnownSoFar known{.unit = unit.serial};
  const Look now = look(unit, {});
  if (!now.output || !undetermined_parameters(*now.output->fit).empty() || now.loaded->recorded_s < least_diagnosed_s)
    return known;
  std::vector<NeededSigma> needed;
  if (run_.request.until_sigma) needed = needed_sigmas(now.output->file, run_.station.stop_sigma, run_.station.limits);
  known.settling = find_settling({.recording = now.loaded->data,
                                  .base = *now.output->fit,
                                  .sequence = run_.sequence,
                                  .plan = run_.plan,
                                  .limits = plan_limits(run_.station, run_.sample_period_s()),
                                  .left_s = settling_left_s(),
                                  .needed = needed});
  if (known.settling) known.settling->unit = unit.serial;
  return known;
}

void EnoughWatch::tell(const Settling& settling, const KnownSoFar& unit) {
  tell_("in doubt" + (run_.units.size() > 1 ? " of unit " + unit.unit : "") + ": " + settling.doubt + "; " +
            (settling.sequence.empty() ? settling.why_not
                                       : "goes on for " + format_duration(settling.added_s) + " to settle it"),
        unit);
}

EnoughWatch::Look EnoughWatch::look(const RunUnit& unit, const Segments& without) const {
  const Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(unit.file(partial_recording_name));
  if (!source) return {source.error(), source.error()};
  for (const Segment& take : without) (*source)->set_aside(take);
  Result<LoadedRecording> loaded = load_recording(**source, {}, {}, run_.verify_from);
  if (!loaded) return {loaded.error(), loaded.error()};
  Result<CalibrationOutput> output = Error{ErrorKind::unit_failed, "the table has not turned yet"};
  if (!loaded->by_hand)  // true as long as all angles are 0
    output = calibrate_recording(*loaded, {.partial = true, .test_fit = false});
  return {std::move(loaded), std::move(output)};
}

bool EnoughWatch::disagrees(const Look& look) {
  return look.output.ok() && last_rest_disagrees(look.loaded->data, *look.output->fit);
}

// Returns the takes of a repeated dwell that disagree, provided that the last one agrees without them.
Segments EnoughWatch::to_set_aside(const RunUnit& unit, const Segments& takes) const {
  Segments bad;
  for (const Segment& take : takes) {
    Segments others = takes;
    std::erase_if(others, [&](const Segment& other) { return other.start_sample == take.start_sample; });
    if (take.start_sample != takes.back().start_sample && disagrees(look(unit, others))) bad.push_back(take);
  }
  return bad.empty() || disagrees(look(unit, bad)) ? Segments{} : bad;
}

KnownSoFar EnoughWatch::estimate(const RunUnit& unit, std::size_t done_items) {
  KnownSoFar known{.unit = unit.serial};
  Look so_far = look(unit, {});
  if (!so_far.loaded) {
    known.why_not = so_far.loaded.error().message;
    return known;
  }
  std::size_t dwells = 0;  // consecutive ones in the last pose
  while (dwells < done_items && run_.plan.items[done_items - 1 - dwells].kind == SequenceItem::Kind::dwell) ++dwells;
  const Segments takes = takes_of_last(so_far.loaded->data.segments, dwells);
  known.set_aside = to_set_aside(unit, takes);
  if (!known.set_aside.empty())
    so_far = look(unit, known.set_aside);
  else if (known.again = std::ssize(takes) <= run_.station.dwell.max_repeats && disagrees(so_far); known.again)
    known.why_not = "this dwell, or the turn before it, disagrees with the others";
  const Result<CalibrationOutput>& output = so_far.output;
  if (!output) {
    known.why_not = output.error().message;
    const std::string& path = so_far.loaded->path;
    if (known.why_not.starts_with(path + ": ")) known.why_not.erase(0, path.size() + 2);
    return known;
  }
  const std::string open = undetermined_parameters(*output->fit);
  if (open.empty()) known.sigmas = needed_sigmas(output->file, run_.station.stop_sigma, run_.station.limits);
  const NeededSigma* const worst = known.worst();
  if (known.again) return known;
  if (!open.empty())
    known.why_not = "this recording does not determine " + open;
  else if (worst && worst->needed == 0.0)
    known.why_not = parameter_key(worst->parameter) + " is beyond its limit";
  else if (worst && worst->ratio() > 1.0)
    known.why_not = words_of(*worst);
  else if (const auto most = run_.station.limits.residual_max; most && output->fit->normalised_rms > *most)
    known.why_not =
        "residual " + significant(output->fit->normalised_rms, 3) + ", limit.residual_max " + significant(*most, 3);
  else if (const double s = so_far.loaded->recorded_s;
           s < least_diagnosed_s && !run_.request.no_diagnosis && length_s(0, end_item_) >= least_diagnosed_s)
    known.why_not = "too short for a diagnosis, " + format_duration(s) + " of " + format_duration(least_diagnosed_s);
  else if (known.why_not = why_not_trusted(output->file); known.why_not.empty())
    known.why_not = distrust_of(so_far.loaded->data, *output->fit);
  if (worst && worst->needed > 0.0 && worst->ratio() > 1.0) {
    known.end = expected_end(known.sigmas, done_items, *output->fit, false);
    known.soonest = expected_end(known.sigmas, done_items, *output->fit, true);
  }
  return known;
}

double EnoughWatch::length_s(std::size_t from, std::size_t to) const {
  double sum_s = 0.0;
  for (std::size_t i = from; i < to; ++i) sum_s += run_.plan.items[i].duration_s;
  return sum_s;
}

const ParameterVector& EnoughWatch::planned_sigmas(std::size_t items, const JointResult& fit) {
  const auto known = planned_.find(items);
  if (known != planned_.end()) return known->second;
  PlannedMotion motion = planned_motion(run_.sequence, run_.plan);
  motion.items.resize(items);
  PredictOptions options;
  options.noise = fit.noise;
  options.unit = fit.parameters;
  return planned_[items] = predict(planned_info(run_), motion, options).sigma;
}

std::optional<std::size_t> EnoughWatch::expected_end(const std::vector<NeededSigma>& sigmas, std::size_t done_items,
                                                     const JointResult& fit, bool soonest) {
  std::vector<std::size_t> ends;  // items done when the run may end
  for (std::size_t i = done_items; i < end_item_; ++i)
    if (run_.plan.items[i].kind == SequenceItem::Kind::dwell) ends.push_back(i + 1);
  const ParameterVector now = planned_sigmas(done_items, fit);
  const auto enough_at = [&](std::size_t items) {
    const ParameterVector& then = planned_sigmas(items, fit);
    return std::ranges::all_of(sigmas, [&](const NeededSigma& one) {
      const auto k = Eigen::Index(one.parameter);
      return now(k) > 0.0 && then(k) * (soonest ? std::min(1.0, one.sigma / now(k)) : one.sigma / now(k)) <= one.needed;
    });
  };
  const auto found = std::ranges::partition_point(ends, [&](std::size_t items) { return !enough_at(items); });
  if (found == ends.end()) return std::nullopt;
  return *found - 1;
}

JournalFields EnoughWatch::note(const std::vector<KnownSoFar>& units, std::size_t next_item, bool enough, bool again) {
  if (units.empty()) return {};
  const KnownSoFar& least = least_known(units);
  const NeededSigma* const worst = least.worst();
  std::string line = fmt::format("after item {} of {}: ", next_item, run_.plan.items.size());
  std::size_t set_aside = 0;
  for (const KnownSoFar& unit : units) {
    set_aside += unit.set_aside.size();
    if (!unit.set_aside.empty())
      line += "repeated, this dwell agrees" + (units.size() > 1 ? ", of unit " + unit.unit : "") +
              "; the one that does not is left out; ";
  }
  if (enough) {
    line += "enough is known; " + format_duration(length_s(next_item, end_item_)) + " of the plan is left out";
  } else if (again) {
    line += least.why_not + (units.size() > 1 ? ", of unit " + least.unit : "") + ": it is repeated";
  } else {
    line += "not yet enough" + (units.size() > 1 ? " of unit " + least.unit : "") + ": " + least.why_not;
    const auto in = [&](std::size_t item) { return format_duration(length_s(next_item, item + 1)); };
    if (least.soonest) {
      const std::size_t last = least.end.value_or(end_item_ - 1);
      const bool range = last != *least.soonest;
      line +=
          fmt::format("; expected after item {}{}, in {}{}", *least.soonest + 1,
                      range ? fmt::format(" to {}", last + 1) : "", in(*least.soonest), range ? " to " + in(last) : "");
    } else if (worst && worst->ratio() > 1.0) {
      line += "; the run goes to its planned end";
    }
  }
  tell_(line, least);
  return {{"item", std::to_string(next_item - 1)},
          {"enough", enough ? "true" : "false"},
          {"again", again ? "true" : "false"},
          {"set_aside", format_number(double(set_aside))},
          {"unit", units.size() > 1 ? least.unit : ""},
          {"worst", worst ? parameter_key(worst->parameter) : ""},
          {"sigma", worst ? format_number(worst->sigma) : ""},
          {"needed", worst ? format_number(worst->needed) : ""},
          {"reason", least.why_not}};
}

}  // namespace turncal
