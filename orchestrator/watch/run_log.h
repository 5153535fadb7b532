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

// Without the line break.
std::string format_transition(const TransitionRecord& record);
std::string format_dropout(const Dropout& dropout);

class RunLog : public RunObserver {
 public:
  // The file must not exist. Every line is handed to the system at once. `tag` stands in front of each ("[dry run] "), so that none of a
  // simulation passes for a real one.
  static Result<RunLog> create(const std::string& path, std::string tag);
  static Result<RunLog> append(const std::string& path, std::string tag);  // to a log that is there, or a new one

  void line(const std::string& text);
  void on_transition(const TransitionRecord& record) override { line(format_transition(record)); }
  void on_dropout(const Dropout& dropout) override { line(format_dropout(dropout)); }
  void on_progress(const RunSnapshot&) override {}
  // The first failure to write, which the run must not hide.
  const Status& status() const { return status_; }

 private:
  RunLog(PosixFile file, std::string tag) : file_(std::move(file)), tag_(std::move(tag)) {}
  PosixFile file_;
  std::string tag_;
  Status status_;
};

}  // namespace turncal
