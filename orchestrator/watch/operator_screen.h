// The screen for the operator of a table turned by hand: one instruction, the angle to set or the time left, and the last error. It is
// made from the task (manual_turntable.h) and the state of the run; terminal and page draw only this.
//
// A terminal shows it as a block from its upper left corner, redrawn in place, with the input line below it. What somebody is typing stays
// until Enter. The bell rings when hands are needed or an answer was rejected. A Chinese character is two columns wide; only ASCII is
// drawn around the texts.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "orchestrator/run/run_observer.h"
#include "turntable_drivers/manual/manual_turntable.h"

namespace turncal {

struct OperatorScreen {
  OperatorTask task;
  bool measures = false;    // a dwell or a rest, whose end is known
  std::string big;          // angle to set, or time left: "1:40"; may be empty
  std::string instruction;  // in the operator's language, like the following; empty: none
  std::string from, way, how, answer, note, step, left, words;
  std::array<std::string, 3> axes;  // names
  std::string sound, silent;        // on the page
  bool wants_hands() const {
    return task.kind != OperatorTask::Kind::nothing && task.kind != OperatorTask::Kind::compare;
  }
};

// left_s: time left of the run, with the operator's turns; empty: not in wall time.
OperatorScreen operator_screen(const OperatorTask& task, const RunSnapshot& at, std::optional<double> left_s,
                               const OperatorTexts& texts);
// Returns the screen that stays after the run. resume: the folder to resume; empty: none.
OperatorScreen last_screen(bool done, const std::string& resume, const OperatorTexts& texts);
std::string step_words(const RunSnapshot& at, const OperatorTexts& texts);
std::string left_words(const RunSnapshot& at, std::optional<double> left_s, const OperatorTexts& texts);
std::string json_of(const OperatorScreen& screen);
std::string local_time(double utc_s);  // "15:20", local time of this machine

struct TerminalSize {
  int columns = 0, rows = 0;
  bool takes_screen() const { return columns >= 60 && rows >= 24; }
};
TerminalSize stdout_size();

// Draws the block line by line, in at most `rows` lines. time: wall clock.
std::vector<std::string> drawn(const OperatorScreen& screen, const std::string& time, TerminalSize size);

class OperatorTerminal {
 public:
  // tag: prefix of the first line ("[dry run] "). write may get more than the terminal takes at once, and must not wait.
  OperatorTerminal(std::string tag, std::function<void(const std::string&)> write, TerminalSize size,
                   std::function<double()> utc_s);
  ~OperatorTerminal();  // later output goes below the block
  OperatorTerminal(const OperatorTerminal&) = delete;
  OperatorTerminal& operator=(const OperatorTerminal&) = delete;
  void show(const OperatorScreen& screen);

 private:
  bool rings(const OperatorScreen& screen) const;
  std::string tag_;
  std::function<void(const std::string&)> write_;
  TerminalSize size_;
  std::function<double()> utc_s_;
  std::vector<std::string> lines_;      // as shown
  std::optional<OperatorTask> before_;  // task drawn last
};

}  // namespace turncal
