// The operator's screen on a terminal: a block from its upper left corner, redrawn in place, and below it the line that is typed in. What
// somebody is typing is left alone until Enter. The bell rings when hands are wanted or an answer was not taken.
//
// A character of Chinese is two columns wide. Nothing but ASCII is drawn around the texts.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "orchestrator/watch/operator_screen.h"

namespace turncal {

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
