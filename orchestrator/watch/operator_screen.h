// What the operator of a table turned by hand sees: one instruction, the angle to set or the time that is left, and what was wrong. It is
// made from the task (manual_turntable.h) and the state of the run; terminal and page draw this and nothing else.
//
// On a terminal: a block from its upper left corner, redrawn in place, and below it the line that is typed in. What somebody is typing is left
// alone until Enter. The bell rings when hands are wanted or an answer was not taken. A character of Chinese is two columns wide; nothing but
// ASCII is drawn around the texts.
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
  bool measures = false;    // a dwell or a rest: how long it lasts is known
  std::string big;          // the angle to set, or what is left: "1:40"; may be empty
  std::string instruction;  // in the operator's language, as all that follows; empty: nothing to say
  std::string from, way, how, answer, note, step, left, words;
  std::array<std::string, 3> axes;  // names
  std::string sound, silent;        // of the page
  bool wants_hands() const {
    return task.kind != OperatorTask::Kind::nothing && task.kind != OperatorTask::Kind::compare;
  }
};

// left_s: of the run, with what turns take; empty: its time is not that of the wall.
OperatorScreen operator_screen(const OperatorTask& task, const RunSnapshot& at, std::optional<double> left_s,
                               const OperatorTexts& texts);
// What stays when the run is over. resume: the folder to go on with; empty: none.
OperatorScreen last_screen(bool done, const std::string& resume, const OperatorTexts& texts);
std::string step_words(const RunSnapshot& at, const OperatorTexts& texts);
std::string left_words(const RunSnapshot& at, std::optional<double> left_s, const OperatorTexts& texts);
std::string json_of(const OperatorScreen& screen);
std::string local_time(double utc_s);  // "15:20" of this machine

struct TerminalSize {
  int columns = 0, rows = 0;
  bool takes_screen() const { return columns >= 60 && rows >= 24; }
};
TerminalSize stdout_size();

// The block, a line each, at most `rows`. time: of the wall.
std::vector<std::string> drawn(const OperatorScreen& screen, const std::string& time, TerminalSize size);

class OperatorTerminal {
 public:
  // tag: in front of the first line ("[dry run] "). write may be told more than fits: it is not waited for.
  OperatorTerminal(std::string tag, std::function<void(const std::string&)> write, TerminalSize size,
                   std::function<double()> utc_s);
  ~OperatorTerminal();  // what is printed next stands below the block
  OperatorTerminal(const OperatorTerminal&) = delete;
  OperatorTerminal& operator=(const OperatorTerminal&) = delete;
  void show(const OperatorScreen& screen);

 private:
  bool rings(const OperatorScreen& screen) const;
  std::string tag_;
  std::function<void(const std::string&)> write_;
  TerminalSize size_;
  std::function<double()> utc_s_;
  std::vector<std::string> lines_;      // as they stand
  std::optional<OperatorTask> before_;  // what was drawn last
};

}  // namespace turncal
