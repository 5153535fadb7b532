// For tests of batches: what became of the units of a queue, and a batch that is killed until it is done.
#pragma once

#include "orchestrator/records/unit_queue.h"
#include "tests/orchestrator/program.h"

namespace turncal {

// "SN1=pass SN2=fail "
inline std::string outcomes_text(const std::string& queue) {
  const auto all = read_outcomes(queue);
  std::string text;
  if (all)
    for (const UnitOutcome& o : *all) text += o.unit + "=" + o.outcome + " ";
  return text;
}

class BatchProgram : public Program {
 protected:
  // Of the file `queue`, with the short sequence, into the folder `units`.
  Arguments batch(const Arguments& more = {}) const {
    return Arguments{"batch", "queue", "--dry-run", "--out", "units", "--sequence", first_steps("5")} + more;
  }
  std::string outcomes() const { return outcomes_text(path("queue")); }
  // Killed after first_us, later by step_us, and so on, until a batch ends.
  void kill_until_done(const Arguments& arguments, int first_us, int step_us) const {
    int kills = 0;
    for (int i = 0; i < 60; ++i) {
      const pid_t pid = start(arguments);
      ::usleep(static_cast<useconds_t>(first_us + step_us * (i % 9)));
      ::kill(pid, SIGKILL);
      const ProgramResult result = finish(pid);
      if (result.code == 0) break;
      ASSERT_EQ(result.code, -1000 - SIGKILL) << result.err;
      ++kills;
    }
    ASSERT_EQ(run(arguments).code, 0);
    EXPECT_GT(kills, 0);
  }
};

}  // namespace turncal
