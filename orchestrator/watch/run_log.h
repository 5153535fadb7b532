// A run in words: one line a transition, with station time, and the file run.log made of them.
//
//   2026-01-01T00:12:34Z     754.500 s  step 2/14  moving -> settling  arrived: roll at 360.0000 deg
//
// Times are the station's, so the log of a dry run is the same bytes every time.
#pragma once

#include <string>
#include <string_view>

#include "calib/types/status.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

// Without the line break. `tag` stands in front ("[dry run] "), so that no line of a simulation passes for a real one.
std::string format_transition(const TransitionRecord& record, std::string_view tag);

std::string format_dropout(const Dropout& dropout, std::string_view tag);

class RunLog : public RunObserver {
 public:
  // The file must not exist. Every line is handed to the system at once.
  static Result<RunLog> create(const std::string& path, std::string tag);

  static Result<RunLog> append(const std::string& path, std::string tag);  // to a log that is there, or a new one

  void line(const std::string& text);
  void on_transition(const TransitionRecord& record) override;
  void on_dropout(const Dropout& dropout) override { line_as_is(format_dropout(dropout, tag_)); }
  void on_progress(const RunSnapshot&) override {}
  // The first failure to write, which the run must not hide.
  const Status& status() const { return status_; }

 private:
  RunLog(PosixFile file, std::string tag) : file_(std::move(file)), tag_(std::move(tag)) {}
  PosixFile file_;
  void line_as_is(const std::string& text);
  std::string tag_;
  Status status_;
};

}  // namespace turncal
