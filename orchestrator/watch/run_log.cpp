#include "orchestrator/watch/run_log.h"

#include <cstdio>

#include "imu_io/base/clock.h"

namespace turncal {

namespace {

std::string head_of(const RunSnapshot& at) {
  char head[120];
  std::snprintf(head, sizeof head, "%s %11.3f s  step %zu/%zu  ", format_utc(at.utc_s).c_str(), at.time_s,
                at.step_place, at.step_count);
  return head;
}

}  // namespace

std::string format_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  std::string text = head_of(at);
  text += to_string(record.from);
  if (record.to != record.from) {
    text += " -> ";
    text += to_string(record.to);
  }
  text += "  ";
  text += to_string(record.event);
  if (record.unexpected) text += " (unexpected)";
  if (!record.detail.empty()) {
    text += ": " + record.detail;
  } else if (at.axis) {
    char angle[80];
    std::snprintf(angle, sizeof angle, ": %s at %.4f deg", to_string(*at.axis), at.position_deg[*at.axis]);
    text += angle;
  }
  if (record.to == RunState::stopping || is_final(record.to)) text += std::string("; table ") + to_string(at.table);
  return text;
}

std::string format_dropout(const Dropout& dropout) {
  return head_of(dropout.at) + "unit " + dropout.serial + " dropped out at " + dropout.why.message;
}

Result<RunLog> RunLog::create(const std::string& path, std::string tag) {
  PosixFile file = TRY(PosixFile::create_new(path));
  return RunLog(std::move(file), std::move(tag));
}

Result<RunLog> RunLog::append(const std::string& path, std::string tag) {
  if (!path_exists(path)) return create(path, std::move(tag));
  PosixFile file = TRY(PosixFile::open_to_change(path));
  const std::uint64_t size = TRY(file.size());
  TRY(file.seek(size));
  RunLog log(std::move(file), std::move(tag));
  if (size > 0) log.status_ = log.file_.write_all(std::string_view("\n"));  // the last line may be torn
  return log;
}

void RunLog::line(const std::string& text) {
  if (status_) status_ = file_.write_all(std::string_view(tag_ + text + "\n"));
}

}  // namespace turncal
